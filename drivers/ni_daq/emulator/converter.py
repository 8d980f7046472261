"""From the plant's units to what the client reads: sensor, stages, 24-bit converter, DAQmx scaling."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from drivers.ni_daq.emulator.wiring import FASTEST_HZ, CardWiring, Input, Wire

HALF_CODES = 2.0**23


class Converter:
    """Converts the plant's rows, in the order of `plant_channels`, to the task's `inputs`."""

    def __init__(
        self,
        wiring: CardWiring,
        plant_channels: Sequence[str],
        inputs: Sequence[Input],
        rate_hz: float = FASTEST_HZ,
    ) -> None:
        self._random = np.random.default_rng(wiring.seed)
        self._noise_v = wiring.idle_noise_v
        wires = [wiring.wires.get(item.physical) for item in inputs]
        live = [wire if wire is not None and wire.connected else None for wire in wires]
        seen = [wire if wire is not None and not wire.shorted else None for wire in live]
        self._idle = np.array([wire is None for wire in seen])
        self._rows = np.array(
            [0 if wire is None else plant_channels.index(wire.plant_channel) for wire in seen]
        )
        self._gains = np.array([[0.0 if wire is None else wire.volts_per_unit] for wire in seen])
        self._lsb = np.array([[5.0 if wire is None else wire.range_v] for wire in wires]) / HALF_CODES
        self._scales = self._lsb / np.array([[item.volts_per_unit] for item in inputs])
        self._stages = [[] if wire is None else stages_of(wire, rate_hz) for wire in seen]
        fed = [(item, wire) for item, wire in zip(inputs, live, strict=True) if item.iepe]
        self.open_inputs = tuple(item.physical for item, wire in fed if wire is None)
        self.shorted_inputs = tuple(item.physical for item, wire in fed if wire is not None and wire.shorted)

    def convert(self, plant: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return values as read, shape (inputs, n), and which inputs clipped, shape (inputs,)."""
        codes = plant[self._rows] * (self._gains / self._lsb)
        for row, stages in enumerate(self._stages):
            for stage in stages:
                codes[row] = stage(codes[row] * self._lsb[row]) / self._lsb[row]
        if self._idle.any():
            shape = (int(self._idle.sum()), plant.shape[1])
            codes[self._idle] = self._random.normal(0.0, self._noise_v, shape) / self._lsb[self._idle]
        np.rint(codes, out=codes)
        highest, lowest = codes.max(axis=1), codes.min(axis=1)
        clipped = (highest >= HALF_CODES - 1) | (lowest <= -HALF_CODES)
        np.clip(codes, -HALF_CODES, HALF_CODES - 1, out=codes)
        return codes * self._scales, clipped


Stage: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Takes consecutive blocks in V, shape (n,), and remembers what it has to."""


def stages_of(wire: Wire, rate_hz: float) -> list[Stage]:
    """The stages of a chain, in the order of the signal, all at rest."""
    stages: list[Stage] = []
    charge, low_pass = wire.charge, wire.low_pass
    if charge is not None and charge.reset:
        stages.append(np.zeros_like)
    elif charge is not None:
        highest_v = charge.output_v
        if charge.corner_hz is not None:
            stages.append(_Filter(signal.butter(1, charge.corner_hz, "highpass", fs=rate_hz, output="sos")))
        stages.append(lambda volts: np.clip(volts, -highest_v, highest_v))
    if low_pass is not None and low_pass.corner_hz < rate_hz / 2.0:
        stages.append(_Filter(signal.butter(low_pass.order, low_pass.corner_hz, fs=rate_hz, output="sos")))
    return stages


class _Filter:
    """A recursive filter with memory."""

    def __init__(self, sections: NDArray[np.float64]) -> None:
        self._sections = sections
        self._state = np.zeros((len(sections), 2))

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        filtered, self._state = signal.sosfilt(self._sections, volts, zi=self._state)
        return np.asarray(filtered)

"""What the client of the emulated card reads of the plant: sensor, stages, 24-bit converter and scaling on an
analog input, pulses and register on a counter."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.quantity import seconds
from drivers.ni_daq.emulator.wiring import FASTEST_HZ, CardWiring, CounterWire, Input, ResonanceStage, Wire

HALF_CODES = 2.0**23  # 24 bits, both signs


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
        seen = [None if wire is None or wire.shorted or not wire.plant_channel else wire for wire in live]
        wired = [(row, wire) for row, wire in enumerate(seen) if wire is not None]
        self._wired = [row for row, _ in wired]
        self._idle = [row for row, wire in enumerate(seen) if wire is None]
        self._rows = [plant_channels.index(wire.plant_channel) for _, wire in wired]
        self._lsb = np.array([[5.0 if wire is None else wire.range_v] for wire in wires]) / HALF_CODES
        volts_per_unit = np.array([wire.volts_per_unit for _, wire in wired])[:, None]
        self._gains = volts_per_unit / self._lsb[self._wired]
        self._scales = self._lsb / np.array([[item.volts_per_unit] for item in inputs])
        self._stages = [[] if wire is None else stages_of(wire, rate_hz) for wire in seen]
        # elsewhere the plant's noise is the input's too
        low = [None if wire is None else wire.low_pass for wire in seen]
        self._filtered = [
            row for row, stage in enumerate(low) if stage is not None and stage.corner_hz < rate_hz / 2.0
        ]
        fed = [(item, wire) for item, wire in zip(inputs, live, strict=True) if item.iepe]
        self.open_inputs = tuple(item.physical for item, wire in fed if wire is None)
        self.shorted_inputs = tuple(item.physical for item, wire in fed if wire is not None and wire.shorted)
        self._fed = [(item.physical, wire.plant_channel) for item, wire in fed if wire is not None]
        self._shows = [(row, wire.plant_channel) for row, wire in wired]

    def fed_by(self, plant_channels: Container[str]) -> list[str]:
        """The inputs with a supply whose sensors show these channels."""
        return [physical for physical, channel in self._fed if channel in plant_channels]

    def convert(
        self, plant: NDArray[np.float64], loose: Container[str] = ()
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return values as read, shape (inputs, n), and which inputs clipped, shape (inputs,).

        The cables of sensors that show the `loose` channels of the plant are off by now.
        """
        codes = np.empty((len(self._lsb), plant.shape[1]))
        codes[self._wired] = plant[self._rows] * self._gains
        for row, stages in enumerate(self._stages):
            for stage in stages:
                codes[row] = stage(codes[row] * self._lsb[row]) / self._lsb[row]
        for row in self._filtered:
            codes[row] += self._random.normal(0.0, self._noise_v, codes.shape[1]) / self._lsb[row]
        # A loose or shorted input still converts: its own noise, about zero.
        idle = self._idle + [row for row, channel in self._shows if channel in loose]
        noise = self._random.standard_normal((len(idle), plant.shape[1]))
        noise *= self._noise_v / self._lsb[idle]
        codes[idle] = noise
        # Whole codes: what two's complement of 24 bits can say, clipped at either end.
        np.rint(codes, out=codes)
        highest, lowest = codes.max(axis=1), codes.min(axis=1)
        clipped = (highest >= HALF_CODES - 1) | (lowest <= -HALF_CODES)
        np.clip(codes, -HALF_CODES, HALF_CODES - 1, out=codes)
        codes *= self._scales
        return codes, clipped


Stage: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Takes consecutive blocks in V, shape (n,), and remembers what it has to."""


def stages_of(wire: Wire, rate_hz: float) -> list[Stage]:
    """The stages of a chain, in the order of the signal, all at rest."""
    stages: list[Stage] = []
    charge, low_pass, mark = wire.charge, wire.low_pass, wire.mark
    if mark is not None:
        full_v = _PLANT_MARK_V * wire.volts_per_unit
        gain = mark.level_v / _PLANT_MARK_V
        stages.append(lambda volts: gain * (full_v - volts if mark.falling else volts))
    if wire.resonance is not None and wire.resonance.frequency_hz < rate_hz / 2.0:
        stages.append(_Resonance(wire.resonance, rate_hz))
    if wire.corner_hz is not None:
        stages.append(_HighPass(wire.corner_hz, rate_hz))
    if charge is not None and charge.reset:
        stages.append(np.zeros_like)
    elif charge is not None:
        highest_v = charge.output_v
        if charge.corner_hz is not None:
            stages.append(_HighPass(charge.corner_hz, rate_hz))
        stages.append(lambda volts: np.clip(volts, -highest_v, highest_v))
    if low_pass is not None and low_pass.corner_hz < rate_hz / 2.0:
        stages.append(_LowPass(low_pass.order, low_pass.corner_hz, rate_hz))
    if delay_s := seconds(wire.delay, rate_hz):
        stages.append(_Delay(delay_s * rate_hz))
    return stages


_PLANT_MARK_V = 5.0
_DELAYED_BY = 24
"""Samples before and behind that tell what lies between two."""


class _Delay:
    """So many samples late; between samples by a windowed sinc, of a short delay by a short one."""

    def __init__(self, samples: float) -> None:
        from scipy import signal

        reach = min(math.floor(samples), _DELAYED_BY)
        first = math.floor(samples) - reach
        at = np.arange(2 * reach + 2) + first - samples
        window = np.interp(at, np.arange(-reach - 1, reach + 2), signal.windows.kaiser(2 * reach + 3, 8.0))
        taps = np.sinc(at) * window
        self._taps, self._held = taps / taps.sum(), np.zeros(first)
        self._state = np.zeros(len(self._taps) - 1)
        self._filtered = signal.lfilter

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        shown, self._state = self._filtered(self._taps, [1.0], volts, zi=self._state)
        joined = np.concatenate([self._held, shown])
        self._held = joined[len(volts) :]
        return joined[: len(volts)]


class _LowPass:
    """An analog Butterworth low-pass as the card samples it, by its impulse response.

    A sum of its poles, each exact; a bilinear one at a card's rate would be too quick by tens of us.
    """

    def __init__(self, order: int, corner_hz: float, rate_hz: float) -> None:
        from scipy import signal

        _, poles, gain = signal.butter(order, math.tau * corner_hz, analog=True, output="zpk")
        residues = [gain / np.prod(pole - np.delete(poles, k)) for k, pole in enumerate(poles)]
        self._decays = np.exp(poles / rate_hz)
        weights = np.array(residues) / rate_hz
        self._weights = weights / np.sum(weights / (1.0 - self._decays)).real  # a level stays what it is
        self._state = np.zeros((order, 1), np.complex128)
        self._filtered = signal.lfilter

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        total = np.zeros(len(volts))
        for k, (weight, decay) in enumerate(zip(self._weights, self._decays, strict=True)):
            shown, self._state[k] = self._filtered([weight], [1.0, -decay], volts, zi=self._state[k])
            total += shown.real
        return total


class _Resonance:
    """A sensor that rings at its own frequency."""

    def __init__(self, own: ResonanceStage, rate_hz: float) -> None:
        from scipy import signal

        omega = 2.0 * rate_hz * math.tan(math.pi * own.frequency_hz / rate_hz)
        poles = [omega**2], [1.0, 2.0 * own.damping_ratio * omega, omega**2]
        self._b, self._a = signal.bilinear(*poles, fs=rate_hz)
        self._state = np.zeros(2)
        self._filtered = signal.lfilter

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        shown, self._state = self._filtered(self._b, self._a, volts, zi=self._state)
        return np.asarray(shown)


class _HighPass:
    """A high-pass of first order with memory."""

    def __init__(self, corner_hz: float, rate_hz: float) -> None:
        from scipy import signal  # it loads most of scipy, and few chains have a filter

        self._filtered = signal.sosfilt
        self._sections = signal.butter(1, corner_hz, "highpass", fs=rate_hz, output="sos")
        self._state = np.zeros((len(self._sections), 2))

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        filtered, self._state = self._filtered(self._sections, volts, zi=self._state)
        return np.asarray(filtered)


Measure: TypeAlias = Callable[[NDArray[np.float64]], NDArray[Any]]
"""Takes consecutive blocks of the plant's row, shape (n,), gives the counter's readings."""

COUNTER_STATES = 2**32  # an NI counter has 32 bits
_HYSTERESIS = 0.2  # of the threshold, to either side
_COUNT_ROUNDING = 1e-6  # of a count: an angle that is a whole number of counts came from a product in floats


@dataclass(frozen=True, slots=True)
class CounterInput:
    """A counter as the client declared it; `measure` begins a measurement on a wire."""

    physical: str
    measure: Callable[[CounterWire], Measure]
    dtype: type[np.generic] = np.uint32


class AngleCount:
    """A quadrature encoder: `decoding` counts a pulse from `initial` on, set to `at_index` by the index mark.

    `at_index` is None where the client leaves the index alone. The mark sits where the wire says, and is
    passed in the middle of a step as well.
    """

    def __init__(self, wire: CounterWire, decoding: int, initial: int, at_index: int | None) -> None:
        self._per_turn = wire.pulses_per_revolution * decoding
        self._way, self._index_at = (-1.0 if wire.backwards else 1.0), wire.index_at
        self._shift = wire.preset + initial
        self._at_index = at_index
        self._origin: int | None = None
        self._last = 0

    def __call__(self, angle: NDArray[np.float64]) -> NDArray[np.uint32]:
        """Return the register at each sample."""
        # A step of the quadrature is counted where the angle passes it, in either direction.
        turned = self._way * (angle - self._index_at)
        place = np.floor(turned * (self._per_turn / math.tau) + _COUNT_ROUNDING).astype(np.int64)
        if self._origin is None:
            self._origin = self._last = int(place[0])
        register = place - self._origin + self._shift  # before any mark
        if self._at_index is not None:
            before = np.concatenate([[self._last], place[:-1]])
            forwards, backwards = place // self._per_turn, -(-place // self._per_turn)
            passed = np.where(
                place >= before, forwards > before // self._per_turn, backwards < -(-before // self._per_turn)
            ) | (place % self._per_turn == 0)
            mark = np.where(place >= before, forwards, backwards) * self._per_turn
            last = np.maximum.accumulate(np.where(passed, np.arange(len(place)), -1))
            if last[-1] >= 0:
                self._origin, self._shift = int(mark[last[-1]]), self._at_index
            register = np.where(last >= 0, place - mark[last] + self._at_index, register)
        self._last = int(place[-1])
        return (register % COUNTER_STATES).astype(np.uint32)


class EdgeCount:
    """Rising edges of a marker so far."""

    def __init__(self, wire: CounterWire) -> None:
        self._low = wire.threshold_v * (1.0 - _HYSTERESIS)
        self._high = wire.threshold_v * (1.0 + _HYSTERESIS)
        self._up: bool | None = None
        self._count = wire.preset

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.uint32]:
        """Return the register at each sample."""
        # The comparator's output: in between it stays as it was.
        decided = np.where(volts >= self._high, 1, np.where(volts <= self._low, 0, -1))
        where = np.maximum.accumulate(np.where(decided >= 0, np.arange(len(volts)), -1))
        up = np.where(where >= 0, decided[where] == 1, bool(self._up))
        edges = np.diff(up.astype(np.int8), prepend=np.int8(up[0] if self._up is None else self._up)) > 0
        counts = self._count + np.cumsum(edges)
        self._up, self._count = bool(up[-1]), int(counts[-1])
        return (counts % COUNTER_STATES).astype(np.uint32)


class PulseFrequency:
    """Frequency in Hz of the last two pulses of a shaft whose speed in rad/s the plant gives.

    It stands at a pulse to begin with, and within a sample turns as at its end. Before the next pulse comes
    the counter is taken to have counted at the same speed already; where none comes any more, it keeps the
    last.
    """

    def __init__(self, wire: CounterWire, sample_rate: float) -> None:
        self._per_rad, self._rate = wire.pulses_per_revolution / math.tau, sample_rate
        self._beyond = 0.0  # the last pulse, in pulses
        self._last = -1.0  # when it came, in samples from the next block on
        self._shown: float | None = None

    def __call__(self, speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the counter holds at each sample."""
        each = np.abs(speed) * (self._per_rad / self._rate)  # pulses in a sample
        place = self._beyond + np.cumsum(each)
        whole = np.floor(place + _COUNT_ROUNDING)
        come = np.diff(whole, prepend=0.0)
        at = np.flatnonzero(come)
        times = at - np.maximum(place - whole, 0.0)[at] / each[at]
        apart = np.diff(times, prepend=self._last)
        held = np.where(come[at] > 1, each[at], 1.0 / apart) * self._rate
        begun = each * self._rate if self._shown is None else np.full(len(speed), self._shown)
        number = np.cumsum(come > 0)
        shown = np.where(number > 0, np.concatenate([[0.0], held])[number], begun)
        if len(at):
            self._last, self._shown = float(times[-1]), float(held[-1])
        self._last -= len(speed)
        self._beyond = float(place[-1] - whole[-1])
        return shown

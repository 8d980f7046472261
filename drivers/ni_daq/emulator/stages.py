"""What lies between a sensor and the card, in motion: charge amplifier, then anti-alias filter."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from drivers.ni_daq.emulator.wiring import ChargeStage, LowPassStage, Wire

Stage: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Takes consecutive blocks in V, shape (n,), and remembers what it has to."""


def stages_of(wire: Wire, rate_hz: float) -> list[Stage]:
    """The stages of a chain, in the order of the signal, all at rest."""
    stages: list[Stage] = []
    if wire.charge is not None:
        stages += _amplifier(wire.charge, rate_hz)
    if wire.low_pass is not None and wire.low_pass.corner_hz < rate_hz / 2.0:
        stages.append(_low_pass(wire.low_pass, rate_hz))
    return stages


def _amplifier(amplifier: ChargeStage, rate_hz: float) -> list[Stage]:
    if amplifier.reset:
        return [np.zeros_like]
    stages: list[Stage] = []
    if amplifier.corner_hz is not None:
        stages.append(_Filter(signal.butter(1, amplifier.corner_hz, "highpass", fs=rate_hz, output="sos")))
    stages.append(lambda volts: np.clip(volts, -amplifier.output_v, amplifier.output_v))
    return stages


def _low_pass(stage: LowPassStage, rate_hz: float) -> Stage:
    return _Filter(signal.butter(stage.order, stage.corner_hz, fs=rate_hz, output="sos"))


class _Filter:
    """A recursive filter with memory."""

    def __init__(self, sections: NDArray[np.float64]) -> None:
        self._sections = sections
        self._state = np.zeros((len(sections), 2))

    def __call__(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        filtered, self._state = signal.sosfilt(self._sections, volts, zi=self._state)
        return np.asarray(filtered)

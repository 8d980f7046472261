"""Phase and mean frequency of the drive, taken from its measurement; nothing else of it reaches the twin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.signals.sine import SineFit, fit_sine
from sim_twin.rigs.impact_beam.model import SineDrive

FREQUENCY_TOLERANCE = 1e-3
"""A twin follows the measured mean frequency within 0.1 % of the scenario's."""
_STARTED = 0.05
_RUNNING_SHARE = 0.5
_SAFE_CYCLES = 0.2 / FREQUENCY_TOLERANCE
_WORST_RESIDUAL = 0.5
"""Rms, as a share of the amplitude: a drive with all the harmonics of the catalogue stays below 0.2."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """`frequency` in Hz and `phase` (rad) of the drive at sample 0.

    `onset` is the sample (fractional) at which the drive began from rest, None where it was running before.
    `trusted` is False where the measurement showed no usable sine and the scenario's own values stand.
    """

    frequency: float
    phase: float
    onset: float | None = None
    trusted: bool = True


def align(force: NDArray[np.floating], sample_rate: float, first_sample: int, drive: SineDrive) -> Alignment:
    """Align to measured drive `force` (N, shape (n,)) that begins at sample `first_sample` of the run."""
    finite = np.nan_to_num(np.asarray(force, dtype=float)) - drive.offset
    level = abs(drive.amplitude)
    if level == 0 or len(finite) == 0 or np.max(np.abs(finite)) < _RUNNING_SHARE * level:
        return Alignment(drive.frequency, 0.0, onset=None, trusted=False)
    begun = int(np.argmax(np.abs(finite) > _STARTED * level))
    period = sample_rate / drive.frequency
    running_before = begun < period / 8
    fit = _fit_growing(finite if running_before else finite[begun:], sample_rate, drive.frequency)
    if running_before and begun > 0 and abs(np.sin(fit.phase)) > 2 * _STARTED:
        # The first samples were at rest where the sine was not: a slow drive that began just then.
        running_before, fit = False, _fit_growing(finite[begun:], sample_rate, drive.frequency)
    steady = finite if running_before else finite[begun:]
    span = FREQUENCY_TOLERANCE * drive.frequency
    frequency = float(np.clip(fit.frequency, drive.frequency - span, drive.frequency + span))
    if frequency != fit.frequency:
        fit = fit_sine(steady, sample_rate, frequency, hold_frequency=True)
    start = first_sample + (0 if running_before else begun)
    phase = (fit.phase - 2 * np.pi * frequency * start / sample_rate) % (2 * np.pi)
    trusted = fit.residual < _WORST_RESIDUAL * level
    if running_before:
        return Alignment(frequency, phase, trusted=trusted)
    return Alignment(frequency, phase, _onset(phase, frequency / sample_rate, start), trusted)


def _fit_growing(force: NDArray[np.floating], sample_rate: float, frequency: float) -> SineFit:
    """Fit a long record from a short one on, so that no start is off by more than a quarter of a cycle."""
    cycles = _SAFE_CYCLES
    while True:
        count = min(len(force), int(cycles * sample_rate / frequency))
        fit = fit_sine(force[:count], sample_rate, frequency)
        if count == len(force):
            return fit
        frequency, cycles = fit.frequency, 2 * cycles


def _onset(phase: float, cycles_per_sample: float, seen: int) -> float:
    """The zero of the sine just before the first sample at which it was seen."""
    cycles = phase / (2 * np.pi) + cycles_per_sample * seen
    return float(seen - (cycles % 1.0) / cycles_per_sample) if cycles % 1.0 < 1 / 8 else float(seen)

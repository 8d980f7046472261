"""Phase and mean frequency of the drive, taken from its measurement; nothing else of it reaches the twin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.signals import fit_sine
from sim_twin.rigs.impact_beam.model import SineDrive

FREQUENCY_TOLERANCE = 1e-3
"""A twin follows the measured mean frequency within 0.1 % of the scenario's."""
_STARTED = 0.05
_RUNNING_SHARE = 0.5


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
    fit = fit_sine(finite if running_before else finite[begun:], sample_rate, drive.frequency)
    if running_before and begun > 0 and abs(np.sin(fit.phase)) > 2 * _STARTED:
        # The first samples were at rest where the sine was not: a slow drive that began just then.
        running_before, fit = False, fit_sine(finite[begun:], sample_rate, drive.frequency)
    steady = finite if running_before else finite[begun:]
    span = FREQUENCY_TOLERANCE * drive.frequency
    frequency = float(np.clip(fit.frequency, drive.frequency - span, drive.frequency + span))
    if frequency != fit.frequency:
        fit = fit_sine(steady, sample_rate, frequency, hold_frequency=True)
    start = first_sample + (0 if running_before else begun)
    phase = (fit.phase - 2 * np.pi * frequency * start / sample_rate) % (2 * np.pi)
    if running_before:
        return Alignment(frequency, phase)
    return Alignment(frequency, phase, onset=_onset(phase, frequency / sample_rate, start))


def _onset(phase: float, cycles_per_sample: float, seen: int) -> float:
    """The zero of the sine just before the first sample at which it was seen."""
    cycles = phase / (2 * np.pi) + cycles_per_sample * seen
    return float(seen - (cycles % 1.0) / cycles_per_sample) if cycles % 1.0 < 1 / 8 else float(seen)

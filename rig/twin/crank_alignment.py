"""Crank angle and mean speed, taken from the encoder or from the once-per-revolution marker."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.twin.alignment import FREQUENCY_TOLERANCE, Alignment, untouched
from sim_twin.rigs.crank_drive import SpeedDrive

_FEWEST_MARKS = 2
MARKED_TURNS = 3.0
"""Turns in which a marker surely shows as many, with one lost."""
_LEAST_TURN = 0.05
"""Revolutions that a record has to show before its speed is believed."""


def align_angle(
    angle: NDArray[Any], sample_rate: float, first_sample: int, drive: SpeedDrive, counts: int = 4096
) -> Alignment:
    """Align to a crank angle (rad, unwrapped, shape (n,)) by an encoder of `counts` a revolution."""
    samples = first_sample + np.arange(len(angle))
    known = np.isfinite(angle)
    # a counter shows the last whole count: on average half a count less than the angle
    centred = np.asarray(angle, dtype=float)[known] + pi / counts
    if len(centred) < 2 or abs(centred[-1] - centred[0]) < _LEAST_TURN * 2 * pi:
        return untouched(drive)
    return _fit(samples[known], centred, sample_rate, drive)  # whole turns stay: the prediction has them too


def align_marker(marker: NDArray[Any], sample_rate: float, first_sample: int, drive: SpeedDrive) -> Alignment:
    """Align to a once-per-revolution marker (V, shape (n,)) that rises at crank angle zero."""
    high = np.asarray(marker, dtype=float)
    level = (np.nanmin(high) + np.nanmax(high)) / 2 if len(high) else 0.0
    rises = np.flatnonzero((high[:-1] < level) & (high[1:] >= level))
    if len(rises) < _FEWEST_MARKS or np.nanmax(high) - np.nanmin(high) < 1.0:
        return untouched(drive)
    share = (level - high[rises]) / (high[rises + 1] - high[rises])
    period = 2 * pi * sample_rate / drive.mean_speed
    at = first_sample + rises + share
    turns = np.round(np.concatenate([[0.0], np.cumsum(np.diff(at) / period)]))
    fit = _fit(at, 2 * pi * turns, sample_rate, drive)
    return replace(fit, phase=fit.phase % (2 * pi))


def _fit(
    samples: NDArray[Any], angle: NDArray[np.float64], sample_rate: float, drive: SpeedDrive
) -> Alignment:
    wanted = drive.mean_speed / (2 * pi)
    slope, _ = np.polyfit(samples - samples[0], angle, 1)
    found = float(slope) * sample_rate / (2 * pi)
    frequency = float(np.clip(found, wanted * (1 - FREQUENCY_TOLERANCE), wanted * (1 + FREQUENCY_TOLERANCE)))
    at_zero = angle - 2 * pi * frequency * samples / sample_rate
    return Alignment(frequency, float(np.mean(at_zero)), trusted=found == frequency)

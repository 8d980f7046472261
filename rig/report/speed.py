"""The crank's speed over a run, as it was derived: its mean, and how it varies about that."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np

from rig.report.record import ORIGINS, RunRecord, Trace
from rig.report.scenario_facts import scenario_facts


@dataclass(frozen=True, slots=True)
class SpeedFigures:
    """In rpm, below zero where the crank turns backwards; `ripple` is the standard deviation.

    `revolutions` is how many were turned at a known speed, in all, whichever way round.
    """

    mean: float
    ripple: float
    lowest: float
    highest: float
    revolutions: float


def speeds(run: RunRecord) -> dict[str, Trace]:
    """Speeds in rpm by whose they are, of which at least one value is known."""
    return {
        run.whose(origin): run.speeds[origin]
        for origin in ORIGINS
        if origin in run.speeds and np.isfinite(run.speeds[origin].values).any()
    }


def speed_figures(speed: Trace) -> SpeedFigures:
    """Figures of a speed of which at least one value is known."""
    known = speed.values[np.isfinite(speed.values)].astype(np.float64)
    mean = float(known.mean())
    return SpeedFigures(
        mean=mean,
        ripple=float(np.std(known, ddof=1)) if len(known) > 1 else nan,
        lowest=float(known.min()),
        highest=float(known.max()),
        revolutions=abs(mean) / 60 * len(known) / speed.sample_rate,
    )


def set_rpm(run: RunRecord) -> float | None:
    """The speed that the scenario asks for; None where it says none."""
    cycle_s = scenario_facts(run.scenario).cycle_s
    return None if cycle_s is None else 60 / cycle_s

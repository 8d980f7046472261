"""What the solver computed, before any sensor: the numbers to compare programs by."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.mechanisms.run import CONTACT, ONSET, PEAK
from sim_twin.mechanisms.simulation import Trace
from sim_twin.rigs.planar_slider_crank.kernel import ANGLE, CRANK_PIN, PISTON_ACCELERATION, PISTON_PIN
from sim_twin.rigs.planar_slider_crank.motion import (
    CENTRED,
    CrankTwin,
    Eccentricity,
    Frames,
    simulation,
    step_limits,
)
from sim_twin.rigs.rig_model import SolverValues
from sim_twin.status import Status

RATE = 51_200.0
_BUDGET_A_SECOND = 2_000_000
Array = NDArray[np.float64]


def solver_values(twin: CrankTwin, settle: float, duration: float) -> SolverValues:
    """First peaks from the start on; the rest over `duration` s after the first `settle` s.

    Forces in N, accelerations of slider and frame in m/s2; None where a joint had no contact. Raises
    SimulationFailed.
    """
    trace, episodes = motion(twin, settle + duration)
    frames, first = Frames(twin.rig, RATE)(trace.outputs), round(settle / trace.step)
    return values_of(trace, episodes, settle) | frame_figures({name: a[first:] for name, a in frames.items()})


def frame_figures(shown: Mapping[str, Array]) -> SolverValues:
    """Rms and largest of the frame's accelerations (m/s2, by channel); of none where there are no samples."""
    values: SolverValues = {}
    for name, row in shown.items():
        values[f"{name}_rms_m_s2"] = float(np.sqrt(np.mean(row**2))) if len(row) else None
        values[f"{name}_peak_m_s2"] = float(np.abs(row).max()) if len(row) else None
    return values


def motion(twin: CrankTwin, seconds: float, at: Eccentricity = CENTRED) -> tuple[Trace, Array]:
    """From theta = 0, journals `at` their places: outputs at RATE, and all contacts, open ones last."""
    limits = step_limits(twin.rig, budget=round(_BUDGET_A_SECOND * max(seconds, 1.0)))
    run = simulation(twin.rig, twin.drive, 0.0, 1 / RATE, limits, at)
    trace = run.advance(round(seconds * RATE))
    if trace.status is not Status.COMPLETED:
        what = f"the crank stopped after {run.time:.6g} s"
        raise SimulationFailed(what, trace.status.advice, trace.status)
    return trace, np.concatenate([trace.episodes, run.open_episodes])


def values_of(trace: Trace, episodes: Array, settle: float) -> SolverValues:
    """The figures of a motion from its start, the statistics without the first `settle` s."""
    first = round(settle / trace.step)
    angle, acceleration = trace.outputs[ANGLE, first:], trace.outputs[PISTON_ACCELERATION, first:]
    turns = (angle[-1] - angle[0]) / (2 * pi) if len(angle) else 0.0
    crank, piston = (episodes[episodes[:, CONTACT] == joint] for joint in (CRANK_PIN, PISTON_PIN))
    return {
        "first_peak_crank_pin_n": _first_peak(crank),
        "first_peak_piston_pin_n": _first_peak(piston),
        "slider_acceleration_rms": float(np.sqrt(np.mean(acceleration**2))) if len(acceleration) else None,
        "onsets_per_revolution_1": _onsets(crank, settle, turns),
        "onsets_per_revolution_2": _onsets(piston, settle, turns),
        "largest_crank_pin_n": _largest(crank, settle),
        "largest_piston_pin_n": _largest(piston, settle),
    }


def _first_peak(episodes: Array) -> float | None:
    return float(episodes[np.argmin(episodes[:, ONSET]), PEAK]) if len(episodes) else None


def _onsets(episodes: Array, settle: float, turns: float) -> float | None:
    return float(np.count_nonzero(episodes[:, ONSET] >= settle) / turns) if turns > 0 else None


def _largest(episodes: Array, settle: float) -> float | None:
    peaks = episodes[episodes[:, ONSET] >= settle, PEAK]
    return float(peaks.max()) if len(peaks) else None

"""What the solver computed, before any sensor: the numbers to compare programs by."""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.mechanisms.run import CONTACT, ONSET, PEAK
from sim_twin.mechanisms.simulation import Trace
from sim_twin.rigs.rig_model import SolverValues
from sim_twin.rigs.spatial_slider_crank.constants import SOCKET
from sim_twin.rigs.spatial_slider_crank.kernel import ANGLE_ROW, SLIDER_SPEED_ROW
from sim_twin.rigs.spatial_slider_crank.motion import STEP_BUDGET, SpatialTwin, simulation, step_limits
from sim_twin.status import Status

RATE = 51_200.0
Array = NDArray[np.float64]


def solver_values(twin: SpatialTwin, settle: float, duration: float) -> SolverValues:
    """First peaks from the start on; the rest over `duration` s after the first `settle` s.

    Forces in N, rms slider acceleration (of its speed at 51.2 kHz) in m/s2. A cycle peak is the largest force
    within a whole turn of the crank, at any of the guide's points or in the socket. None where there is
    nothing to tell. Raises SimulationFailed.
    """
    trace, episodes = motion(twin, settle + duration)
    return values_of(trace, episodes, settle)


def motion(twin: SpatialTwin, seconds: float, step: float = 1 / RATE) -> tuple[Trace, Array]:
    """From crank angle 0: outputs every `step` s, and all contacts, open ones last."""
    limits = step_limits(twin.rig, budget=round(STEP_BUDGET * max(seconds, 1.0)))
    run = simulation(twin.rig, twin.drive, 0.0, step, limits)
    trace = run.advance(round(seconds / step))
    if trace.status is not Status.COMPLETED:
        what = f"the crank stopped after {run.time:.6g} s"
        raise SimulationFailed(what, trace.status.advice, trace.status)
    return trace, np.concatenate([trace.episodes, run.open_episodes])


def values_of(trace: Trace, episodes: Array, settle: float) -> SolverValues:
    """The figures of a motion from its start, the statistics without the first `settle` s."""
    outputs = trace.outputs[:, round(settle / trace.step) :]
    in_socket = episodes[:, CONTACT] == SOCKET
    acceleration = np.diff(outputs[SLIDER_SPEED_ROW]) / trace.step
    values: SolverValues = {
        "first_peak_socket_n": _first_peak(episodes[in_socket]),
        "first_peak_guide_n": _first_peak(episodes[~in_socket]),
        "slider_acceleration_rms": float(np.sqrt(np.mean(acceleration**2))) if len(acceleration) else None,
    }
    angle = outputs[ANGLE_ROW]
    turns = (angle[-1] - angle[0]) / (2 * pi) if len(angle) else 0.0
    for name, of, force in (
        ("socket", in_socket, outputs[SOCKET]),
        ("guide", ~in_socket, outputs[:SOCKET].max(axis=0)),
    ):
        onsets = np.count_nonzero(episodes[of, ONSET] >= settle)
        values[f"onsets_per_revolution_{name}"] = float(onsets / turns) if turns > 0 else None
        peaks = cycle_peaks(force, angle)
        values[f"cycle_peak_{name}_mean_n"] = float(peaks.mean()) if len(peaks) else None
        values[f"cycle_peak_{name}_sd_n"] = float(peaks.std(ddof=1)) if len(peaks) > 1 else None
    return values


def cycle_peaks(force: Array, angle: Array) -> Array:
    """Largest `force` in each whole turn of the crank `angle` (rad, growing), both of shape (n,)."""
    turn = np.floor(angle / (2 * pi)).astype(int)
    starts = np.flatnonzero(np.diff(turn)) + 1
    if len(starts) < 2:
        return np.zeros(0)
    return np.asarray(np.maximum.reduceat(force[: starts[-1]], starts[:-1]))


def _first_peak(episodes: Array) -> float | None:
    return float(episodes[np.argmin(episodes[:, ONSET]), PEAK]) if len(episodes) else None

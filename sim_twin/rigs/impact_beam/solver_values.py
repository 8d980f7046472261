"""What the solver computed, before any sensor: the numbers to compare programs by."""

from __future__ import annotations

import numpy as np

from daq.errors import SimulationFailed
from daq.signals.impacts import HalfCycles, half_cycles
from sim_twin.rigs.impact_beam.assembly import LOWER, UPPER, assemble
from sim_twin.rigs.impact_beam.truth import BeamTwin
from sim_twin.rigs.rig_model import RunFigures, SolverValues
from sim_twin.status import Status
from sim_twin.switched.simulation import Simulation, Trace

RATE = 204_800.0
_ORDERS = (0, 1, 2, 3)
_FINER, _MARGIN, _AT_ONCE = 64, 64, 1 << 16
_LONGEST_CONTACT = 5e-3
"""s; a first contact from rest is an impact, and impacts last some tenths of a millisecond."""


def solver_values(twin: BeamTwin, settle: float, duration: float) -> SolverValues:
    """First contact from rest, and mean and deviation of *first* and *max* per half cycle.

    Over `duration` s after the first `settle` s. Forces in N, times in s; None where there was no contact.
    Raises SimulationFailed.
    """
    return dict(run_figures(twin, 0.0, settle, duration).values)


def run_figures(twin: BeamTwin, phase: float, settle: float, duration: float) -> RunFigures:
    """The same from `phase` rad of the drive on, with the peaks of all half cycles."""
    simulation = _driven(twin, phase, RATE)
    trace = simulation.advance(round((settle + duration) * RATE))
    status = Status.COMPLETED
    if not (np.isfinite(simulation.state).all() and np.isfinite(trace.outputs).all()):
        status = Status.DIVERGED
    elif trace.switches > len(trace.switch_times):
        status = Status.STEPS_EXHAUSTED
    if status is not Status.COMPLETED:
        raise SimulationFailed("the impact beam's motion was not computed to its end", status.advice, status)
    start = round(settle * RATE)
    cycles = half_cycles(trace.outputs[0, start:], trace.outputs[1, start:], RATE)
    contact_s, peak_n = _first_contact(trace)
    if contact_s is not None:
        # once more up to it on a grid so fine that a damper's jump at the onset is in the peak
        fine = _driven(twin, phase, _FINER * RATE)
        while (before := round(contact_s * _FINER * RATE) - _MARGIN - fine.samples) > 0:
            fine.advance(min(before, _AT_ONCE))
        _, peak_n = _first_contact(fine.advance(round(_LONGEST_CONTACT * _FINER * RATE)))
    return figures_of(cycles, peak_n, contact_s)


def figures_of(cycles: HalfCycles, first_peak_n: float | None, first_contact_s: float | None) -> RunFigures:
    """The figures of a motion's half cycles and its first contact (N, s)."""
    values: SolverValues = {
        "first_peak_n": first_peak_n,
        "first_contact_s": first_contact_s,
        "half_cycles": len(cycles),
    }
    for name, peaks in (("first", cycles.first_n), ("max", cycles.max_n)):
        values[f"{name}_mean_n"] = float(np.mean(peaks)) if len(peaks) else None
        values[f"{name}_sd_n"] = float(np.std(peaks, ddof=1)) if len(peaks) > 1 else None
    return RunFigures(Status.COMPLETED, values, {"first_n": cycles.first_n, "max_n": cycles.max_n})


def _driven(twin: BeamTwin, phase: float, rate: float) -> Simulation:
    simulation = Simulation(assemble(twin.rig, _ORDERS), 1 / rate)
    simulation.drive(twin.drive.phasors(), 2 * np.pi * twin.drive.frequency, phase)
    return simulation


def _first_contact(trace: Trace) -> tuple[float | None, float | None]:
    """Time of the first contact and the largest force before it ends."""
    contacts = np.flatnonzero(np.isin(trace.switch_regimes % 3, (UPPER, LOWER)))
    if not len(contacts):
        return None, None
    first = int(contacts[0])
    side = int(trace.switch_regimes[first] % 3) - 1
    begin = float(trace.switch_times[first])
    ends = np.flatnonzero(trace.switch_regimes[first:] % 3 != side + 1)
    end = float(trace.switch_times[first + ends[0]]) if len(ends) else np.inf
    low = int(np.ceil((begin - trace.start) / trace.step))
    high = int(min(np.ceil((end - trace.start) / trace.step), trace.outputs.shape[1]))
    force = trace.outputs[side, low:high]
    if not len(force):
        return begin, None
    k = int(np.argmax(force))
    if not 0 < k < len(force) - 1:
        return begin, float(force[k])
    # refined by the parabola through its three highest neighbours
    before, top, after = force[k - 1 : k + 2]
    bend = before - 2 * top + after
    return begin, float(top - (after - before) ** 2 / (8 * bend)) if bend < 0 else float(top)

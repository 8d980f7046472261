"""The reference values of the impact beam, ours beside those of the physics text.

First peaks and times of contact of the very first contact from rest; means and deviations of the first and of
the largest peak of a half cycle after 1 s. All of the solver's force, steel, damping 0.01.

Usage: python -m benchmarks.reference_values
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from daq.signals.impacts import HalfCycles, half_cycles
from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.switched.simulation import Simulation

RATE = 204_800.0
_SETTLE = 1.0  # s


@dataclass(frozen=True, slots=True)
class Reference:
    """One row of the text: drive Hz, clearance mm, time ms, forces N (mean and deviation)."""

    frequency: float
    g_mm: float
    time_ms: float
    peak: float
    first: tuple[float, float]
    largest: tuple[float, float]


TABLE = (
    Reference(5, 0.127, 7.0409, 18.381, (23.07, 1.6), (29.51, 3.5)),
    Reference(5, 0.254, 8.8606, 28.910, (41.61, 2.0), (53.20, 6.1)),
    Reference(5, 0.508, 11.1582, 45.716, (68.65, 2.3), (91.92, 4.1)),
    Reference(20, 0.127, 4.4826, 28.895, (34.86, 7.0), (39.57, 5.8)),
    Reference(20, 0.254, 5.6468, 45.255, (62.50, 11.3), (70.32, 9.6)),
    Reference(20, 0.508, 7.1259, 70.778, (88.59, 22.0), (98.80, 19.6)),
)
HALF_CYCLES = {5: 1200, 20: 1600}


def simulation(row: Reference, rate: float) -> Simulation:
    """The rig of a row, at rest."""
    made = Simulation(assemble(replace(nominal(), clearance=row.g_mm * 1e-3), (1,)), 1 / rate)
    made.drive(SineDrive(9.0, row.frequency).phasors()[1:2], 2 * np.pi * row.frequency)
    return made


def first_contact(row: Reference, rate: float) -> tuple[float, float]:
    """Time in ms and peak in N of the first contact."""
    trace = simulation(row, rate).advance(round(0.013 * rate))
    begin, end = (trace.switch_times[:2] / trace.step).astype(int)
    return float(trace.switch_times[0] * 1e3), float(trace.outputs[0, begin : end + 2].max())


def after_a_second(row: Reference) -> tuple[HalfCycles, float]:
    """Half cycles, and simulated seconds per second of wall clock."""
    run, count = simulation(row, RATE), HALF_CYCLES[round(row.frequency)]
    run.advance(round(_SETTLE * RATE))
    seconds = (count + 2) / 2 / row.frequency
    begin = time.perf_counter()
    upper, lower, _ = run.advance(round(seconds * RATE)).outputs
    wall = time.perf_counter() - begin
    return half_cycles(upper, lower, RATE), seconds / wall


def _deviation(found: float, expected: float) -> str:
    return f"{found:8.3f} {expected:8.3f} {100 * (found / expected - 1):+6.2f} %"


def main() -> None:
    """Print both tables."""
    print("drive   g          time of contact, ms           first peak at 204.8 kHz, N   at 3.3 MHz, N")
    print("Hz      mm         ours     text         us      ours     text     dev       ours     dev")
    for row in TABLE:
        time_ms, peak = first_contact(row, RATE)
        _, fine = first_contact(row, 16 * RATE)
        late = 1e3 * (time_ms - row.time_ms)
        print(
            f"{row.frequency:<7g} {row.g_mm:<7g} {time_ms:9.5f} {row.time_ms:8.4f} {late:+10.2f}"
            f"   {_deviation(peak, row.peak)}   {fine:8.3f} {100 * (fine / row.peak - 1):+6.3f} %"
        )
    print(
        "\ndrive   g       half   first of a half cycle, N            largest in it, N               sim-s/s"
    )
    print("Hz      mm      cycles" + 2 * "    ours     text     dev     +-  (text)")
    for row in TABLE:
        found, speed = after_a_second(row)
        parts = (
            f"{_deviation(peaks.mean(), text[0])} {peaks.std():5.1f} ({text[1]:4.1f})"
            for peaks, text in ((found.first_n, row.first), (found.max_n, row.largest))
        )
        print(f"{row.frequency:<7g} {row.g_mm:<7g} {len(found):5d}  {'  '.join(parts)}   {speed:5.0f}")


if __name__ == "__main__":
    main()

"""The reference values of the planar slider-crank, ours beside those of the physics text.

First peaks at three tolerances; statistics of 12 runs of 12 s that start 1e-9 m apart; and how the rms of the
slider's acceleration answers to clearance, speed, friction and restitution.

Usage: python -m benchmarks.crank_values
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_twin.mechanisms.run import CONTACT, PEAK
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank, nominal
from sim_twin.rigs.planar_slider_crank.motion import CENTRED, TOLERANCE, simulation, step_limits
from sim_twin.rigs.planar_slider_crank.solver_values import motion, values_of
from sim_twin.twin import Twin

RPM = np.pi / 30
FIRST_PEAKS = (9079.3, 14918.8)
RUNS, SECONDS, OFFSET = 12, 12.0, 1e-9
# Key of the solver's values, text's mean and deviation.
STATISTICS = (
    ("slider_acceleration_rms", 107.8, 2.8),
    ("onsets_per_revolution_1", 26.8, 1.4),
    ("onsets_per_revolution_2", 30.3, 1.5),
    ("largest_crank_pin_n", 10.6e3, 0.7e3),
    ("largest_piston_pin_n", 8.3e3, 0.8e3),
)
RIG = nominal()
# What differs, the rig, speed in rpm, the text's rms in m/s2.
SENSITIVITIES = (
    ("c = 0.1 mm", replace(RIG, clearance_1=1e-4, clearance_2=1e-4), 200.0, 56.0),
    ("c = 2 mm", replace(RIG, clearance_1=2e-3, clearance_2=2e-3), 200.0, 156.0),
    ("150 rpm", RIG, 150.0, 64.0),
    ("mu = 0", replace(RIG, friction=0.0), 200.0, 120.0),
    ("mu = 0.1", replace(RIG, friction=0.1), 200.0, 79.0),
    ("e = 0.5", replace(RIG, restitution=0.5), 200.0, 88.0),
    ("e = 0.7", replace(RIG, restitution=0.7), 200.0, 92.0),
    ("e = 0.95", replace(RIG, restitution=0.95), 200.0, 137.0),
)


def first_peaks(tolerance: float) -> tuple[float, float]:
    """First peaks at crank pin and piston pin, N."""
    run = simulation(RIG, SpeedDrive(200 * RPM), 0.0, 1e-4, step_limits(RIG, tolerance))
    episodes = run.advance(1000).episodes
    crank, piston = (episodes[episodes[:, CONTACT] == joint][0, PEAK] for joint in (0, 1))
    return float(crank), float(piston)


def runs(
    rig: PlanarSliderCrank, rpm: float, count: int, seconds: float, settle: float
) -> list[dict[str, float]]:
    """Solver's values of runs that start 1e-9 m apart, crank pin against bearing in x."""
    found = []
    for k in range(count):
        at = replace(CENTRED, x=np.array([k * OFFSET, 0.0]))
        trace, episodes = motion(Twin(rig, SpeedDrive(rpm * RPM)), seconds, at)
        values = values_of(trace, episodes, settle)
        found.append({key: float("nan") if v is None else float(v) for key, v in values.items()})
    return found


def main() -> None:
    """Print the three tables."""
    print(f"first peaks, text {FIRST_PEAKS[0]} and {FIRST_PEAKS[1]} N")
    for tolerance in (10 * TOLERANCE, TOLERANCE, TOLERANCE / 10, TOLERANCE / 1000):
        peaks = first_peaks(tolerance)
        errors = [100 * (peak / text - 1) for peak, text in zip(peaks, FIRST_PEAKS, strict=True)]
        print(
            f"tolerance {tolerance:6.0e}: {peaks[0]:9.2f} N {errors[0]:+7.3f} %"
            f"  {peaks[1]:9.2f} N {errors[1]:+7.3f} %"
        )
    print(f"\n{RUNS} runs of {SECONDS:g} s:  mean    sd    text    sd   off by (text's sd)")
    # Peaks of the start, which every run shares, are no statistics: a tenth of a second is left out.
    sample = runs(RIG, 200.0, RUNS, SECONDS, 0.1)
    for key, mean, deviation in STATISTICS:
        ours = np.array([values[key] for values in sample])
        off = (ours.mean() - mean) / deviation
        print(f"{key:26s}{ours.mean():9.1f} {ours.std(ddof=1):6.1f} {mean:8.1f} {deviation:5.1f} {off:+6.2f}")
    print("\nrms slider acceleration, m/s2, and onsets a revolution, 3 runs of 30 s:  ours    text")
    for name, rig, rpm, text in SENSITIVITIES:
        sample = runs(rig, rpm, 3, 30.0, 0.1)
        rms, one, two = (np.mean([values[key] for values in sample]) for key, _, _ in STATISTICS[:3])
        print(
            f"{name:12s} {rms:7.1f} {text:7.0f} {100 * (rms / text - 1):+6.1f} %"
            f"   onsets {one:5.1f} {two:5.1f}"
        )


if __name__ == "__main__":
    main()

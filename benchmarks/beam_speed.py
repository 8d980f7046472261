"""The beam's solvers against Exudyn: the same modal beam, the same accuracy asked for, one core, one run.

First the peaks of the first contact, ours and Exudyn's at an accurate setting, for the six drives and
clearances of the reference table. Then every way of Exudyn that reaches the first peak within 0.5 % is
timed, and ours are held against the fastest of them, run about, several times: a single run with both
forces recorded at 204.8 kHz, an ensemble of 64 different twins on lanes with its force recorded at the same
rate, and the same with that effect in which makes it slowest. Times are of the processor: what else runs on
the machine counts for neither.

Needs the optional extra `peers`. Usage: python -m benchmarks.beam_speed [repetitions]
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import ModuleType

import numpy as np

from benchmarks.exudyn_beam import METHODS, Turned, first_peak, load_exudyn, run_exudyn, turned_beam
from sim_twin.effects import Effect
from sim_twin.lanes.lanes import Lanes
from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.effects import EFFECTS
from sim_twin.rigs.impact_beam.lanes import beam_lanes
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive, nominal
from sim_twin.rigs.impact_beam.truth import BeamTwin
from sim_twin.switched.simulation import Simulation
from sim_twin.twin import Twin

REFERENCE = (
    (5, 0.127, 18.381),
    (5, 0.254, 28.910),
    (5, 0.508, 45.716),
    (20, 0.127, 28.895),
    (20, 0.254, 45.255),
    (20, 0.508, 70.778),
)
"""Drive in Hz, clearance in mm, first peak in N."""
TIMED = REFERENCE[3]
TOLERANCE = 0.005
RATE = 204_800.0
ACCURATE = ("GeneralizedAlpha", 0.5)
_ENDS_BY = 0.012  # s
_PEER_SECONDS, _BLOCK = 0.4, 8192
_TWINS = 64


@dataclass(slots=True)
class Contender:
    """One of ours: `advance` by a block of `seconds` in all; ratios to the best of Exudyn's against `bar`."""

    name: str
    advance: Callable[[int], object]
    seconds: float
    bar: float
    ratios: list[float] = field(default_factory=list)

    def speed(self) -> float:
        """Simulated s per s of the processor, over about a third of a second."""
        begin, blocks = time.process_time(), 0
        while (spent := time.process_time() - begin) < 0.3:
            self.advance(_BLOCK)
            blocks += 1
        return blocks * self.seconds / spent


def rig_of(row: tuple[float, float, float]) -> tuple[ImpactBeam, SineDrive]:
    """Rig and drive of a row of the reference table."""
    return replace(nominal(), clearance=row[1] * 1e-3), SineDrive(9.0, row[0])


def single(row: tuple[float, float, float], rate: float = RATE) -> Simulation:
    """The event-driven solver, at rest."""
    rig, drive = rig_of(row)
    simulation = Simulation(assemble(rig, (1,)), 1 / rate)
    simulation.drive(drive.phasors()[1:2], 2 * np.pi * drive.frequency)
    return simulation


def ensemble(effect: Effect | None = None) -> Lanes:
    """Twins that differ in clearance, stiffness and phase, with `effect` in the middle of its range."""
    rng = np.random.default_rng(7)
    rig, drive = rig_of(TIMED)
    twins: list[BeamTwin] = []
    for _ in range(_TWINS):
        own = replace(
            rig,
            clearance=rig.clearance * rng.normal(1.0, 0.02),
            contact_stiffness=rig.contact_stiffness * rng.normal(1.0, 0.05),
        )
        twin = Twin(own, drive)
        twins.append(twin if effect is None else effect.change(twin, middle(effect)))
    return beam_lanes(twins, RATE, list(rng.uniform(0, 2 * np.pi, _TWINS)))


def middle(effect: Effect) -> dict[str, float]:
    """Each parameter in the middle of its first interval."""
    return {each.name: sum(each.intervals[0]) / 2 for each in effect.parameters}


def slowest_effect() -> Effect:
    """Print the speed of the ensemble with each effect of the rig; return the slowest.

    Effects of sensors and clocks leave the motion as it is.
    """
    speeds: dict[str, float] = {}
    effects = {name: effect for name, effect in EFFECTS.items() if not effect.channels}
    for name, effect in effects.items():
        lanes = Contender(name, ensemble(effect).advance, _TWINS * _BLOCK / RATE, 0.0)
        lanes.speed()
        speeds[name] = max(lanes.speed() for _ in range(2))
        print(f"  ensemble with {name:22s} {speeds[name]:8.0f} sim-s/s", flush=True)
    return effects[min(speeds, key=lambda name: speeds[name])]


def compare_first_peaks(exu: ModuleType) -> None:
    """Print ours at 3.3 MHz, Exudyn's at its accurate setting and their difference for the whole table."""
    print(f"first peak, N; Exudyn with {ACCURATE[0]}, {ACCURATE[1]:g} us")
    for row in REFERENCE:
        ours = first_peak(single(row, 16 * RATE).advance(round(_ENDS_BY * 16 * RATE)).outputs[0])
        lanes = beam_lanes([Twin(*rig_of(row))], RATE).advance(round(_ENDS_BY * RATE))
        _, force = run_exudyn(exu, turned_beam(*rig_of(row)), ACCURATE, _ENDS_BY, watched=True)
        theirs = first_peak(force)
        print(
            f"  {row[0]:2g} Hz {row[1]:5.3f} mm: reference {row[2]:.3f}, ours {ours:.3f}, Exudyn {theirs:.3f}"
            f" ({100 * (ours / theirs - 1):+.3f} %); lanes at 204.8 kHz {first_peak(lanes[0, 0]):.3f}"
        )


def accurate_methods(exu: ModuleType, beam: Turned) -> list[tuple[str, float]]:
    """Print the first peak and one speed of each method; return those within the tolerance, fastest first."""
    speeds: dict[tuple[str, float], float] = {}
    for method in METHODS:
        _, force = run_exudyn(exu, beam, method, _ENDS_BY, watched=True)
        peak = first_peak(force)
        speed = max(_PEER_SECONDS / run_exudyn(exu, beam, method, _PEER_SECONDS, False)[0] for _ in range(2))
        within = abs(peak / TIMED[2] - 1) < TOLERANCE
        name, error = f"Exudyn {method[0]} {method[1]:g} us", 100 * (peak / TIMED[2] - 1)
        remark = "" if within else ", too far off"
        print(f"  {name:32s} {peak:8.3f} N {error:+6.2f} % {speed:8.2f} sim-s/s{remark}", flush=True)
        if within:
            speeds[method] = speed
    return sorted(speeds, key=lambda method: -speeds[method])


def measure(
    ours: list[Contender], exu: ModuleType, beam: Turned, methods: list[tuple[str, float]], repetitions: int
) -> None:
    """Run ours and the best of Exudyn's in turn."""
    for _ in range(repetitions):
        before = [each.speed() for each in ours]
        peer = max(
            _PEER_SECONDS / run_exudyn(exu, beam, method, _PEER_SECONDS, False)[0] for method in methods
        )
        speeds = [(first + each.speed()) / 2 for first, each in zip(before, ours, strict=True)]
        for each, speed in zip(ours, speeds, strict=True):
            each.ratios.append(speed / peer)
        print(
            f"  Exudyn {peer:6.2f}; " + ", ".join(f"{speed:.0f}" for speed in speeds) + " sim-s/s", flush=True
        )


def main(repetitions: int) -> int:
    """Print the tables and the ratios; return 0 if each median reaches its bar."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    exu, beam = load_exudyn(), turned_beam(*rig_of(TIMED))
    compare_first_peaks(exu)
    print(f"speed: steel, {TIMED[0]:g} Hz, g {TIMED[1]:g} mm, 15 modes, one core; Exudyn {exu.__version__}")
    methods = accurate_methods(exu, beam)[:2]
    slowest = slowest_effect()
    ours = [
        Contender("single run", single(TIMED).advance, _BLOCK / RATE, 30.0),
        Contender("ensemble", ensemble().advance, _TWINS * _BLOCK / RATE, 100.0),
        Contender(f"ensemble, {slowest.name}", ensemble(slowest).advance, _TWINS * _BLOCK / RATE, 20.0),
    ]
    print("in turn: " + ", ".join(each.name for each in ours))
    for each in ours:
        each.speed()
    measure(ours, exu, beam, methods, repetitions)
    for each in ours:
        median, low, high = statistics.median(each.ratios), min(each.ratios), max(each.ratios)
        print(f"{each.name}: ratio median {median:.1f}, range {low:.1f} to {high:.1f}; bar {each.bar:g}")
    return 0 if all(statistics.median(each.ratios) >= each.bar for each in ours) else 1


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 7))

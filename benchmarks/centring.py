"""How well `rattle centre` holds a beam's tip in the middle, on healthy rigs drawn by seed.

Three beams (shaker, shaker without damping, clamped aluminium), each with a rest position within 70 % of the
clearance that the search does not know. What it finds is judged by the drawn rig's own numbers.

Usage: python -m benchmarks.centring [rigs of each beam, 8 without]
Returns 1 if a tip is held further than 5 % of its clearance from the middle: 2 % are the search's own, 1 %
each those of the drive's amplitude and of the beam's parts.
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np

from benchmarks.driven_beam import drawn_beam
from drivers.scpi.settings import GeneratorSettings
from rig.files.bench import embedded_bench
from rig.files.scenario import Scenario, parse_scenario
from rig.session.centring import centre_beam, plan_of

BAR: Final = 0.05
"""Of the clearance."""
FARTHEST: Final = 0.7
BEAMS: Final = {
    "on a shaker": 'shaker_stiffness = "3 kN/m"\nshaker_damping = "20 N s/m"\nshaker_mass = "20 g"',
    "on a shaker without damping": 'shaker_stiffness = "3 kN/m"',
    "clamped aluminium": 'beam = "aluminium"\nclearance = "0.254 mm"',
}


def scenario(model: str) -> Scenario:
    """A scenario with these lines under [model]."""
    return parse_scenario(
        f'rig = "impact_beam"\n[model]\n{model}\n[drive]\nfrequency = "20 Hz"\n'
        '[acquisition]\nsample_rate = "51.2 kHz"\nduration = "1 s"\n'
    )


def centred(wanted: Scenario, share: float, seed: int) -> tuple[float, int]:
    """How far from the middle a tip is held that rests at a `share` of the clearance, in shares of it.

    With the number of offsets that were tried.
    """
    bench = embedded_bench()
    plan = plan_of(wanted, bench)
    per_volt = bench.the(GeneratorSettings).force_per_volt
    beam = drawn_beam(wanted, per_volt, seed, share * plan.clearance)
    beam.arm_sine(plan.frequency, plan.sine.least / per_volt, 0.0, triggered=False)
    beam.start()
    middle = centre_beam(beam, plan)
    return beam.off_centre(middle.offset), middle.probes


def main(rigs: int = 8) -> int:
    """Print the accuracy on each beam and the worst of all."""
    worst = 0.0
    for number, (name, model) in enumerate(BEAMS.items()):
        rng = np.random.default_rng(number)
        found = [
            centred(scenario(model), float(rng.uniform(-FARTHEST, FARTHEST)), 100 * number + seed)
            for seed in range(rigs)
        ]
        off, probes = (np.array(column) for column in zip(*found, strict=True))
        worst = max(worst, float(abs(off).max()))
        print(
            f"{name:28s} {rigs} rigs: held within {abs(off).max():.1%} of the clearance from the middle, "
            f"rms {np.sqrt(np.mean(off**2)):.1%}, {probes.mean():.0f} offsets (at most {probes.max()})"
        )
    print(f"worst of {rigs * len(BEAMS)} rigs {worst:.1%} of the clearance, bar {BAR:.0%}")
    return int(worst > BAR)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2])))

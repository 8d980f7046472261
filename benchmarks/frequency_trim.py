"""How far the beam's drive is off its frequency, as it comes and after `rattle run` has corrected it.

Healthy rigs drawn by seed: generator and card have clocks of their own (0.02 %). As in a run, the drive is
measured while it settles, the generator is told what corrects it, and the record is fitted.

Usage: python -m benchmarks.frequency_trim [rigs at each frequency, 10 without]
Returns 1 if a corrected record is further off than 2 parts in 10,000.
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np

from benchmarks.driven_beam import drawn_beam
from drivers.scpi.settings import GeneratorSettings
from rig.files.bench import embedded_bench
from rig.files.scenario import Scenario, parse_scenario
from rig.session.drive import Shaker
from rig.session.frequency import ON_THEIR_WAY_S, TOLERANCE, DriveMeter, FrequencyHold

HERTZ: Final = (5.0, 20.0, 100.0)
SETTLE_S: Final = 1.0
RECORD_S: Final = 5.0
CHANNEL: Final = "drive.force"


def scenario(hertz: float) -> Scenario:
    """The steel beam at 9 N."""
    return parse_scenario(
        f'rig = "impact_beam"\n[drive]\nfrequency = "{hertz:g} Hz"\n'
        f'[acquisition]\nsample_rate = "51.2 kHz"\nsettle = "{SETTLE_S:g} s"\nduration = "{RECORD_S:g} s"\n'
    )


def offs(wanted: Scenario, seed: int) -> tuple[float, float]:
    """What the drive is off before and after, as shares of the frequency."""
    per_volt, hertz = embedded_bench().the(GeneratorSettings).force_per_volt, wanted.drive.frequency
    beam = drawn_beam(wanted, per_volt, seed)
    motion = Shaker(beam, wanted.drive, per_volt, beam.wait)
    motion.arm(soft=True)
    motion.start(soft=True)
    beam.wait(ON_THEIR_WAY_S)
    hold = FrequencyHold(CHANNEL, hertz, beam.sample_rate)
    hold.begin()
    hold.take(beam.measured(hold.measured_s(SETTLE_S))[CHANNEL])
    found = hold.end()
    if found.correctable:
        motion.trim(found.off)
    beam.wait(ON_THEIR_WAY_S)
    record = DriveMeter(hertz, beam.sample_rate)
    record.add(beam.measured(RECORD_S)[CHANNEL])
    return beam.really.drive.frequency - 1.0, record.result().off


def main(rigs: int = 10) -> int:
    """Print both for each frequency."""
    worst = 0.0
    for hertz in HERTZ:
        each = np.array([offs(scenario(hertz), seed) for seed in range(rigs)])
        (before, after), (most_before, most) = np.sqrt(np.mean(each**2, axis=0)), abs(each).max(axis=0)
        worst = max(worst, float(most))
        print(
            f"{hertz:5g} Hz, {rigs} rigs: {before:.1e} off before (rms; at most {most_before:.1e}), "
            f"{after:.1e} after (at most {most:.1e})"
        )
    print(f"worst after correction {worst:.1e}, bar {TOLERANCE:.0e}")
    return int(worst > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2])))

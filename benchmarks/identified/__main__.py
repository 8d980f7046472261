"""Whether `rattle identify` finds the values of rigs that lie far from what their scenarios say.

Rigs are those of the blind check's truth engines, which share nothing with the twin. `rigs` draws values ten
times as far off as healthy rigs lie, records two runs of each and has `rattle identify` look for them, by its
own file and by `rattle gap` on further runs; `effects` hides one effect in each of the rigs that were
identified, and in a nominal one, and has `rattle diagnose` name it: in one that was refused it is missed;
`healthy` records healthy rigs of tolerances twice as wide and counts those that `rattle diagnose` takes for
others, with and without what `rattle calibrate --spread` learnt of five others.

Every rig's result is a file in benchmarks/measured/identified, with the commit and a digest of what of the
program its step hangs on, and of the truth engines: those of one digest add up, over seeds too, and what is
there is not done again. A search that was stopped begins anew, so that its time is all of it; one that
takes longer than 20 minutes is a refusal. What ends otherwise, by a signal or an error of the program, is
told and not kept. `score` prints what they come to, and how many
of other digests it leaves out. The gap afterwards is at most its bar where that of every rig is that was not
refused, and one that could not be measured is not; no rig may be refused, and none may take longer than its
bar says. Returns 1 where a figure misses its bar, or a kind of rig has less than twenty results of a step.

Usage: python -m benchmarks.identified {rigs,effects,healthy,score} DIR [--more N] [--only RIG] [--count N]
    [--seed 1] [--results FOLDER]
"""

from __future__ import annotations

import argparse
import sys
import traceback
from pathlib import Path

from benchmarks.blind.command import ROOT, end_with_children
from benchmarks.identified.rigs import FREE, RIGS_A_KIND, STEPS, Case, results_in
from benchmarks.identified.score import score

RESULTS = ROOT / "benchmarks" / "measured" / "identified"


def main(arguments: list[str] | None = None) -> int:
    """Do what the command line says."""
    end_with_children()
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identified", description=__doc__)
    parser.add_argument("step", choices=(*STEPS, "score"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--count", type=int, default=RIGS_A_KIND, help="rigs a kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=FREE)
    parser.add_argument("--more", type=int, default=1000, help="do at most so many")
    asked = parser.parse_args(arguments)
    results = results_in(asked.results)
    if asked.step == "score":
        return 0 if score(results) else 1
    within = asked.folder / results[asked.step].digest
    every = [
        Case(rig, number, asked.seed, within, results)
        for number in range(asked.count)
        for rig in ((asked.only,) if asked.only else FREE)
    ]
    open_ones = [case for case in every if case.found(asked.step) is None]
    if asked.step == "effects":  # in rigs that were looked for
        open_ones = [case for case in open_ones if case.found("rigs") is not None]
    done = 0
    for case in open_ones:
        if done >= asked.more:
            break
        if results_in(asked.results)[asked.step].digest != results[asked.step].digest:
            raise SystemExit("the program has changed since this began")
        try:
            STEPS[asked.step](case)
            done += 1
        except Exception:  # one of sixty
            traceback.print_exc()
    return 0 if score(results) else 1


if __name__ == "__main__":
    sys.exit(main())

"""The blind check: `python -m benchmarks.blind all DIR --seed S`, or its steps one by one.

`make` draws all campaigns, seals the answers and records; `diagnose` runs `rattle diagnose` on each; `oracle`
measures what the true effects close; `score` opens the answers and prints. Every step takes a part of the
campaigns (sets, rigs, a share of each) and goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from benchmarks.blind.campaigns import chosen, draw_campaigns
from benchmarks.blind.engines import engines
from benchmarks.blind.make import discard_logs, make
from benchmarks.blind.runner import diagnose_all
from benchmarks.blind.score import measure_truths, score
from benchmarks.blind.seal import SealBroken, sealed, unseal
from benchmarks.blind.sets import RIGS, SETS

_STEPS = ("make", "diagnose", "oracle", "score", "all")


def main() -> int:
    """Do what the command line says; 1 if a bar is missed, 2 on a broken seal."""
    arguments = _arguments()
    folder, step = arguments.folder, arguments.step
    met = True
    try:
        if step in ("make", "all"):
            campaigns = sealed(folder, arguments.seed, partial(draw_campaigns, engines=engines()))
        else:
            campaigns = unseal(folder)
        part = chosen(campaigns, arguments.sets, arguments.rigs, arguments.share, arguments.each)
        if step in ("make", "all"):
            make(folder, campaigns, part)
        if step in ("diagnose", "all"):
            names = arguments.only or [each.name for each in part]
            diagnose_all(folder, names, arguments.budget, arguments.effort)
        if step == "oracle":
            measure_truths(folder, part)
        if step in ("score", "all"):
            met = score(folder, part, arguments.quick)
    except SealBroken as error:
        print(error, file=sys.stderr)
        return 2
    if step == "all" and arguments.discard_logs:
        for campaign in part:
            discard_logs(folder, campaign)
    return 0 if met else 1


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__)
    parser.add_argument("step", choices=_STEPS)
    parser.add_argument("folder", type=Path, help="where everything of one check lies")
    parser.add_argument("--seed", type=int, default=1, help="draws the campaigns")
    parser.add_argument("--sets", nargs="+", choices=tuple(SETS), default=tuple(SETS))
    parser.add_argument("--rigs", nargs="+", choices=RIGS, default=RIGS)
    parser.add_argument("--share", type=float, default=1.0, help="of each set, from its beginning")
    parser.add_argument("--each", type=int, help="so many of each set, kind and rig, instead of a share")
    parser.add_argument("--budget", type=float, help="seconds for each diagnosis; without, its usual effort")
    parser.add_argument("--effort", type=float, default=1.0, help="so many times what fits into it")
    parser.add_argument("--only", nargs="*", default=(), help="diagnose only these campaigns")
    parser.add_argument("--quick", action="store_true", help="score without measuring gaps that are not yet")
    parser.add_argument("--discard-logs", action="store_true", help="remove the logs once all is scored")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())

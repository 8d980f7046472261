"""The blind check: `python -m benchmarks.blind all DIR --seed S`, or its steps one by one.

`make` draws all campaigns, seals the answers and records; `diagnose` runs `rattle diagnose` on each; `oracle`
measures what the true effects close; `score` opens the answers and prints. Every step takes a part of the
campaigns (sets, rigs, a share of each) and goes on where it was stopped. `all` does a few campaigns at a time
whole, `--more` of them at most, and scores; what each came to is kept in `--results`, where it is not done
again by the same program on any machine.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.blind.campaigns import Campaign, chosen, draw_campaigns
from benchmarks.blind.command import end_with_children
from benchmarks.blind.engines import engines
from benchmarks.blind.kept import keep, restore
from benchmarks.blind.make import discard_logs, is_recorded, make
from benchmarks.blind.runner import CALIBRATED, diagnose_all, forget, program_digest, was_stopped
from benchmarks.blind.score import is_measured, measure_gaps, measure_truths, score
from benchmarks.blind.seal import SealBroken, frozen_of, sealed, unseal
from benchmarks.blind.sets import RIGS, SETS
from benchmarks.kept_results import Results, commit

_AT_ONCE = 6
"""Campaigns that are recorded together; what is done of them by then is lost with the machine."""
_STEPS = ("make", "diagnose", "oracle", "score", "all")


def main() -> int:
    """Do what the command line says; 1 if a bar is missed, 2 on a broken seal."""
    end_with_children()
    arguments = _arguments()
    folder, step = arguments.folder, arguments.step
    met = True
    try:
        if step in ("make", "all"):
            campaigns = sealed(folder, arguments.seed, partial(draw_campaigns, engines=engines()))
        else:
            campaigns = unseal(folder)
        part = chosen(campaigns, arguments.sets, arguments.rigs, arguments.share, arguments.each)
        if step == "make":
            make(folder, campaigns, part)
            met = all(is_recorded(folder, campaigns, each) for each in part)
        if step == "diagnose":
            names = arguments.only or [each.name for each in part if is_recorded(folder, campaigns, each)]
            diagnose_all(folder, names, arguments.budget, arguments.effort)
        if step == "all":
            _by_parts(arguments, campaigns, part)
        if step == "oracle":
            measure_truths(folder, part)
        if step in ("score", "all"):
            met = score(folder, part, arguments.quick)
    except SealBroken as error:
        print(error, file=sys.stderr)
        return 2
    return 0 if met else 1


def _by_parts(arguments: argparse.Namespace, campaigns: Sequence[Campaign], part: Sequence[Campaign]) -> None:
    folder, seed = arguments.folder, arguments.seed
    results = None if arguments.results is None else Results(arguments.results, program_digest())
    if results is not None and frozen_of(folder).program_sha256 != results.digest:
        raise SealBroken(f"{folder} was begun by another program; name another folder")
    left = [each for each in part if results is None or not restore(folder, seed, each, results)]
    left = left[: arguments.more]
    for first in range(0, len(left), _AT_ONCE):
        some = left[first : first + _AT_ONCE]
        make(folder, campaigns, some)
        some = [each for each in some if is_recorded(folder, campaigns, each)]
        diagnose_all(folder, [each.name for each in some], arguments.budget, arguments.effort)
        measure_gaps(folder, some)
        for each in some:
            stopped = [look for look in ("", CALIBRATED) if was_stopped(folder, each.name + look)]
            for look in stopped:
                forget(folder, each.name + look)
            if stopped or not is_measured(folder, each):
                print(f"{each.name} is not done; another call tries it again", flush=True)
                continue
            if results is not None:
                keep(folder, seed, each, results)
            if arguments.discard_logs:
                discard_logs(folder, each)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__)
    parser.add_argument("step", choices=_STEPS)
    parser.add_argument("folder", type=Path, help="where everything of one check lies")
    parser.add_argument("--seed", type=int, help="draws the campaigns, for `make` and `all`")
    parser.add_argument("--sets", nargs="+", choices=tuple(SETS), default=tuple(SETS))
    parser.add_argument("--rigs", nargs="+", choices=RIGS, default=RIGS)
    parser.add_argument("--share", type=float, default=1.0, help="of each set, from its beginning")
    parser.add_argument("--each", type=int, help="so many of each set, kind and rig, instead of a share")
    parser.add_argument("--budget", type=float, help="seconds for each diagnosis; without, its usual effort")
    parser.add_argument("--effort", type=float, default=1.0, help="so many times what fits into it")
    parser.add_argument("--only", nargs="*", default=(), help="diagnose only these campaigns")
    parser.add_argument("--quick", action="store_true", help="score without measuring gaps that are not yet")
    parser.add_argument("--more", type=int, help="of `all`: do at most so many more than --results has")
    parser.add_argument("--results", type=Path, help="keep what each campaign came to in this folder")
    parser.add_argument("--discard-logs", action="store_true", help="remove logs once a campaign is done")
    asked = parser.parse_args()
    if asked.step in ("make", "all") and asked.seed is None:
        parser.error("--seed: which campaigns are drawn")
    if asked.results is not None and (asked.budget is not None or asked.effort != 1.0):
        parser.error("--results are those of the usual effort")
    if asked.results is not None and commit().endswith("+"):
        parser.error("--results: files differ from the commit that they would be kept with")
    return asked


if __name__ == "__main__":
    sys.exit(main())

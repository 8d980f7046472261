"""The blind check: `python -m benchmarks.blind all DIR`, or its steps one by one.

`make` draws campaigns, seals the answers and records; `diagnose` runs `rattle diagnose` on each and goes on
where it was stopped; `oracle` measures what the true effects close; `score` opens the answers and prints.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.blind.campaigns import RIGS
from benchmarks.blind.make import discard_logs, make
from benchmarks.blind.runner import diagnose_all
from benchmarks.blind.score import measure_truths, score
from benchmarks.blind.seal import SealBroken, unseal

_STEPS = ("make", "diagnose", "oracle", "score", "all")


def main() -> int:
    """Do what the command line says; 1 if a bar is missed, 2 on a broken seal."""
    arguments = _arguments()
    folder: Path = arguments.folder
    met = True
    try:
        if arguments.step in ("make", "all"):
            make(folder, arguments.campaigns, arguments.seed, arguments.rigs)
        if arguments.step in ("diagnose", "all"):
            diagnose_all(folder, arguments.budget, arguments.only)
        if arguments.step == "oracle":
            measure_truths(folder)
        if arguments.step in ("score", "all"):
            met = score(folder)
    except SealBroken as error:
        print(error, file=sys.stderr)
        return 2
    if arguments.step == "all" and arguments.discard_logs:
        for campaign in unseal(folder):
            discard_logs(folder, campaign)
    return 0 if met else 1


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__)
    parser.add_argument("step", choices=_STEPS)
    parser.add_argument("folder", type=Path, help="where everything of one check lies")
    parser.add_argument("--campaigns", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1, help="draws the campaigns")
    parser.add_argument("--rigs", nargs="+", choices=RIGS, default=RIGS, help="of which they are drawn")
    parser.add_argument("--budget", type=float, default=60.0, help="seconds for each diagnosis")
    parser.add_argument("--only", nargs="*", default=(), help="diagnose only these campaigns")
    parser.add_argument("--discard-logs", action="store_true", help="remove the logs once all is scored")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())

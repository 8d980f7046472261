"""Prints what `rattle diagnose --subject` makes of the measured sets.

Usage: python -m tests.own_rigs [seeds] [names...]
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from rig.diagnosis.own_rig import OwnRequest, diagnose_own
from rig.session.progress import Screen, Terminal
from tests.own_rigs import sets, verdict_of


def main() -> None:
    """Print a line for each set: what the seeds say, each and together, and how it would be otherwise."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    for name, subject, file in sets():
        if sys.argv[2:] and name not in sys.argv[2:]:
            continue
        begun = time.monotonic()
        with TemporaryDirectory() as folder:
            request = OwnRequest(str(subject), [file], seed=1, seeds=seeds)
            _, files = diagnose_own(request, Path(folder), Screen(Terminal(quiet=True)))
            found = json.loads(files["diagnosis"].read_text(encoding="utf-8"))
        answer = verdict_of(found)
        said = [" + ".join(each["selected"]) or each["verdict"] for each in found["by_seed"]]
        widths = [
            f"x{each['width']:g}: {' + '.join(each['selected']) or each['verdict']}"
            for each in found["by_width"]
        ]
        print(f"{name:22}{' + '.join(answer.selected) or found['verdict']:24}{', '.join(answer.alike)}")
        print(f"    seeds {', '.join(said)}; healthy {', '.join(widths)}; {time.monotonic() - begun:.0f} s")
        for remark in found["remarks"]:
            print(f"    ! {remark}")
        sys.stdout.flush()


if __name__ == "__main__":
    main()

"""Prints what the diagnosis makes of the measured sets.

Usage: python -m tests.own_rigs [seeds]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.subject import Subject
from tests.own_rigs import MEASURED, ball_drop, friction_damper, silverbox, verdict


def sets() -> Iterator[tuple[str, Subject, NDArray[np.float32]]]:
    """Name, subject and measured fingerprints of each set."""
    yield "silverbox", *silverbox.measured(MEASURED / "silverbox" / "silverbox.npz", blocks=4)
    damper = MEASURED / "friction_damper_backlash" / "dataset-2.npz"
    yield "friction damper", *friction_damper.measured(damper)
    for path in sorted((MEASURED / "ball_drops").glob("*.csv")):
        name = path.stem.removeprefix("ball_drops_").replace("_", " ").lower()
        yield name, ball_drop.BallDrop(), ball_drop.measured(path)


def main() -> None:
    """Print a line for each set and seed."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    for name, subject, fingerprints in sets():
        for seed in range(1, seeds + 1):
            begun = time.process_time()
            found = verdict(subject, fingerprints, seed)
            selected = " + ".join(found.selected) or "none"
            seconds = time.process_time() - begun
            print(f"{name:22}{seed:3}  {selected:36}{', '.join(found.alike):36}{seconds:5.1f} s", flush=True)


if __name__ == "__main__":
    main()

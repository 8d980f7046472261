"""How long work takes on this machine, by what it took before, which the user's cache keeps."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Final

from rig.files.cache import cache_folder

PACES: Final = "RATTLE_PACES"
"""Of the environment: at 0 nothing is kept of how long work took."""
_KEPT: Final = 8
_APART: Final = 2.0
"""Two that differ by less in size tell nothing of what every one takes, however small it is."""
_PROJECT: Final = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class Work:
    """So many `units` of one `kind` of work; none of them where all was done before."""

    kind: str
    units: float = 1.0


def reading(kind: str, *files: Path) -> Work:
    """The MB of files, of those that are there, as work."""
    return Work(kind, sum(file.stat().st_size for file in files if file.is_file()) / 1e6)


class Paces:
    """What the last works of each kind took; a file that cannot be read or written is as good as none."""

    def __init__(self, file: Path | None = None) -> None:
        self._file = file or cache_folder() / "paces.json"
        self._off = os.environ.get(PACES) == "0"
        self._known = self._read()

    def expected_s(self, work: Work) -> float | None:
        """Seconds that `work` will take; None where none of its kind was done here before."""
        known = self._known.get(work.kind)
        return None if not known else _by_line(known, work.units)

    def took(self, work: Work, seconds: float) -> None:
        """Keep what a work took, unless machine code was compiled meanwhile, which it is but once."""
        if self._off or work.units <= 0 or seconds <= 0 or _compiled_within(seconds):
            return
        self._known = known = self._read()  # anew: another command may have kept something
        known[work.kind] = [*known.get(work.kind, []), (work.units, seconds)][-_KEPT:]
        with suppress(OSError):  # a cache: without a place for it the next work is told of later
            self._file.parent.mkdir(parents=True, exist_ok=True)
            unfinished = self._file.with_name(f".{self._file.name}.{os.getpid()}")
            unfinished.write_text(json.dumps(known), encoding="utf-8")
            unfinished.replace(self._file)

    def _read(self) -> dict[str, list[tuple[float, float]]]:
        if self._off:
            return {}
        with suppress(OSError, ValueError, TypeError, AttributeError, RecursionError):  # it is measured again
            kept = json.loads(self._file.read_text(encoding="utf-8"))
            pairs = {str(kind): [(float(u), float(s)) for u, s in each] for kind, each in kept.items()}
            return {
                kind: [(u, s) for u, s in each if 0 < u < math.inf and 0 < s < math.inf]
                for kind, each in pairs.items()
            }
        return {}


def _by_line(known: Sequence[tuple[float, float]], units: float) -> float:
    """Seconds for `units` by the line nearest to what is known, by the ratio, as most of it says.

    The line through two of them, or the origin and one: one work that was disturbed moves it by nothing.
    """
    lines = [(0.0, seconds / size) for size, seconds in known]
    for (small, first_s), (large, last_s) in combinations(sorted(known), 2):
        if large >= _APART * small:
            slope = (last_s - first_s) / (large - small)
            start_s = first_s - slope * small
            if slope > 0 and start_s > 0:
                lines.append((start_s, slope))

    def misfit(line: tuple[float, float]) -> float:
        return math.fsum(abs(math.log((line[0] + line[1] * size) / seconds)) for size, seconds in known)

    start_s, slope = min(lines, key=misfit)
    return start_s + slope * units


def _compiled_within(seconds: float) -> bool:
    """Whether machine code was put on the disk in the last so many seconds."""
    since = time.time() - seconds
    places = [_PROJECT / "sim_twin", _PROJECT / "daq", cache_folder().parent / "numba"]
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        places.append(Path(given))
    with suppress(OSError):
        return any(index.stat().st_mtime > since for place in places for index in place.rglob("*.nbi"))
    return False


def lasting(seconds: float) -> str:
    """A time to wait in words."""
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    short = f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
    return f"{hours} h {minutes} min" if hours else short

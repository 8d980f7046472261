"""What both networks and two simple ways come to on recorded runs: the table, and what of the paper holds."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from daq.log.reader import LogReader
from rig.pages.content import Lead, Part, Sentence, Table
from rig.surrogates.training import EVERY
from rig.twin.recorded_samples import digest_of, samples_of
from sim_twin.surrogates.comparison import DENSE, METHODS, OTHER_SETTINGS, OVERS, SPLITS, Row, compared
from sim_twin.surrogates.samples import Over, Samples

_ROWS: TypeAdapter[list[Row]] = TypeAdapter(list[Row])


def judged(
    logs: Sequence[Path], folder: Path, executor: Executor | None, progress: Callable[[int], None]
) -> list[Row]:
    """Every method on every split over every input.

    What is known lies in `folder` and is not computed again while logs and methods are the same.
    """
    digests = []
    for path in logs:
        with LogReader(path) as log:
            digests.append(digest_of(log))
    key = hashlib.sha256(
        json.dumps([digests, list(METHODS), list(SPLITS), version("rattle")]).encode()
    ).hexdigest()[:16]
    pieces = [(split, over) for split in SPLITS for over in OVERS]
    files = {piece: folder / f"rows-{key}-{number}.json" for number, piece in enumerate(pieces)}
    found = {piece: rows for piece, file in files.items() if (rows := _kept(file)) is not None}
    missing = [piece for piece in pieces if piece not in found]
    progress(len(found))
    paths = tuple(logs)
    if executor is None:
        results: Any = ((piece, _compared(paths, *piece)) for piece in missing)
    else:
        futures = {executor.submit(_compared, paths, *piece): piece for piece in missing}
        results = ((futures[future], future.result()) for future in as_completed(futures))
    for piece, rows in results:
        found[piece] = rows
        files[piece].write_bytes(_ROWS.dump_json(rows, indent=2))  # half of it is computed again
        progress(len(found))
    return [row for piece in pieces for row in found[piece]]


def _kept(file: Path) -> list[Row] | None:
    try:
        return _ROWS.validate_json(file.read_bytes())
    except (OSError, ValidationError):
        return None


@functools.lru_cache(maxsize=1)
def _read(paths: tuple[Path, ...]) -> Samples:
    parts = []
    for path in paths:
        with LogReader(path) as log:
            parts.append(samples_of(log, EVERY))
    return Samples.joined(parts)


def _compared(paths: tuple[Path, ...], split: str, over: Over) -> list[Row]:
    return compared(_read(paths), split, over)


PIECES = len(SPLITS) * len(OVERS)
HEADINGS = ("held back", "over", "by", "rmse", "over floor", "distance", "over floor")


def cells(row: Row) -> list[str]:
    """A row of the table in words."""
    score = row.score
    figures = (score.rmse, score.rmse_over_floor, score.distance, score.distance_over_floor)
    return [row.split, row.over, row.method, *(f"{each:.2f}" for each in figures)]


def document(rows: Sequence[Row], logs: Sequence[Path]) -> str:
    """The same for a program."""
    record = {
        "schema": "rattle.surrogates/1",
        "logs": [path.name for path in logs],
        "rows": [asdict(row) for row in rows],
        "claims": [{"claim": claim, "holds": holds, "found": found} for claim, holds, found in claims(rows)],
    }
    return json.dumps(record, indent=2, allow_nan=False)


_EXACT, _USEFUL = 0.9, 0.5
"""Share of the variance of points that were held back."""


def claims(rows: Sequence[Row]) -> list[tuple[str, bool, str]]:
    """What the paper says, whether that is so here, and by what; only of what the runs can tell."""
    told = {(row.split, row.over, row.method): 1 - row.score.rmse**2 for row in rows}

    def share(split: str, method: str) -> float:
        """The better of both inputs; nothing where the mean value alone does as well."""
        return max([0.0, *(told.get((split, over, method), 0.0) for over in OVERS)])

    rbf, grnn = "RBF, 10 units", "GRNN"
    dense = {method: share(DENSE, method) for method in (rbf, grnn)}
    both = f"RBF explains {dense[rbf]:.0%} of the variance, GRNN {dense[grnn]:.0%}"
    there = {row.split for row in rows}
    elsewhere = {split: max(share(split, rbf), share(split, grnn)) for split in SPLITS if split in there}
    told_of = ", ".join(f"{split} {found:.0%}" for split, found in elsewhere.items() if split != DENSE)
    others = [elsewhere[split] for split in OTHER_SETTINGS if split in elsewhere]
    found = [
        ("the RBF network matches the measurement exactly", dense[rbf] > _EXACT, both),
        ("the RBF network is ahead of the GRNN", dense[rbf] > dense[grnn], both),
        ("the GRNN is not suitable", dense[grnn] < _USEFUL, both),
    ]
    if others:
        words = f"the better network explains: {told_of}"
        found.append(("vibration is predicted for other speeds and clearances", min(others) > _USEFUL, words))
    return found


_EXPLANATION = (
    "Rmse and distance are in standard deviations of the channel, the mean over runs and channels; an rmse "
    "of 1.00 is what the mean value alone comes to. The floor of the rmse is that of a run's own mean "
    "revolution; of the distance (Wasserstein's, of the distributions of values) that of the run's halves "
    "from each other."
)


def parts(rows: Sequence[Row]) -> list[Part]:
    """The table, after what of the paper holds."""
    told = [
        f"{'Holds' if holds else 'Does not hold'}: {claim} ({found})." for claim, holds, found in claims(rows)
    ]
    return [Lead(told), Sentence(_EXPLANATION), Table(HEADINGS, [cells(row) for row in rows], words=True)]

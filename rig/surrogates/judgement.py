"""What networks and simple ways come to on recorded runs: the tables, and what of the paper holds."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from daq.errors import LogError
from daq.log.reader import LogReader
from rig.pages.content import Part, Sentence, Table
from rig.twin import recorded_samples
from rig.twin.recorded_samples import samples_of
from sim_twin import surrogates
from sim_twin.surrogates.comparison import (
    AMOUNTS,
    METHODS,
    MOST,
    NEAREST,
    OTHER_SETTINGS,
    OVERS,
    POINTS,
    SPLITS,
    WINDOWS,
    Row,
    compared,
)
from sim_twin.surrogates.judging import Score
from sim_twin.surrogates.samples import LEARNT, TESTED, Over, Samples

EVERY = 4
"""Of the samples of a log: 6.4 kHz of 25.6 kHz, at which neighbours tell of each other."""
_ROWS: TypeAdapter[list[Row]] = TypeAdapter(list[Row])
_LIBRARIES = ("numpy", "scipy", "scikit-learn")


def judged(
    logs: Mapping[Path, str], folder: Path, executor: Executor | None, progress: Callable[[int], None]
) -> list[Row]:
    """Every method on every split, of either amount of points, over every input; `logs` with their digests.

    What is known lies in `folder` and is not computed again while samples, code and libraries are the same.
    Raises LogError where too little was recorded to learn from.
    """
    sources = [*Path(surrogates.__path__[0]).glob("*.py"), Path(recorded_samples.__file__)]
    code = [hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(sources)]
    stated = [list(logs.values()), code, EVERY, [version(name) for name in _LIBRARIES]]
    key = hashlib.sha256(json.dumps(stated).encode()).hexdigest()[:16]
    pieces = [(split, amount, over) for split in SPLITS for amount in AMOUNTS for over in OVERS]
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


def _compared(paths: tuple[Path, ...], split: str, amount: str, over: Over) -> list[Row]:
    try:
        return compared(_read(paths), split, amount, over)
    except LogError:
        raise
    except ValueError as error:
        raise LogError(f"{split}: {error}; record longer") from error


PIECES = len(SPLITS) * len(AMOUNTS) * len(OVERS)
HEADINGS = ("held back", "learnt", "over", *METHODS)
MEASURES: Mapping[str, Callable[[Score], float]] = {
    "rmse": lambda score: score.rmse,
    "distance of the distributions": lambda score: score.distance,
}


def tables(rows: Sequence[Row]) -> dict[str, list[list[str]]]:
    """The rows of a table under `HEADINGS` for each measure, by what stands above it; none without rows."""
    if not rows:
        return {}
    floors = rows[0].score.rmse_floor, rows[0].score.distance_floor
    lines = dict.fromkeys((row.split, row.learnt, row.over) for row in rows)
    found = {(row.split, row.learnt, row.over, row.method): row.score for row in rows}
    return {
        f"{name}, of all the floor is {floor:.2f}": [
            [*line, *(f"{measure(found[*line, method]):.2f}" for method in METHODS)] for line in lines
        ]
        for (name, measure), floor in zip(MEASURES.items(), floors, strict=True)
    }


def document(rows: Sequence[Row], logs: Sequence[Path]) -> str:
    """The same for a program."""
    record = {
        "schema": "rattle.surrogates/1",
        "logs": [path.name for path in logs],
        "rows": [asdict(row) for row in rows],
        "claims": [{"claim": claim, "holds": holds, "found": found} for claim, holds, found in claims(rows)],
    }
    return json.dumps(record, indent=2, allow_nan=False)


def _tables(rows: Sequence[Row]) -> tuple[Table, *tuple[Table, ...]]:
    """What of the paper holds, and a table for each measure."""
    told = [[claim, "holds" if holds else "does not hold", found] for claim, holds, found in claims(rows)]
    made = [Table(HEADINGS, lines, _capital(caption), words=True) for caption, lines in tables(rows).items()]
    return Table(("the paper", "here", "found"), told, words=True), *made


def markdown(rows: Sequence[Row]) -> str:
    """The same as a part of a page of docs/."""
    claimed, *measured = _tables(rows)
    blocks = [block for each in measured for block in (f"**{each.caption}**", _marked(each))]
    return "\n\n".join([*blocks, _marked(claimed)]) + "\n"


def _marked(table: Table) -> str:
    lines = [table.headings, ["---"] * len(table.headings), *table.rows]
    return "\n".join(f"| {' | '.join(map(str, each))} |" for each in lines)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


_EXACT, _USEFUL = 0.9, 0.5
"""Share of the variance of points that were held back."""


def claims(rows: Sequence[Row]) -> list[tuple[str, bool, str]]:
    """What the paper says, whether that is so here, and by what; only of what the runs can tell."""
    told = {(row.split, row.learnt, row.over, row.method): 1 - row.score.rmse**2 for row in rows}

    def share(split: str, amount: str, *methods: str) -> float:
        """The best of methods and inputs; nothing where the mean value alone does as well."""
        return max([0.0, *(told.get((split, amount, over, each), 0.0) for over in OVERS for each in methods)])

    if not rows:
        return []
    rbf, grnn = ([name for name in METHODS if name.startswith(kind)] for kind in ("RBF", "GRNN"))
    near = {name: share(POINTS, NEAREST, name) for name in (*rbf, *grnn)}
    there = {row.split for row in rows}
    others = {
        split: max(share(split, amount, *rbf, *grnn) for amount in AMOUNTS)
        for split in OTHER_SETTINGS
        if split in there
    }
    ten, many = zip(rbf, grnn, strict=True)
    found = [
        (
            "the RBF network of ten units matches the measurement exactly",
            near[rbf[0]] > _EXACT,
            _each(near, rbf[:1]),
        ),
        (
            "of ten units each, the RBF network is ahead of the GRNN",
            near[ten[0]] > near[ten[1]],
            _each(near, ten),
        ),
        ("of many, the RBF network is ahead of the GRNN", near[many[0]] > near[many[1]], _each(near, many)),
        ("the GRNN is not suitable", max(near[name] for name in grnn) < _USEFUL, _each(near, grnn)),
    ]
    if others:
        words = ", ".join(f"{split} {explained:.0%}" for split, explained in others.items())
        found.append(
            (
                "vibration is predicted for other speeds and clearances",
                min(others.values()) > _USEFUL,
                f"explained at best: {words}",
            )
        )
    return found


def _each(near: Mapping[str, float], names: Sequence[str]) -> str:
    told = ", ".join(f"{name} {near[name]:.0%}" for name in names)
    return f"explained of the variance at random points, {LEARNT} learnt: {told}"


EXPLANATION = (
    f"All are judged on the same points, every {EVERY}th sample, which nothing has learnt: at about "
    f"{WINDOWS} places in the second half of the run in the middle of speeds and clearances, or of several, "
    f"a random third of {LEARNT + TESTED}. "
    "Held back are a random third of all points alone, or also the second half of every run, its speed, "
    f"or its clearances; learnt are the {LEARNT} points nearest to those that are asked for, as in the "
    f"paper, or {MOST:,} of all at most. Rmse and distance (Wasserstein's, of the distributions of values) "
    "are in standard deviations of the channel, the mean over channels; an rmse of 1.00 is what the mean "
    "value alone comes to. Floors: of the rmse what the run's own mean revolution leaves, which only what "
    "has learnt points of the very revolution comes below; of the distance that of the run's odd from its "
    "even revolutions."
)


def parts(rows: Sequence[Row]) -> list[Part]:
    """The tables, after what of the paper holds."""
    claimed, *measured = _tables(rows)
    return [claimed, Sentence(EXPLANATION), *measured]

"""What was simulated of a rig, kept by content: a second look simulates nothing anew.

A file of the cache holds fingerprints of one setting by their draws: a line that says which program made
them, then records of digest, length, checksum and content, appended as they come.
"""

from __future__ import annotations

import fcntl
import hashlib
import inspect
import os
import pickle
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

import sim_twin
from rig.diagnosis.model_values import WithValues
from rig.ensembles import Simulated
from rig.files.cache import cache_folder
from rig.rigs.kind import RigKind
from sim_twin.diagnosis.campaign import Campaign, RunSetting, joined
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.subject import Draw, Execute, Observed, OfRuns, Subject

KEEP: Final = "RATTLE_SIMULATED"
"""Of the environment: at 0 nothing is kept, nor used."""
_HEAD: Final = struct.Struct("<16sII")
_SHAPE: Final = struct.Struct("<ii")
_MOST_BYTES, _MOST_A_FILE = 2_000_000_000, 250_000_000
"""Of all files; and of one, which is held in memory."""
_DIGEST = 16
_CHANGING = (WithValues, RigKind)
"""What changes values of a rig, beside the program that simulates it."""
_DAMAGE = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, zlib.error, BadZipFile)
"""What NumPy and zipfile raise where a byte is another."""


def kept_arrays(file: Path) -> dict[str, NDArray[Any]] | None:
    """The arrays of a file of the cache; None where there is none, or a damaged one."""
    try:
        with file.open("rb") as opened, np.load(opened) as kept:  # by name a damaged one would stay open
            return {name: kept[name] for name in kept.files}
    except _DAMAGE:
        return None


@dataclass(frozen=True, slots=True)
class Part:
    """What one file of the cache holds the simulations of: one run, or all of a rig that has none.

    `told` is all that they follow from beside the program, of which `version` makes a digest. They are `size`
    numbers wide.
    """

    told: tuple[object, ...]
    version: Callable[[], str]
    size: int


class Kept:
    """What is kept of a subject: by the number of each run, if it simulates them apart; else as its only one.

    `tell` hears of a cache that is not used. `told` is what a draw follows from beside its part.
    """

    def __init__(
        self,
        subject: Subject,
        parts: Mapping[int, Part],
        tell: Callable[[str], None],
        told: Callable[[Draw], tuple[object, ...]] = lambda _: (),
    ) -> None:
        self._subject, self._told = subject, told
        self._sizes = {number: each.size for number, each in parts.items()}
        folder = cache_folder() / "simulated"
        _bounded(folder)
        self._files = {
            number: _KeptRuns(folder / f"{digest_of(*each.told).hex()}.kept", each.version, tell)
            for number, each in parts.items()
        }
        self.some = any(file.known for file in self._files.values())
        """Whether anything was known before."""

    def lacking(self, draws: Sequence[Draw]) -> list[Draw]:
        """Those of which not all is kept."""
        digests = (self._digest(replace(draw, runs=())) for draw in draws)
        known = (all(digest in file.known for file in self._files.values()) for digest in digests)
        return [draw for draw, kept in zip(draws, known, strict=True) if not kept]

    def _digest(self, draw: Draw) -> bytes:
        return digest_of(draw, *self._told(draw))

    def by(self, simulated: Simulated) -> Execute:
        """Has `simulated` observe draws, except what is kept of each run."""
        return partial(self._observed, simulated)

    def _observed(self, simulated: Simulated, draws: Sequence[Draw]) -> list[Observed]:
        every = tuple(self._files)
        wanted = [draw.runs or every for draw in draws]
        draws = [replace(draw, runs=()) for draw in draws]
        digests = [self._digest(draw) for draw in draws]
        of_runs = [
            {k: self._files[k].known.get(digest) for k in runs}
            for digest, runs in zip(digests, wanted, strict=True)
        ]
        lacking: dict[tuple[int, ...], list[int]] = {}
        for at, known in enumerate(of_runs):
            lacking.setdefault(tuple(k for k, one in known.items() if one is None), []).append(at)
        lacking.pop((), None)
        simulated.known(
            sum(one is not None for known in of_runs for one in known.values()) / len(self._files)
        )
        for runs, places in lacking.items():
            sizes = [self._sizes[k] for k in runs]
            shown = simulated.of(self._only(runs), [draws[at] for at in places])
            for at, each in zip(places, shown, strict=True):
                for k, one in zip(runs, _apart(each, sizes), strict=True):
                    of_runs[at][k] = one
                    if one and all(blocks is not None for blocks in one):
                        self._files[k].add(digests[at], one)
        return [
            joined([one or () for one in each.values()]) if all(each.values()) else () for each in of_runs
        ]

    def _only(self, runs: tuple[int, ...]) -> Subject:
        return self._subject.only(runs) if isinstance(self._subject, OfRuns) else self._subject


def kept_runs(campaign: Campaign, model: str, tell: Callable[[str], None]) -> Kept:
    """What is kept of the runs of a campaign, under the text of a calibration's `model`."""
    parts = {
        number: Part(
            (number, *setting_told(run), model),
            partial(version_of, run),
            Layout(run.columns.cells(number)).size,
        )
        for number, run in enumerate(campaign.runs)
    }

    def told(draw: Draw) -> tuple[object, ...]:
        """What its values are changed from, where it has any."""
        return (campaign.given,) if isinstance(campaign, WithValues) and campaign.has_values(draw) else ()

    return Kept(campaign, parts, tell, told)


def kept_rig(subject: Subject, version: Callable[[], str], tell: Callable[[str], None]) -> Kept:
    """What is kept of somebody's own rig, by what other processes get of it."""
    apart = {0: subject}
    if isinstance(subject, OfRuns):
        apart = {run: subject.only((run,)) for run in sorted({cell.run for cell in subject.layout.cells})}
    parts = {
        run: Part((hashlib.sha256(pickle.dumps(one)).hexdigest(),), version, one.layout.size)
        for run, one in apart.items()
    }
    return Kept(subject, parts, tell)


def _apart(shown: Observed, sizes: Sequence[int]) -> list[Observed]:
    """The fingerprints of each run out of those side by side, as exact as they are kept."""
    ends = np.cumsum(sizes)[:-1]
    parts = [
        [None] * len(sizes) if each is None else np.split(np.asarray(each, np.float32), ends, axis=1)
        for each in shown
    ]
    return [tuple(each[k] for each in parts) for k in range(len(sizes))]


class _KeptRuns:
    """What is known of one setting, by the digest of its draw."""

    def __init__(self, path: Path, version: Callable[[], str], tell: Callable[[str], None]) -> None:
        self.known: dict[bytes, Observed] = {}
        self._path, self._tell = path, tell
        self._works = os.environ.get(KEEP) != "0"
        if not self._works:
            return
        self._begin = version().encode() + b"\n"
        try:
            with path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_SH)  # else what another diagnosis is adding would look damaged
                content = file.read()
        except OSError:
            content = b""
        if not content.startswith(self._begin) or len(content) > _MOST_A_FILE:
            if content and len(content) <= _MOST_A_FILE:
                tell(f"what was simulated before ({path}) is another version's; it is simulated again")
            self._write(self._begin, "wb")
            return
        at = len(self._begin)
        while at < len(content):
            digest, size, checksum = _HEAD.unpack(content[at : at + _HEAD.size].ljust(_HEAD.size, b"\0"))
            own = content[at + _HEAD.size : at + _HEAD.size + size]
            if len(own) < size or not size or zlib.crc32(own, zlib.crc32(digest)) != checksum:
                tell(f"what was simulated before ({path}) is damaged; what lies behind is simulated again")
                self._write(content[:at], "wb")
                return
            self.known[digest] = _unpacked(own)
            at += _HEAD.size + size

    def add(self, digest: bytes, shown: Observed) -> None:
        self.known[digest] = shown
        own = _packed(shown)
        self._write(_HEAD.pack(digest, len(own), zlib.crc32(own, zlib.crc32(digest))) + own, "ab")

    def _write(self, content: bytes, mode: str) -> None:
        if not self._works:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open(mode) as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                file.write(content)
        except OSError as error:
            self._tell(f"what is simulated is not kept: {self._path}: {error.strerror}")
            self._works = False


def _packed(shown: Observed) -> bytes:
    return b"".join(
        _SHAPE.pack(*blocks.shape) + np.ascontiguousarray(blocks, "<f4").tobytes()
        for blocks in shown
        if blocks is not None
    )


def _unpacked(content: bytes) -> Observed:
    shown, at = [], 0
    while at < len(content):
        rows, columns = _SHAPE.unpack_from(content, at)
        at += _SHAPE.size
        blocks = np.frombuffer(content, "<f4", rows * columns, at).reshape(rows, columns)
        shown.append(blocks.astype(np.float32))
        at += 4 * rows * columns
    return tuple(shown)


def _bounded(folder: Path) -> None:
    """Remove what was written longest ago, until there is room."""
    with suppress(OSError):
        files = sorted(folder.glob("*.kept"), key=lambda each: -each.stat().st_mtime)
        total = 0
        for file in files:
            total += file.stat().st_size
            if total > _MOST_BYTES:
                file.unlink()


def digest_of(*told: object) -> bytes:
    """Of the text of all that is told."""
    return hashlib.sha256("\n".join(map(repr, told)).encode()).digest()[:_DIGEST]


def setting_told(setting: RunSetting) -> tuple[object, ...]:
    """All that the simulations of a run's setting follow from, beside the program."""
    twin = setting.twin
    return (
        twin,
        sorted(twin.sensors.items()),
        setting.columns,
        setting.oversampling,
        setting.cycles,
        sorted(setting.quiet.items()),
        setting.reference,
    )


def version_of(setting: RunSetting) -> str:
    """A digest of the program that simulates a setting."""
    changing = hashlib.sha256(b"".join(Path(inspect.getfile(each)).read_bytes() for each in _CHANGING))
    rig = sources_of(inspect.getfile(type(setting.twin.rig)))
    return sources_of(sim_twin.__file__)[:32] + rig[:16] + changing.hexdigest()[:16]


@cache
def sources_of(module: str) -> str:
    """A digest of a module's file and of all that is in its package."""
    digest, root = hashlib.sha256(), Path(module)
    while (root.parent / "__init__.py").exists():
        root = root.parent
    for file in sorted(root.rglob("*.py")) if root.is_dir() else [root]:
        digest.update(file.relative_to(root.parent).as_posix().encode() + b"\n" + file.read_bytes())
    return digest.hexdigest()

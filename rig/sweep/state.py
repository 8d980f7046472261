"""How far a sweep is: a small file beside its logs, written anew after each point and never half."""

from __future__ import annotations

import dataclasses
import fcntl
import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from daq.disk import make_folder, write_whole
from daq.errors import ConfigurationError, LogError, Problem, RattleError, RecorderFailed
from rig.files.bench import Bench
from rig.files.faults import read_text
from rig.files.model_file import ModelFile
from rig.files.sweep import Sweep

FILE: Final = "sweep.json"
SCHEMA: Final = "rattle.sweep/1"
Outcome = Literal["done", "failed", "interlock", "stopped"]
_STRICT: Final = ConfigDict(extra="forbid")


@dataclass(frozen=True, config=_STRICT)
class PointState:
    """How a point ended: `log` seen from the sweep's folder, `why` where it is not done.

    `impacts` were over, with their bounces, when the record ended; `figures` are what the whole record comes
    to, among them how many impacts it holds, begun ones too.

    A point that was `stopped` (a person, a lost instrument) comes again; one that `failed` or was ended by
    an `interlock` only if asked for.
    """

    outcome: Outcome
    log: str | None = None
    why: str = ""
    impacts: int | None = None
    figures: dict[str, float] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True, config=_STRICT)
class CentreState:
    """The offset in N that centres the beam, how far off it may be, and the rest position in m behind it.

    `log` shows how it was found, seen from the sweep's folder.
    """

    offset_n: float
    uncertainty_n: float
    rest_offset_m: float
    log: str | None = None


@dataclass(frozen=True, config=_STRICT)
class SweepState:
    """What is done, and with which files: their SHA-256 by what they are.

    `seed` draws the emulated rig, the same for all points. `by_hand` is what a person has set and confirmed;
    `centre` belongs to that.
    """

    schema: Literal["rattle.sweep/1"]
    digests: dict[str, str]
    seed: int
    by_hand: dict[str, str | float | bool] = dataclasses.field(default_factory=dict)
    centre: CentreState | None = None
    points: dict[int, PointState] = dataclasses.field(default_factory=dict)

    def with_point(self, number: int, point: PointState) -> SweepState:
        return dataclasses.replace(self, points={**self.points, number: point})

    def ended(self, *outcomes: Outcome) -> tuple[int, ...]:
        return tuple(sorted(n for n, point in self.points.items() if point.outcome in outcomes))


_STATE: Final = TypeAdapter(SweepState)


def digests_of(sweep: Sweep, bench: Bench, model: ModelFile | None = None) -> dict[str, str]:
    """Digests of all files that a sweep hangs on."""
    texts = {"sweep": sweep.text, "scenario": sweep.base, "bench": bench.text}
    if bench.emulation.effects is not None:
        texts["effects"] = read_text(bench.emulation.effects)
    if model is not None:
        texts["model"] = model.text
    return {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}


def load_state(folder: Path) -> SweepState | None:
    """The state of the sweep in `folder`; None where none has begun. Raises LogError for a damaged file."""
    try:
        text = (folder / FILE).read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise LogError(f"{folder / FILE}: {error.strerror}") from error
    try:
        return _STATE.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise LogError(f"{folder / FILE} is damaged: {where} {first['msg']}") from error


def save_state(folder: Path, state: SweepState) -> None:
    """Write the state: after a crash there is the old one or this one."""
    write_whole(folder / FILE, _STATE.dump_json(state, indent=2))


def check_unchanged(state: SweepState, now: Mapping[str, str], folder: Path) -> None:
    """Raise ConfigurationError that names the files that are others than those the sweep began with."""
    changed = [name for name in {**state.digests, **now} if state.digests.get(name) != now.get(name)]
    if changed:
        allowed = "the file that this sweep began with; put it back, or choose another --out for a new sweep"
        problems = [Problem(f"{name} file", "(changed since)", allowed) for name in changed]
        raise ConfigurationError(str(folder / FILE), problems)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Make the folder and keep other sweeps out of it; raises RattleError where one is at work."""
    try:
        make_folder(folder)
        lock = (folder / ".lock").open("w")
    except OSError as error:
        raise RecorderFailed(f"cannot write into {folder}: {error.strerror}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RattleError(f"{folder}: another rattle sweep is at work here") from error
        yield

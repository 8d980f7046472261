"""All that a rig of one's own needs to be diagnosed: `rattle diagnose --subject my_rig.py FILE...`.

    from sim_twin.own_rig import Simulator, cause

    def simulate(p, given): ...

    SUBJECT = Simulator(simulate, {"height": "m"}, rig={"restitution": (0.8, 0.01)}, causes=[...])

`docs/own_rig.md` shows a whole one. What is more than a simulator is an `OwnRig` of one's own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.check import Check, check
from sim_twin.diagnosis.diagnose import Effort, diagnose
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.pooled import pooled
from sim_twin.diagnosis.subject import Draw, Named, Observed, Subject, Widening
from sim_twin.effects import Parameter

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = [
    "Cause", "Cell", "Check", "Draw", "Effort", "Layout", "Named", "Observed", "OwnRig", "Parameter",
    "Simulator", "Subject", "Widening", "binned", "cause", "check", "diagnose", "number",
    "parts", "pooled", "with_effects",
]  # fmt: skip

Array: TypeAlias = NDArray[np.float64]
Blocks: TypeAlias = NDArray[np.float32]
Columns: TypeAlias = Mapping[str, NDArray[np.floating]]
"""What a file holds, by the names of its columns."""
Spread: TypeAlias = tuple[float, float]
"""What a number is, and the standard deviation among sound rigs."""
Rig = TypeVar("Rig", bound="DataclassInstance")
_PARTS = 16


@runtime_checkable
class OwnRig(Protocol):
    """What a file is, or has as its `SUBJECT`, and what an entry point of `rattle.subjects` offers."""

    def measured(self, files: Sequence[Columns]) -> tuple[Subject, Blocks]:
        """The subject, and the fingerprints (blocks, numbers) of what was measured on it."""


def number(name: str, unit: str, *intervals: tuple[float, float]) -> Parameter:
    """A parameter and where it may plausibly lie once its effect is there."""
    return Parameter(name, unit, intervals)


def cause(name: str, location: str, *parameters: Parameter, sensing: bool = False) -> Cause:
    """What may be missing; `sensing` if only the sensors show it, so that several share one motion."""
    return Cause(name, location, parameters, sensing=sensing)


def with_effects(rig: Rig, effects: Iterable[Named]) -> Rig:
    """A dataclass with the parameters of all effects in its fields of those names."""
    for _, values in effects:
        rig = replace(rig, **{name: float(value) for name, value in values.items()})
    return rig


def parts(values: ArrayLike, count: int = _PARTS) -> Array:
    """Means in so many equal parts of a record (n,), shape (count,); raises ValueError for a shorter one."""
    record = np.asarray(values, np.float64)
    if len(record) < count:
        raise ValueError(f"{len(record)} samples cannot be cut into {count} parts")
    return np.array([part.mean() for part in np.array_split(record, count)])


def binned(values: ArrayLike, over: ArrayLike, edges: ArrayLike) -> Array:
    """Means of `values` (n,) where `over` (n,) lies between two edges, (edges - 1,); NaN where none does."""
    bounds = np.asarray(edges, np.float64)
    classes, taken = np.digitize(np.asarray(over), bounds), np.asarray(values, np.float64)
    counts = np.bincount(classes, minlength=len(bounds) + 1).astype(np.float64)
    sums = np.bincount(classes, taken, len(bounds) + 1)
    return np.asarray((sums / np.where(counts > 0, counts, np.nan))[1:-1])


@dataclass(frozen=True, slots=True)
class Simulator:
    """A ready subject: a function that simulates, and tables of tolerances and causes.

    `simulate(p, given)` takes the numbers of a rig as attributes (`p.restitution`) and what else the files
    hold (`given["time"]`, arrays (n,)), and returns an array for each of `channels` (name to unit), which the
    files hold too. `rig` has the numbers that stay with a rig, `start` those that each block has anew: what
    it is, and its standard deviation among sound rigs; `noise` the sensors', by channel. An effect sets
    the numbers that its parameters are named after.

    Each file is a block; one with a column `block` has a block for each number there; each of these is cut
    into `cut` of equal length. `fingerprint` takes the channels and what else is given to numbers by name,
    as many for each block; without it, they are the means in 16 equal parts of each channel.
    Raises ValueError for tables that do not go together.
    """

    simulate: Callable[..., Mapping[str, ArrayLike]]
    channels: Mapping[str, str]
    rig: Mapping[str, Spread]
    causes: tuple[Cause, ...]
    start: Mapping[str, Spread] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    fingerprint: Callable[[Columns], Mapping[str, ArrayLike]] | None = None
    block: str | None = None
    cut: int = 1
    given: tuple[Columns, ...] = ()
    layout: Layout = field(default_factory=lambda: Layout(()))

    def __post_init__(self) -> None:
        object.__setattr__(self, "causes", tuple(self.causes))
        known = {**self.rig, **self.start}
        for each in self.causes:
            for one in each.parameters:
                if one.name not in known:
                    raise ValueError(f"{each.name} sets {one.name}; the rig has {', '.join(known)}")
        twice, strange = self.rig.keys() & self.start.keys(), self.noise.keys() - self.channels.keys()
        if twice or strange:
            what = f"{', '.join(twice)}: of the rig, or of each start?" if twice else ""
            raise ValueError(
                what or f"noise of {', '.join(strange)}; the channels are {', '.join(self.channels)}"
            )

    def measured(self, files: Sequence[Columns]) -> tuple[Subject, Blocks]:
        """The subject with what the files give to it, and their fingerprints.

        Raises ValueError for files without a channel, or of blocks that have other numbers than the first.
        """
        pieces = [piece for columns in files for piece in self._blocks(columns)]
        found = [self._numbers(piece) for piece in pieces]
        sizes = {name: np.size(values) for name, values in found[0].items()}
        for number, each in enumerate(found):
            if (other := {name: np.size(values) for name, values in each.items()}) != sizes:
                raise ValueError(f"block {number + 1} has {other} numbers, the first {sizes}")
        cells = [
            Cell(0, name, f"part {k + 1}" if size > 1 else "value", unit=self.channels.get(name, ""))
            for name, size in sizes.items()
            for k in range(size)
        ]
        given = [{name: piece[name] for name in piece if name not in self.channels} for piece in pieces]
        subject = replace(self, given=tuple(given), layout=Layout(tuple(cells)))
        return subject, np.array([_row(each) for each in found], dtype=np.float32)

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Simulate each draw with what some of the measured blocks were given."""
        return [tuple(self._observed(draw, shown) for shown in draw.sensing) for draw in draws]

    def wider(self, times: float) -> Simulator:
        """The same with so many times every standard deviation, the noise's too."""
        rig, start = (
            {name: (mean, times * deviation) for name, (mean, deviation) in each.items()}
            for each in (self.rig, self.start)
        )
        noise = {name: times * each for name, each in self.noise.items()}
        return replace(self, rig=rig, start=start, noise=noise)

    def _observed(self, draw: Draw, shown: tuple[Named, ...]) -> Blocks | None:
        rng = np.random.default_rng(draw.seed)
        numbers = _drawn(self.rig, rng)
        order = rng.permutation(len(self.given))
        effects = {name: value for _, values in (*draw.effects, *shown) for name, value in values.items()}
        rows = []
        for k in range(draw.blocks):
            given = self.given[order[k % len(order)]]
            p = SimpleNamespace(**{**numbers, **_drawn(self.start, rng), **effects})
            seen = {name: np.asarray(values, np.float64) for name, values in self.simulate(p, given).items()}
            if absent := self.channels.keys() - seen.keys():
                raise ValueError(f"simulate gives no {', '.join(absent)}; it gives {', '.join(seen)}")
            for name in self.channels:
                noise = self.noise.get(name, 0.0) * rng.standard_normal(seen[name].shape)
                seen[name] = seen[name] + noise
            rows.append(_row(self._numbers({**given, **seen})))
        found = np.array(rows, np.float32)
        return found if np.isfinite(found).all() else None

    def _numbers(self, record: Columns) -> Mapping[str, ArrayLike]:
        if self.fingerprint is not None:
            return self.fingerprint(record)
        return {name: parts(record[name]) for name in self.channels}

    def _blocks(self, columns: Columns) -> list[Columns]:
        """A file cut into its blocks."""
        missing = [name for name in (*self.channels, *filter(None, [self.block])) if name not in columns]
        if missing:
            raise ValueError(f"no column {', '.join(missing)}; there are {', '.join(columns)}")
        whole = [columns]
        if self.block is not None:
            of = columns[self.block]
            whole = [{name: values[of == each] for name, values in columns.items()} for each in np.unique(of)]
        pieces: list[Columns] = []
        for one in whole:
            length = min(len(values) for values in one.values()) // self.cut
            ends = [slice(k * length, (k + 1) * length) for k in range(self.cut)]
            pieces += [{name: values[cut] for name, values in one.items()} for cut in ends]
        return pieces


def _drawn(spreads: Mapping[str, Spread], rng: np.random.Generator) -> dict[str, float]:
    return {name: mean + deviation * rng.standard_normal() for name, (mean, deviation) in spreads.items()}


def _row(numbers: Mapping[str, ArrayLike]) -> Array:
    return np.concatenate([np.ravel(np.asarray(values, np.float64)) for values in numbers.values()])

"""What can be diagnosed: any rig that can be simulated with effects in, and seen through fingerprints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint import Layout

if TYPE_CHECKING:
    from sim_twin.diagnosis.cause import Cause

Values: TypeAlias = Mapping[str, float | str]
Named: TypeAlias = tuple[str, Values]
"""An effect and its parameters."""


@dataclass(frozen=True, slots=True)
class Draw:
    """A healthy rig of `seed` with `effects` in, observed over `blocks` blocks of each run.

    `sensing` lists what may be wrong with the sensors besides: each entry is one more observation of the
    same motion, with those effects in. `runs`, by their numbers in order, are those that are observed, by
    subjects `OfRuns`; empty: all.
    """

    effects: tuple[Named, ...]
    seed: int
    sensing: tuple[tuple[Named, ...], ...] = ((),)
    blocks: int = 1
    runs: tuple[int, ...] = ()


Observed: TypeAlias = tuple[NDArray[np.float32] | None, ...]
"""A fingerprint for each entry of `sensing`, shape (blocks, numbers); None for a run that failed."""


class Subject(Protocol):
    """A rig, the runs that were made on it, and what may be missing in its twin; picklable."""

    @property
    def layout(self) -> Layout:
        """What the numbers of a fingerprint are."""

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Every effect that these runs may have, once for each channel that it may sit on."""

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Fingerprints of healthy rigs with effects in, drawn from the seeds of `draws`; nothing else."""


@runtime_checkable
class OfRuns(Subject, Protocol):
    """One that observes of a draw those runs alone that it asks for: the same bits as with all others."""

    def only(self, numbers: tuple[int, ...]) -> Subject:
        """The same with some of the runs."""


@runtime_checkable
class Doubtful(Subject, Protocol):
    """One of which values may have been entered wrongly."""

    @property
    def doubts(self) -> tuple[Cause, ...]:
        """Of each value, that it is another; looked at where no effect explains the runs."""


@runtime_checkable
class Widening(Subject, Protocol):
    """One that can say what it would be if healthy rigs were not as wide as it believes."""

    def wider(self, times: float) -> Subject:
        """The same with so many times the healthy scatter, of everything that sound rigs differ by."""


Execute: TypeAlias = Callable[[Sequence[Draw]], Sequence[Observed]]
"""Has a subject observe draws, anywhere; () for one that there was no time for."""

"""What can be diagnosed: any rig that can be simulated with effects in, and seen through fingerprints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.draw import Draw, Observed
from sim_twin.diagnosis.fingerprint.layout import Layout


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


Execute: TypeAlias = Callable[[Sequence[Draw]], Sequence[Observed]]
"""Has a subject observe draws, anywhere; () for one that there was no time for."""

"""One run of an ensemble, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from numpy.random import SeedSequence

from daq.errors import SimulationFailed
from sim_twin.status import Status
from sim_twin.twin import AnyTwin

T_co = TypeVar("T_co", covariant=True)


@dataclass(frozen=True, slots=True)
class Variant:
    """What is simulated and from where: parameters, effects and operating point are all in the `twin`.

    `phase` in rad is the drive's (of a crank: its angle) at t = 0; in a chaotic motion 1e-9 rad more is
    another start. `noise` seeds noise and quantisation of the samples; None: none.
    """

    twin: AnyTwin
    phase: float = 0.0
    noise: SeedSequence | None = None


@dataclass(frozen=True, slots=True)
class Outcome(Generic[T_co]):
    """How a run ended, and what was observed; None unless it completed."""

    status: Status
    value: T_co | None = None


def status_of(error: Exception) -> Status:
    """How a run ended that raised `error`; DIVERGED where the error does not say."""
    said = error.status if isinstance(error, SimulationFailed) else None
    return said if isinstance(said, Status) else Status.DIVERGED

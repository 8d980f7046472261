"""How a simulation ended."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """Numerical outcome of a run, with advice for whoever set it up."""

    COMPLETED = 0
    DIVERGED = 1
    STEPS_EXHAUSTED = 2

    @property
    def advice(self) -> str:
        """One line: what to do about it; empty for a run that completed."""
        return _ADVICE[self]


_ADVICE = {
    Status.COMPLETED: "",
    Status.DIVERGED: "the motion left all bounds: look for an extreme stiffness, damping, mass or drive",
    Status.STEPS_EXHAUSTED: (
        "more steps were needed than allowed: look for a contact that is far too stiff, or raise the limit"
    ),
}

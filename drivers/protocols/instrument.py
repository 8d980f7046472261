"""What every instrument that is asked by name has in common."""

from __future__ import annotations

from typing import Protocol


class Instrument(Protocol):
    """An instrument as the bench and the log name it."""

    @property
    def name(self) -> str:
        """What the bench calls it."""
        ...

    @property
    def address(self) -> str:
        """Where it is."""
        ...

    @property
    def identity(self) -> str:
        """What it says it is; empty before `open`."""
        ...

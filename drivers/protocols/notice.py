"""What an instrument has to tell besides its values."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Notice:
    """Something for the log: `level` is info, warning or error, `code` is stable, `text` is for people.

    `arrival_s` is when this machine heard of it, by the monotonic clock: the run knows what time that was.
    """

    arrival_s: float
    level: str
    code: str
    text: str

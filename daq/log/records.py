"""What a log holds besides samples."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened; `level` is info, warning or error; `code` is stable, `text` is for people."""

    time_ns: int
    level: str
    source: str
    code: str
    text: str


@dataclass(frozen=True, slots=True)
class Gap:
    """`count` samples of `channel` from index `first_sample` on that are not in the log, and why."""

    time_ns: int
    channel: str
    first_sample: int
    count: int
    cause: str


@dataclass(frozen=True, slots=True)
class ClockRecord:
    """How a device's clock lay against the run's time base at `time_ns`.

    `offset_s` is what to add to the device's time to come to the time base, and grows by `rate_ppm`;
    `uncertainty_s` is the half width of a 95 % interval for it.
    """

    time_ns: int
    device: str
    offset_s: float
    rate_ppm: float
    uncertainty_s: float

"""What a log holds besides samples."""

from __future__ import annotations

from dataclasses import dataclass

LEAST_FREE_BYTES = 1 << 30
"""What a recording leaves of a disk: room to finish the log, and for whatever else the machine writes."""

RECORD_START, RECORD_END, STOPPING, LIMIT_WARNING = (
    "record.start", "record.end", "drive.stopping", "limit.warning"
)  # fmt: skip
"""Codes of events: a record begins, has come to its end; the rig is brought to rest before its time; a
channel has passed what only warns."""

CALIBRATED, SENSITIVITY, RANGE = "calibrated.", "sensitivity.", "range."
"""Of a sensor: so begin its keys in the `run` record, before the channel's name; V per unit, full scale."""

ENDS = "ends"
"""The last metadata record of a log that was finished: of each topic of samples, where it ends."""
CHECKSUM_OPCODE = 0x80
"""A record of our own after the head, each metadata record and each chunk: CRC-32 of all before it.
MCAP leaves 0x80 to 0xFF to programs."""


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
    """`count` samples of `channel` of `origin` from index `first_sample` on that are not in the log, and why.

    Logs of before have no origin there: it is empty.
    """

    time_ns: int
    channel: str
    first_sample: int
    count: int
    cause: str
    origin: str = "measured"


@dataclass(frozen=True, slots=True)
class Impact:
    """An impact with its bounces on `channel` of `origin`, computed from the samples of the log.

    `time_ns` and `first_sample` are where its first contact begins, `end_sample` (excluded) where its last
    one ends, `peak_sample` is its largest sample. `peak` and `first_peak` (of the first contact) are in the
    channel's unit, `impulse` in that unit times s, added up over its contacts as is `contact_s`. `turns` of
    the drive or crank at `first_sample`: the whole part counts cycles, the rest is the phase; NaN where
    nothing tells. Of a channel that vibrates all is of its magnitude.
    """

    time_ns: int
    origin: str
    channel: str
    first_sample: int
    end_sample: int
    peak_sample: int
    peak: float
    first_peak: float
    impulse: float
    contact_s: float
    bounces: int
    turns: float


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

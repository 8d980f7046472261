"""What happened, and which samples are not there."""

from __future__ import annotations

from datetime import UTC, datetime

from daq.block import NS_PER_S
from rig.report.content import Part, Sentence, Table
from rig.report.record import RunRecord

_MOST_ROWS = 500


def parts(run: RunRecord) -> list[Part]:
    """A table of events and the gap ledger."""
    return [*_events(run), *_gaps(run)]


def _events(run: RunRecord) -> list[Part]:
    if not run.events:
        return [Sentence("No events in this log.")]
    rows = [
        [_clock(event.time_ns), event.level, event.source, event.code, event.text]
        for event in sorted(run.events, key=lambda event: event.time_ns)[:_MOST_ROWS]
    ]
    return [
        Table(("time (UTC)", "level", "source", "code", "text"), rows, "Events", words=True),
        *_cut(len(run.events), "events"),
    ]


def _gaps(run: RunRecord) -> list[Part]:
    if not run.gaps:
        return [Sentence("No gaps: every sample between the first and the last of each channel is there.")]
    rows = [
        [gap.channel, _clock(gap.time_ns), str(gap.first_sample), str(gap.count), gap.cause]
        for gap in run.gaps[:_MOST_ROWS]
    ]
    return [
        Table(
            ("channel", "time (UTC)", "first missing sample", "samples", "cause"), rows, "Gaps", words=True
        ),
        *_cut(len(run.gaps), "gaps"),
    ]


def _cut(count: int, what: str) -> list[Sentence]:
    return [Sentence(f"The first {_MOST_ROWS} of {count} {what}.")] if count > _MOST_ROWS else []


def _clock(time_ns: int) -> str:
    try:
        seconds = datetime.fromtimestamp(time_ns // NS_PER_S, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"
    return f"{seconds:%Y-%m-%d %H:%M:%S}.{time_ns % NS_PER_S // 1_000_000:03d}"

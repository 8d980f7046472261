"""What a log holds beside its samples: events and gaps, the scenario, and where all of it comes from."""

from __future__ import annotations

from datetime import UTC, datetime

from daq.block import NS_PER_S
from rig.pages.content import Listing, Part, Sentence, Table
from rig.pages.words import DASH, number
from rig.report.record import RunRecord

_MOST_ROWS = 500


def events(run: RunRecord) -> list[Part]:
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


def scenario(run: RunRecord) -> list[Part]:
    """The scenario as it was run."""
    return [Listing(run.scenario)] if run.scenario else [Sentence("The log holds no scenario.")]


def provenance(run: RunRecord) -> list[Part]:
    """The log, what its writer says of itself, and the sensors."""
    state = "complete" if run.complete else f"not finished by its writer ({run.damage or 'no summary'})"
    rows = [["log", run.path.name], ["log file", state], ["written by", run.library or DASH]]
    for name, record in run.metadata.items():
        if name != "scenario":
            rows += [[f"{name}: {key}", value] for key, value in record.items()]
    facts = Table(("what", "value"), rows, "Log", words=True)
    return [facts, _sensors(run)] if run.channels else [facts, Sentence("The log holds no channel.")]


def _sensors(run: RunRecord) -> Table:
    rows = []
    for name, channel in run.channels.items():
        tally = run.tallies.get(("measured", name)) or run.tallies.get(("predicted", name))
        scale = DASH if channel.scale is None else f"{channel.scale:g} {channel.unit}/{channel.raw_unit}"
        rate = number(tally.sample_rate if tally else None, "Hz")
        rows.append(
            [name, channel.sensor or DASH, channel.serial or DASH, scale, channel.location or DASH, rate]
        )
    return Table(
        ("channel", "sensor", "serial", "scale", "location", "sample rate"), rows, "Sensors", words=True
    )

"""What a log holds beside its samples: events and gaps, the scenario, and where all of it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from daq.block import NS_PER_S
from daq.channel import Channel
from daq.errors import LogError
from daq.log.metadata import read_json
from daq.log.records import CALIBRATED, RANGE, SENSITIVITY
from rig.derived.settings import RECORD
from rig.pages.content import Listing, Part, Sentence, Table
from rig.pages.words import DASH, number
from rig.report.record import RunRecord
from rig.twin.chains import scale_of
from rig.twin.prediction_file import MODEL, TWIN

_MOST_ROWS = 500
_GRAVITY = 9.80665  # m/s2, 3rd CGPM 1901


def events(run: RunRecord) -> list[Part]:
    """A table of events and the gap ledger."""
    parts: list[Part] = [Sentence("No events in this log.")]
    if run.events:
        rows = [
            [
                *_times(run, event.time_ns),
                event.level,
                event.source,
                event.code,
                event.text,
            ]
            for event in sorted(run.events, key=lambda event: event.time_ns)
        ]
        parts = _ledger("events", (*_TIMES, "level", "source", "code", "text"), rows)
    if not run.gaps:
        none = "No gaps: every sample between the first and the last of each channel is there."
        return [*parts, Sentence(none)]
    rows = [
        [gap.channel, *_times(run, gap.time_ns), str(gap.first_sample), str(gap.count), gap.cause]
        for gap in run.gaps
    ]
    return [
        *parts,
        *_ledger("gaps", ("channel", *_TIMES, "first missing sample", "samples", "cause"), rows),
    ]


def _key(key: str) -> str:
    """In words, but for what ends with a channel's name."""
    return key if "." in key else key.replace("_", " ")


def _in_words(value: str) -> str:
    """What stands in a record as JSON, as words; else as it is."""
    try:
        found = read_json(value, "a value")
    except LogError:
        return value
    return _listed(found) if isinstance(found, dict | list) else value


def _listed(found: object) -> str:
    if isinstance(found, dict):
        each = (f"{str(key).replace('_', ' ')}: {_nested(part)}" for key, part in found.items())
        return ", ".join(each)
    return ", ".join(map(_nested, found)) or "none" if isinstance(found, list) else str(found)


def _nested(found: object) -> str:
    return f"({_listed(found)})" if isinstance(found, dict | list) else str(found)


def _sensitivity(channel: Channel, noted: str) -> str:
    """By the log's note in V per unit, else by the scale; of an accelerometer per g."""
    try:
        volts = float(noted) if noted else 1 / channel.scale if channel.scale else 0.0
    except ValueError:
        return DASH
    if not volts:
        return DASH
    if not noted and channel.raw_unit != "V":
        return f"{number(volts)} {channel.raw_unit}/{channel.unit}"
    if channel.unit == "m/s2":
        return f"{number(1e3 * volts * _GRAVITY)} mV/g"
    return f"{number(1e3 * volts)} mV/{f'({channel.unit})' if '/' in channel.unit else channel.unit}"


def _ledger(what: str, headings: Sequence[str], rows: list[list[str]]) -> list[Part]:
    parts: list[Part] = [Table(headings, rows[:_MOST_ROWS], what.capitalize(), words=True)]
    if len(rows) > _MOST_ROWS:
        parts.append(Sentence(f"The first {_MOST_ROWS} of {len(rows)} {what}."))
    return parts


_TIMES = "time (UTC)", "s of the record"


def _times(run: RunRecord, time_ns: int) -> tuple[str, str]:
    """What stands below these headings."""
    begins_ns = run.begins_ns
    return _clock(time_ns), DASH if begins_ns is None else f"{(time_ns - begins_ns) / NS_PER_S:.3f}"


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
        if name not in ("scenario", RECORD):  # which stand elsewhere on the page
            elsewhere = (CALIBRATED, SENSITIVITY, RANGE, *([MODEL] if name == TWIN else []))
            keys = (key for key in record if not key.startswith(elsewhere))
            rows += [[f"{name}: {_key(key)}", _in_words(record[key])] for key in keys]
    facts: list[Part] = [Table(("what", "value"), rows, "Log", words=True)]
    if model := run.metadata.get(TWIN, {}).get(MODEL):
        facts += [Sentence("The model that the twin was matched by:"), Listing(model)]
    if not run.channels:
        return [*facts, Sentence("The log holds no channel.")]
    sensors, noted = [], run.metadata.get("run", {})
    for name, channel in run.channels.items():
        tally = run.tallies.get(("measured", name)) or run.tallies.get(("predicted", name))
        calibrated = noted.get(f"{CALIBRATED}{name}", DASH)
        sensitivity = _sensitivity(channel, noted.get(f"{SENSITIVITY}{name}", ""))
        full_scale = number(scale_of(noted, RANGE, name), channel.unit)
        words = [channel.sensor or DASH, channel.serial or DASH, sensitivity, full_scale, calibrated]
        sensors.append([name, *words, number(tally.sample_rate if tally else None, "Hz")])
    headings = ("channel", "sensor", "serial", "sensitivity", "range", "calibrated", "sample rate")
    return [*facts, Table(headings, sensors, "Sensors", words=True)]

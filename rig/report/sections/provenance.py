"""Where the numbers come from."""

from __future__ import annotations

from rig.report.content import Part, Sentence, Table
from rig.report.record import RunRecord
from rig.report.sections.numbers import DASH, number


def parts(run: RunRecord) -> list[Part]:
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

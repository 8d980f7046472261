"""Derived channels of a live run and of a replay: the same code between the blocks and the other sinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from daq.channel import Channel
from daq.clock import Clock
from daq.errors import ConfigurationError, LogError
from daq.log.reader import LogReader, Origin
from rig.derived.background import InBackground
from rig.derived.settings import RECORD, from_record
from rig.derived.sink import ORIGINS, DerivedSink, Onward
from rig.files.scenario import Scenario
from rig.twin.overlay import scenario_of


def derive_live(
    channels: Mapping[Origin, Sequence[Channel]], scenario: Scenario, clock: Clock
) -> InBackground:
    """A sink for the run of these channels; its worker is still to be started."""
    names = {origin: tuple(channel.name for channel in each) for origin, each in channels.items()}
    return InBackground(names, scenario, clock)


def derive_again(log: LogReader, onward: Onward) -> DerivedSink:
    """What derives from a log's samples what the run derived, by what was settled then.

    Where the log does not say, it is settled by the same rule; raises LogError where it cannot be read.
    """
    try:
        scenario = scenario_of(log)
    except (LogError, ConfigurationError):
        scenario = None  # another program's log: there are impacts, but no cycles
    channels = {origin: list(log.channels(origin)) for origin in ORIGINS}
    return DerivedSink(onward, channels, scenario, from_record(log.metadata.get(RECORD, {})))

"""The sink that derives: it takes what was measured and predicted and hands on what follows from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.channel import Channel
from daq.derived_names import CRANK_SPEED, CYCLE_PEAK, CYCLE_RMS, derived_name
from daq.log.reader import Origin
from daq.log.records import Event, Impact
from rig.derived.origin import OriginDeriver
from rig.derived.reference import nominal_of, reference_of
from rig.derived.settings import RECORD, Settings, as_record, has_figures, role_of
from rig.files.scenario import Scenario
from sim_twin.rigs.channel_table import Role

ORIGINS: tuple[Origin, ...] = ("measured", "nominal", "predicted")


class Onward(Protocol):
    """Who gets what is derived: a hub of the other sinks."""

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Take a block."""
        ...

    def impact(self, impact: Impact) -> None:
        """Take an impact."""
        ...


Note = Callable[[str, Mapping[str, str]], None]


class DerivedSink:
    """Derives each origin by itself, in the thread that brings the blocks; one thread at a time.

    `channels` are those of each origin. `known` is what a log says was settled when it was recorded; what it
    does not say is settled by the rule, and told by `note` as a metadata record.
    """

    def __init__(
        self,
        onward: Onward,
        channels: Mapping[Origin, Iterable[str]],
        scenario: Scenario | None,
        known: Mapping[str, Settings] | None = None,
        note: Note = lambda name, record: None,
    ) -> None:
        nominal = None if scenario is None else nominal_of(scenario)
        self._onward, self._note = onward, note
        self._known = dict(known or {})
        self._derivers = {
            origin: OriginDeriver(origin, channels[origin], nominal, self._known.get(origin))
            for origin in ORIGINS
            if origin in channels
        }

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Derive from a block."""
        deriver = self._derivers.get(origin)
        if deriver is not None:
            deriver.add(block, self._emit)
            self._tell(origin, deriver)

    def finish(self) -> None:
        """Hand on what waits for more: no more will come."""
        for origin, deriver in self._derivers.items():
            deriver.finish(self._emit)
            self._tell(origin, deriver)

    def event(self, event: Event) -> None:
        """Nothing follows from an event."""

    def impact(self, impact: Impact) -> None:
        """Nothing follows from an impact."""

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Nothing follows from a shape."""

    def _tell(self, origin: Origin, deriver: OriginDeriver) -> None:
        if deriver.settings is not None and origin not in self._known:
            self._known[origin] = deriver.settings
            self._note(RECORD, as_record(self._known))

    def _emit(self, found: SampleBlock | Impact) -> None:
        if isinstance(found, SampleBlock):
            self._onward.block("derived", found)
        else:
            self._onward.impact(found)


def derived_channels(
    channels: Mapping[Origin, Iterable[Channel]], scenario: Scenario | None = None
) -> list[Channel]:
    """Every channel that may be derived from the channels of each origin, as a log declares it."""
    found: list[Channel] = []
    for origin in ORIGINS if scenario is not None else ():
        declared = tuple(channels.get(origin, ()))
        reference = reference_of(tuple(channel.name for channel in declared))
        if reference is None:
            continue
        if role_of(reference) is not Role.DRIVE:
            found.append(Channel(derived_name(origin, CRANK_SPEED), "rpm", "speed", "crank"))
        for channel in declared:
            if has_figures(channel.name):
                found += [_figure(origin, channel, which) for which in (CYCLE_RMS, CYCLE_PEAK)]
    return found


def _figure(origin: Origin, channel: Channel, which: str) -> Channel:
    name = derived_name(origin, channel.name, which)
    return Channel(name, channel.unit, channel.quantity, channel.location)

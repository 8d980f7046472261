"""What follows from the records of a stream, and which channels that makes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from daq.channel import Channel
from daq.derived_names import CRANK_SPEED, CYCLE_PEAK, CYCLE_RMS, derived_name
from daq.log.reader import Origin
from rig.derived.reference import nominal_of, reference_of
from rig.derived.settings import RECORD, Settings, as_record, has_figures, role_of
from rig.files.scenario import Scenario
from rig.stream import Block, Consumer, Metadata, Record
from sim_twin.rigs.channel_table import Role

ORIGINS: tuple[Origin, ...] = ("measured", "nominal", "predicted")


class Derivation:
    """Derives each origin by itself, in the thread that brings the blocks; one thread at a time.

    `channels` are those of each origin. `known` is what a log says was settled when it was recorded; what it
    does not say is settled by the rule, and published as a metadata record.
    """

    def __init__(
        self,
        publish: Consumer,
        channels: Mapping[Origin, Iterable[str]],
        scenario: Scenario | None,
        known: Mapping[str, Settings] | None = None,
    ) -> None:
        from rig.derived.per_source import OriginDeriver  # with the compiler, which who records need not load

        nominal = None if scenario is None else nominal_of(scenario)
        self._publish = publish
        self._known = dict(known or {})
        self._derivers = {
            origin: OriginDeriver(origin, channels[origin], nominal, self._known.get(origin))
            for origin in ORIGINS
            if origin in channels
        }

    def __call__(self, record: Record) -> None:
        match record:
            case Block(origin, samples) if origin in self._derivers:
                self._derivers[origin].add(samples, self._publish)
                self._tell(origin)

    def finish(self) -> None:
        """Publish what waits for more: no more will come."""
        for origin, deriver in self._derivers.items():
            deriver.finish(self._publish)
            self._tell(origin)

    def _tell(self, origin: Origin) -> None:
        settings = self._derivers[origin].settings
        if settings is not None and origin not in self._known:
            self._known[origin] = settings
            self._publish(Metadata(RECORD, as_record(self._known)))


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

"""Watches all sensors of a bench with nothing driven: what moves the rig is not even connected to."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType

from daq.block import NS_PER_S
from daq.clock import Clock
from daq.errors import InstrumentError
from daq.log.records import Event
from daq.signals.at_rest import Tap
from daq.time_base.run_clock import RunClock
from drivers.lock import lock
from drivers.protocols.card import AcquisitionCard, CardReading
from drivers.protocols.encoder import PositionEncoder
from drivers.protocols.instrument import Logger
from rig.files.bench import Bench
from rig.session.acquisition import Acquisition
from rig.session.at_rest import Sensors
from rig.session.devices import InstrumentsMissing
from rig.session.encoder_record import ENCODER_CHANNEL, EncoderRecord
from rig.session.interlock import LimitWatch, guards_of_shaft
from rig.session.logger_record import LoggerRecord
from rig.stream import Block, Record, Stream

_FASTEST_RAD_S = 60.0
"""Of a shaft that a hand turns: what an encoder on a bus counts on where positions are missing."""
_LOOK_S = 0.1
_KEPT = 200


@dataclass(frozen=True, slots=True)
class Instruments:
    """What measures on a bench, not opened yet."""

    card: AcquisitionCard
    encoder: PositionEncoder | None
    loggers: Mapping[str, Logger]

    @property
    def all(self) -> Sequence[AcquisitionCard | PositionEncoder | Logger]:
        return [self.card, *([] if self.encoder is None else [self.encoder]), *self.loggers.values()]


class Monitor:
    """Reads what measures on a bench while the context lasts; each instrument is locked as for a run.

    `sensors` know what all show, `seen` what was seen and said of late, level and text, `tap` is the newest
    tap, None once somebody has taken it. While it `tells_of_turns` each that came to its end is among these.
    """

    def __init__(self, bench: Bench, instruments: Instruments, clock: Clock) -> None:
        self._bench, self._instruments, self._clock = bench, instruments, RunClock(clock)
        self._open = ExitStack()
        self._came, self._told = deque[CardReading](), deque[Record]()
        self.sensors: Sensors
        self.seen = deque[tuple[str, str]](maxlen=_KEPT)
        self.unread = deque[str]()
        """What of it nobody has said yet."""
        self.tap: Tap | None = None
        self.tells_of_turns = True

    def __enter__(self) -> Monitor:
        with ExitStack() as opening:
            self._connect(opening)
            card, stream = self._instruments.card, Stream([self._told.append])
            limits = LimitWatch((), card.sample_rate)
            self._acquisition = Acquisition(card, self._clock, stream, limits, [self._came.append])
            channels = {each.name: each for each in self._bench.daq_card.channels}
            sheets = getattr(card, "sheets", {})  # a card of another package may read none
            chains = [channels[each.name] for each in card.channels]
            self.sensors = Sensors(chains, card.channels, card.sample_rate, sheets)
            for warning in card.warnings:
                self._tell("warning", warning)
            opening.enter_context(self._acquisition)
            base, self._positions = self._acquisition.base, None
            if self._instruments.encoder is not None:
                _, guard = guards_of_shaft(self._clock)
                encoder = self._instruments.encoder
                self._positions = EncoderRecord(encoder, base, stream, _FASTEST_RAD_S, guard)
                opening.enter_context(self._positions)
            for logger in self._instruments.loggers.values():
                opening.enter_context(LoggerRecord(logger, base, stream)).begin(0.0, math.inf)
            self._open = opening.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)

    def _connect(self, opening: ExitStack) -> None:
        errors: list[InstrumentError] = []
        for device in self._instruments.all:
            try:
                opening.enter_context(lock(device.name, device.address))
                opening.callback(device.close)
                device.open()
            except InstrumentError as error:
                errors.append(error)
        if errors:
            raise errors[0] if len(errors) == 1 else InstrumentsMissing(errors)

    @property
    def newest_unix_s(self) -> float:
        """When the newest sample was taken."""
        return self._acquisition.base.unix_ns(self.sensors.end_s) / NS_PER_S

    def look(self) -> None:
        """Look at what has come, 0.1 s long at most; raises what ended the reading."""
        with self._acquisition.changed:
            self._acquisition.changed.wait(_LOOK_S)
        self._acquisition.check()
        if self._positions is not None:
            self._look_at_positions(self._positions)
        while self._told:
            self._note(self._told.popleft())
        while self._came:
            if (tap := self.sensors.take(self._came.popleft())) is not None:
                self.tap = tap
                self._tell("info", f"tap: {self.sensors.tapped(tap)}")
        turn = self.sensors.shaft.rested(self.sensors.end_s) if self.tells_of_turns else None
        if turn is not None:
            self._tell("info", f"turn: {turn}")

    def _look_at_positions(self, positions: EncoderRecord) -> None:
        if positions.error is not None:
            raise positions.error
        self._told.extend(positions.events())
        times_s, angle = positions.seen()
        self.sensors.shaft.beside(ENCODER_CHANNEL, times_s, angle)
        if len(angle):
            self.sensors.beside[ENCODER_CHANNEL] = "rad", float(angle[-1])

    def _note(self, record: Record) -> None:
        match record:
            case Event():
                self._tell(record.level, record.text)
            case Block(_, samples) if samples.channel != ENCODER_CHANNEL and len(samples):
                units = {
                    channel.name: channel.unit
                    for logger in self._instruments.loggers.values()
                    for channel in logger.channels
                }
                self.sensors.beside[samples.channel] = units[samples.channel], float(samples.values[-1])

    def _tell(self, level: str, text: str) -> None:
        self.seen.append((level, text))
        self.unread.append(text if level == "info" else f"! {text}")

"""A CANopen encoder that sends its position by itself, at a steady period."""

from __future__ import annotations

from contextlib import suppress

from daq.clock import Clock, SystemClock
from daq.errors import (
    ConfigurationError,
    DeviceLost,
    InstrumentAbsent,
    InstrumentError,
    InstrumentRefused,
    InstrumentSilent,
)
from drivers.canopen_cia406 import objects, startup
from drivers.canopen_cia406.frames import NmtCommand, NmtState
from drivers.canopen_cia406.link import CanLink
from drivers.canopen_cia406.objects import PositionLayout
from drivers.canopen_cia406.order import most_held
from drivers.canopen_cia406.settings import EncoderSettings, problems
from drivers.canopen_cia406.stream import HEARTBEATS_MISSED, PositionStream
from drivers.protocols.encoder import Emergency, PositionBlock, PositionStatistics
from drivers.protocols.instrument import Notice

HEARTBEAT_S = 0.2
"""Three of these are longer than a busy machine stalls, and well within a second."""
_SLOWEST_HEARTBEAT_S = 0.3
"""Three of these are 0.9 s: a lost encoder is to be noticed within a second."""
_ANSWER_MARGIN_S = 0.2  # by which a lost heartbeat is told before a read gives up


class CanopenEncoder:
    """A `PositionEncoder` over CiA 406; see `EncoderSettings` for what it must be."""

    def __init__(self, settings: EncoderSettings, clock: Clock | None = None) -> None:
        self.settings = settings
        self.name, self.address = settings.name, settings.address
        self.identity = ""
        self.counts_per_revolution = self.total_range = 0
        self.period_s = settings.period_s
        self._stream = PositionStream(settings)
        self._link = CanLink(settings, self._stream, clock or SystemClock())
        self._layout: PositionLayout | None = None
        self._heartbeat_s = HEARTBEAT_S

    @property
    def emergencies(self) -> tuple[Emergency, ...]:
        """The emergencies that the encoder has not taken back; may be asked by any thread."""
        return self._stream.emergencies

    @property
    def statistics(self) -> PositionStatistics:
        return self._stream.statistics

    def open(self) -> None:
        """Connect, verify, require a heartbeat, set the period; see `PositionEncoder.open`."""
        found = problems(self.settings)
        if found:
            raise ConfigurationError(self.name, found)
        # No silent resume: whatever was known of it before is read and compared once more.
        self.close()  # one that was lost may still be heard, and two threads would hear everything twice
        self._stream.connected()
        self._link.open()
        try:
            # A node that an earlier client left operational must not send while it is being read.
            self._link.command(NmtCommand.ENTER_PRE_OPERATIONAL)
            said = startup.read(self._link, self.settings)
            differences = startup.differences(said, self.settings)
            if differences:
                what = f"it is not the encoder of the bench file: {'; '.join(differences)}"
                raise InstrumentAbsent(self.name, self.address, what, "which encoder it is, and its settings")
            self.identity = said.identity()
            self.counts_per_revolution = said.counts_per_revolution or 0
            self.total_range = said.total_range or 0
            self._layout = PositionLayout.of(said.mapped)
            self._require_heartbeat()
            self._link.download(objects.CYCLIC_TIMER, self.settings.period_ms)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let it send no more, if it can still hear that, and hang up."""
        if self._layout is not None:
            with suppress(InstrumentError):
                self.stop()
        self._layout = None
        self._link.close()

    def preset(self, counts: int) -> None:
        """Let the encoder call its present position `counts`; many keep that for good."""
        self._opened()
        # What a device makes of a preset beyond its range is not for it to choose.
        if not 0 <= counts < self.total_range:
            what = f"preset {counts} is outside 0 to {self.total_range - 1} counts; nothing was sent"
            raise InstrumentRefused(self.name, self.address, what, code="limit")
        self._link.download(objects.PRESET, counts)

    def start(self) -> None:
        """Let it send positions; returns when its heartbeat says that it does."""
        layout = self._opened()
        self._stream.begin(layout, self.total_range, self._heartbeat_s)
        self._link.command(NmtCommand.START)
        # NMT commands are not answered: only the next heartbeat says what became of this one.
        if not self._stream.await_heartbeat(self._beat_deadline_s(), NmtState.OPERATIONAL):
            what = "it does not become operational"
            raise InstrumentRefused(self.name, self.address, what, "its error register and emergencies")

    def read(self, count: int) -> PositionBlock:
        """Wait for the next `count` positions; see `PositionEncoder.read`."""
        self._opened()
        # Long enough for heartbeats to tell a silent encoder from a lost one.
        late_s = max(self.settings.timeout_s, HEARTBEATS_MISSED * self._heartbeat_s + _ANSWER_MARGIN_S)
        return self._stream.take(count, (count + most_held(self.period_s)) * self.period_s + late_s)

    def take_notices(self) -> tuple[Notice, ...]:
        return self._stream.take_notices()

    def stop(self) -> None:
        """Let it send no more; it stays as it was configured."""
        self._opened()
        self._stream.end()
        self._link.command(NmtCommand.ENTER_PRE_OPERATIONAL)

    def _opened(self) -> PositionLayout:
        if self._layout is None:
            raise DeviceLost(self.name, self.address, "the encoder is not open")
        return self._layout

    def _require_heartbeat(self) -> None:
        """A heartbeat that was never there cannot be missed (CiA 301, 7.2.8.3.2.2): wait for the first."""
        heartbeat_ms = self._link.upload(objects.HEARTBEAT_TIME)
        if not 0 < heartbeat_ms <= _SLOWEST_HEARTBEAT_S * 1e3:
            heartbeat_ms = round(HEARTBEAT_S * 1e3)
            self._link.download(objects.HEARTBEAT_TIME, heartbeat_ms)
        self._heartbeat_s = heartbeat_ms * 1e-3
        if not self._stream.await_heartbeat(self._beat_deadline_s()):
            what = f"no heartbeat within {self._beat_deadline_s():.2g} s, although it is to send one every "
            raise InstrumentSilent(self.name, self.address, f"{what}{heartbeat_ms} ms", "its firmware")

    def _beat_deadline_s(self) -> float:
        return 3.0 * self._heartbeat_s + self.settings.timeout_s  # s

"""What a log gets besides samples while a run goes on: events, and how the clocks lie."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import TracebackType

from daq.errors import RecorderFailed
from daq.log.records import ClockRecord, Event
from daq.recorder import Recorder
from daq.time_base.run_clock import RunClock
from drivers.protocols.notice import Notice
from rig.session.hub import Hub
from rig.session.progress import Screen

_EVERY_S = 1.0


class Logbook:
    """Writes what is told, and once a second what `events` and `clocks` have to say.

    `events` gives what devices did since it was last asked, `clocks(at_last)` records where there is news.
    What is no mere information also goes to the screen. Leaving its context writes what is left; a log that
    takes nothing more is then no second error.
    """

    def __init__(self, clock: RunClock, recorder: Recorder, hub: Hub, screen: Screen) -> None:
        self._clock, self._recorder, self._hub, self._screen = clock, recorder, hub, screen
        self._looked_s = clock.monotonic_s()
        self.events: list[Callable[[], tuple[Event, ...]]] = []
        self.clocks: list[Callable[[bool], list[ClockRecord]]] = []

    def tell(self, level: str, code: str, text: str) -> None:
        """Note an event of the rig itself, now."""
        self._hub.event(Event(self._clock.unix_ns(), level, "rig", code, text))

    def stamped(self, source: str, notices: Iterable[Notice]) -> tuple[Event, ...]:
        """Events of what an instrument told by the monotonic clock, at the run's time."""
        return tuple(
            Event(self._clock.at_ns(told.arrival_s), told.level, source, told.code, told.text)
            for told in notices
        )

    def note(self, event: Event) -> None:
        """Write down what a device or worker has to say."""
        self._hub.event(event)
        if event.level != "info":
            self._screen.warn(f"{event.source}: {event.text}")

    def look(self) -> None:
        """Ask for news, if the last time was a second ago."""
        if self._clock.monotonic_s() - self._looked_s >= _EVERY_S:
            self._looked_s = self._clock.monotonic_s()
            self._ask(at_last=False)

    def __enter__(self) -> Logbook:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._ask(at_last=True)
        except RecorderFailed:
            if error is None:
                raise

    def _ask(self, at_last: bool) -> None:
        set_by_somebody = self._clock.look()
        told = () if set_by_somebody is None else (set_by_somebody,)
        for event in (*told, *(event for ask in self.events for event in ask())):
            self.note(event)
        for clocks in self.clocks:
            for record in clocks(at_last):
                self._recorder.clock_record(record)

"""A Mitsubishi FR inverter for code that knows no event loop."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import TimeoutError as NotDone
from typing import Any, TypeVar

from daq.clock import Clock, SystemClock
from daq.errors import DeviceLost, EmergencyStop, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr.conversation import Conversation
from drivers.mitsubishi_fr.line import LineHealth, SerialLine
from drivers.mitsubishi_fr.motor import Motor, OvertakenOrder
from drivers.mitsubishi_fr.poller import Poller
from drivers.mitsubishi_fr.registers import RUNNING_FREQUENCY
from drivers.mitsubishi_fr.settings import InverterSettings, described, warnings
from drivers.protocols.instrument import Notice, Notices
from drivers.protocols.speed_drive import MotorState

ORDER_S = 3.0  # an order that is not complete by then is an error, and nothing more of it is sent
HANGS_S = 30.0  # no coroutine here takes so long but a stop on a long ramp, which says so itself

_T = TypeVar("_T")


class FrInverter:
    """A `SpeedDrive`. Its line is polled in a thread of its own from `open` to `close`.

    Calls wait for that thread; `state` and `health` only tell what it has found. Orders, stops, `read` and
    `check` say that somebody looks after the motor.
    """

    def __init__(self, settings: InverterSettings, clock: Clock | None = None) -> None:
        self.settings = settings
        self.name, self.address = settings.name, settings.port
        self.identity = ""
        self.warnings: tuple[str, ...] = ()
        self._clock = clock or SystemClock()
        self._notices = Notices(self._clock)
        self._open: _Open | None = None

    @property
    def state(self) -> MotorState | None:
        """What it said last; None before the first answer."""
        return self._open.motor.state if self._open else None

    @property
    def health(self) -> LineHealth | None:
        """What went wrong on its line since it was opened; None while it is closed."""
        return self._open.line.health if self._open else None

    @property
    def emergency_stop(self) -> EmergencyStop | None:
        """What its terminal has shown of the emergency stop since it was opened."""
        error = self._open.poller.error if self._open else None
        return error if isinstance(error, EmergencyStop) else None

    @property
    def step_rpm(self) -> float:
        """The smallest step of the set speed: 0.01 Hz."""
        return RUNNING_FREQUENCY.scale * self.settings.rpm_per_hz

    @property
    def longest_stop_s(self) -> float:
        """By when a stop has ended or raised; 30 s and the ramps from the highest speed."""
        return self._open.longest_stop_s if self._open else HANGS_S

    @property
    def busy(self) -> bool:
        return self._open is not None and self._open.at_work > 0

    def ramp_s(self, from_rpm: float, to_rpm: float) -> float:
        """Return the time of a ramp by its parameters; 0 while it is closed."""
        per_hz = self.settings.rpm_per_hz
        return self._open.motor.parameters.ramp_s(from_rpm / per_hz, to_rpm / per_hz) if self._open else 0.0

    def open(self) -> None:
        """Connect, check parameters and watchdog, and poll from now on; nothing is written."""
        self.close()
        session = _Open(self.settings, self._clock, self._notices)
        try:
            session.run(session.line.open())
            session.run(session.poller.check_in())
        except BaseException:
            session.end()
            raise
        self._open = session
        self.identity = described(session.motor.parameters, self.settings.station)
        self.warnings = warnings(session.motor.parameters, self.settings)

    def close(self) -> None:
        """Stop the motor if it may be turning, answer or not, and hang up."""
        if self._open is not None:
            session, self._open = self._open, None
            session.end()

    def arm(self, rpm: float) -> float:
        self._attend().motor.orders.stopped = False
        return self.set_speed(rpm)

    def set_speed(self, rpm: float) -> float:
        """Set the speed; refused outside 0 to the bench's maximum, NaN included, before anything is sent."""
        if not 0.0 <= rpm <= self.settings.maximum_speed_rpm:
            what = f"{rpm:g} rpm is outside 0 to {self.settings.maximum_speed_rpm:g} rpm; nothing was sent"
            check = "the speed asked for and the bench's maximum_speed"
            raise InstrumentRefused(self.name, self.address, what, check, "limit")
        session, per_hz = self._attend(), self.settings.rpm_per_hz
        return per_hz * session.order(lambda until_s: session.motor.set_frequency(rpm / per_hz, until_s))

    def start(self) -> None:
        session = self._attend()
        session.order(session.motor.run_forward)

    def stop(self, measured_rpm: Callable[[], float] | None = None) -> None:
        """Stop in category 1; see `SpeedDrive.stop`. Does so also after an error."""
        # Not through `_attend`: a stop must go out after an error as well, which that would raise instead.
        if (session := self._stopping()) is None:
            return
        per_hz = self.settings.rpm_per_hz
        session.poller.attended_s = self._clock.monotonic_s()  # a stop shows too that somebody looks
        # Asked in the loop's thread with each look: `measured_rpm` must not wait.
        measured_hz = None if measured_rpm is None else lambda: measured_rpm() / per_hz
        session.run_stop(session.poller.stop(measured_hz))

    def cut(self) -> None:
        """Withdraw run at once; see `SpeedDrive.cut`."""
        if (session := self._stopping()) is not None:
            session.run_stop(session.poller.cut())

    def read(self) -> MotorState:
        session = self._attend()
        return session.run(session.poller.look())

    def check(self) -> None:
        self._attend()

    def take_notices(self) -> tuple[Notice, ...]:
        return self._notices.take()

    def _stopping(self) -> _Open | None:
        """What has to stop, if anything may turn; nothing starts from now on until it is armed anew."""
        if (session := self._open) is None:
            return None
        session.motor.orders.stopped = True
        return session if session.motor.orders.may_turn else None

    def _attend(self) -> _Open:
        if self._open is None:
            what = "the connection is closed"
            raise DeviceLost(self.name, self.address, what, "that it was opened")
        self._open.poller.attended_s = self._clock.monotonic_s()
        if self._open.poller.error is not None:
            raise self._open.poller.error
        return self._open


class _Open:
    """What exists only while the inverter is open: its event loop, its line, and who looks after it."""

    def __init__(self, settings: InverterSettings, clock: Clock, notices: Notices) -> None:
        self._settings, self._clock = settings, clock
        self._loop = asyncio.new_event_loop()
        self.at_work = 0  # what callers wait for, as the loop's thread counts it
        # A loop and a thread of its own: polls go on while the caller is busy elsewhere.
        self._thread = threading.Thread(target=self._loop.run_forever, name=settings.name, daemon=True)
        self.line = SerialLine(settings, clock.monotonic_s)
        talk = Conversation(settings.name, settings.port, settings.station, self.line, clock.monotonic_s)
        self.motor = Motor(settings, talk, clock, notices)
        self.poller = Poller(settings, self.motor, talk, self.line.health, clock, notices)
        self._thread.start()

    @property
    def longest_stop_s(self) -> float:
        """How long a stop may take before it must have raised by itself."""
        if not self.motor.parameters.raw:  # it never came so far as to be told anything
            return HANGS_S
        return HANGS_S + self.motor.longest_stop_s(self._settings.maximum_hz)

    def end(self) -> None:
        """Stop, however long the steps of a stop take, hang up and end the thread. Never raises."""
        try:
            self.run(self._shut(), self.longest_stop_s)
        except InstrumentError:
            pass  # what is wrong with a drive that is being given up is in its notices
        finally:
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(HANGS_S)
            if not self._thread.is_alive():
                self._loop.close()

    async def _shut(self) -> None:
        try:
            await self.poller.close()
        finally:
            self.line.close()

    async def _counted(self, work: Coroutine[Any, Any, _T]) -> _T:
        self.at_work += 1
        try:
            return await work
        finally:
            self.at_work -= 1

    def order(self, order: Callable[[float], Coroutine[Any, Any, _T]]) -> _T:
        """Give an order that is void 3 s from now."""
        return self.run(self.poller.order(order(self._clock.monotonic_s() + ORDER_S)), 2.0 * ORDER_S)

    def run_stop(self, stop: Coroutine[Any, Any, None]) -> None:
        self.run(stop, self.longest_stop_s, "its stop, which goes on, has not ended")

    def run(self, work: Coroutine[Any, Any, _T], within_s: float = HANGS_S, late: str = "no answer") -> _T:
        """Run a coroutine in the loop's thread and return what it returns.

        Raises InstrumentSilent where that is `late`; the poller's stops go on then.
        """
        future = asyncio.run_coroutine_threadsafe(self._counted(work), self._loop)
        name, address = self._settings.name, self._settings.port
        try:
            return future.result(within_s)
        except InstrumentError:
            raise  # an InstrumentSilent is a TimeoutError too
        except NotDone as error:
            future.cancel()  # what was under way ends at its next wait; a stop is shielded
            what = f"{late} within {within_s:g} s"
            raise InstrumentSilent(name, address, what, "the load of this machine") from error
        except OvertakenOrder as error:
            raise InstrumentRefused(name, address, f"not done: {error}", "", "overtaken") from error

"""Polls an inverter for as long as it is open, and stops it where anything is wrong with it.

All of it runs in the event loop of one `FrInverter`, in that inverter's own thread. A poll that went on by
itself would keep the drive's watchdog quiet while the program that ordered the motor hangs: so it stops a
running motor that nobody has looked after, and once a stop cannot be seen to work nothing is sent any more.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, TypeVar

from daq.clock import Clock
from daq.errors import (
    DeviceLost,
    EmergencyStop,
    InstrumentError,
    InstrumentRefused,
    InstrumentSilent,
    show_fault,
)
from drivers.mitsubishi_fr.conversation import DEVICE_FAILURE, Conversation
from drivers.mitsubishi_fr.line import LineHealth
from drivers.mitsubishi_fr.motor import NOT_OBEYED, STANDSTILL_HZ, Motor
from drivers.mitsubishi_fr.settings import InverterMisconfigured, InverterSettings, problems
from drivers.protocols.instrument import Notices
from drivers.protocols.speed_drive import MotorState

_GONE = (DeviceLost, InstrumentSilent)
_T = TypeVar("_T")


class Poller:
    """Looks after a motor from `check_in` to `close`; the first error that endangers it stays in `error`.

    An emergency stop that is read later takes its place.
    """

    def __init__(
        self,
        settings: InverterSettings,
        motor: Motor,
        talk: Conversation,
        health: LineHealth,
        clock: Clock,
        notices: Notices,
    ) -> None:
        self._settings, self._motor, self._talk, self._health = settings, motor, talk, health
        self._clock, self._notices = clock, notices
        self._stops: set[asyncio.Task[None]] = set()  # a loop alone keeps no task alive
        self._watch: asyncio.Task[None] | None = None
        # When the last look began, and when the program last called the driver, in s of the monotonic clock.
        self._looked_s = self.attended_s = clock.monotonic_s()
        self._was_degraded = self._closing = False
        self.error: InstrumentError | None = None
        self._failed = asyncio.Event()  # set with it
        self._orders: set[asyncio.Task[Any]] = set()

    async def check_in(self) -> None:
        """Check the parameters, that it has not tripped and that it stands, then begin to poll.

        Nothing is written, whatever is found.
        """
        found = await self._motor.read_parameters()
        wrong = problems(found, self._settings)
        if wrong:
            raise InverterMisconfigured(self._settings.name, self._settings.port, wrong)
        await self._motor.heed_stop_line()
        state = await self._motor.look()
        if state.fault:
            raise self._tripped(state)
        self._refuse_running(state)
        self.attended_s = self._looked_s = self._clock.monotonic_s()
        self._watch = asyncio.create_task(self._keep())

    async def order(self, order: Coroutine[Any, Any, _T]) -> _T:
        """Give an order; where the drive fails or does not follow it, stop it before the error is raised.

        An error that is met meanwhile, whose own stop is under way by then, ends it, whatever it waits for.
        """
        if self.error is not None:
            order.close()
            raise self.error
        giving, failed = asyncio.create_task(order), asyncio.create_task(self._failed.wait())
        self._orders.add(giving)
        giving.add_done_callback(self._forget)
        try:
            await asyncio.wait({giving, failed}, return_when=asyncio.FIRST_COMPLETED)
            if self.error is not None and (giving.cancelled() or not giving.done()):
                raise self.error
            return await giving
        except InstrumentRefused as error:
            if error.code in (NOT_OBEYED, DEVICE_FAILURE):
                await self._make_safe(error)
            raise
        finally:
            failed.cancel()
            giving.cancel()  # it gives way at the end of its exchange, which may take as long as an answer

    def _forget(self, order: asyncio.Task[Any]) -> None:
        self._orders.discard(order)
        if not order.cancelled():
            order.exception()  # that it was overtaken: whoever gave it has been told more

    async def stop(self, measured_hz: Callable[[], float] | None = None) -> None:
        """Stop the motor; one that cannot be seen to stop stays an error.

        Goes on where whoever waits for it gives up; what goes wrong then stands in `error`.
        """
        await self._carry_through(self._stop(self._motor.stop(measured_hz)))

    async def cut(self) -> None:
        """Withdraw run at once, on a ramp as well; one that cannot be seen to stop stays an error."""
        await self._carry_through(self._stop(self._motor.withdraw()))

    async def _carry_through(self, stop: Coroutine[Any, Any, None]) -> None:
        """Wait for a stop, which goes on where the wait is cancelled: half a stop stops nothing."""
        task = asyncio.create_task(stop)
        self._stops.add(task)
        task.add_done_callback(self._stops.discard)
        await asyncio.shield(task)

    async def _stop(self, stop: Coroutine[Any, Any, None]) -> None:
        try:
            await stop
        except InstrumentError as error:
            self._latch(error)
            raise

    async def look(self) -> MotorState:
        """Ask the drive how it is."""
        return await self._motor.look(self._health.degraded)

    async def close(self) -> None:
        """Stop what may be turning, hand the drive back, and cease to poll. Never raises."""
        if self._motor.orders.may_turn:
            with suppress(InstrumentError):
                await self._carry_through(self._motor.stop())
                await asyncio.gather(*self._stops, return_exceptions=True)
                await self._motor.hand_back()
        if self._watch is not None:
            # Before Python 3.12 wait_for swallows a cancellation that comes together with an answer.
            self._closing = True
            self._watch.cancel()
            with suppress(asyncio.CancelledError):
                await self._watch
        await asyncio.gather(*self._stops, *self._orders, return_exceptions=True)

    async def _keep(self) -> None:
        while not self._closing:
            began_s = self._clock.monotonic_s()
            try:
                await self._look_after(began_s)
            except InstrumentError as error:
                self._begin_to_make_safe(self._unread_line(error))
                if isinstance(error, _GONE):
                    return  # a drive that comes back is a matter for a person
            except Exception as error:  # top of a task: a fault of ours must stop the motor like any other
                what = f"its keeper failed: {type(error).__name__}: {error}"
                try:
                    await self._make_safe(self._motor.refused(what))
                finally:  # nobody waits for a terminal that hangs, this loop least of all
                    threading.Thread(target=show_fault, args=(error,), daemon=True).start()
                return
            self._looked_s = began_s
            # half as long beside a stop, whose own looks take their turns on the line
            period_s = self._settings.period_s / (2.0 if self._stops else 1.0)
            await asyncio.sleep(max(period_s - (self._clock.monotonic_s() - began_s), 0.0))

    def _unread_line(self, error: InstrumentError) -> InstrumentError:
        """An emergency stop where its line is on a drive that is gone: the chain may have cut its power."""
        line = self._settings.stop_line
        if line is None or self.error is not None or not isinstance(error, _GONE):
            return error
        what = f"its line cannot be read: {error.what}"
        return EmergencyStop.unread(
            line.at(self._settings.port), what, self._clock.monotonic_s(), error.check
        )

    async def _look_after(self, now_s: float) -> None:
        # A process that was frozen (SIGSTOP, swap) for longer than the watchdog waits finds a drive that has
        # tripped or coasts; its own orders are of before, and none of them may go on.
        slept_s = now_s - self._looked_s
        longest_s = self._motor.parameters.watchdog_s + self._settings.silent_s
        if self.error is None and slept_s > longest_s:
            raise self._motor.refused(f"this program did not look at it for {slept_s:.1f} s", "", "late")
        orders = self._motor.orders
        given = orders.given  # an order that comes while the drive is asked makes the answer one of before
        try:
            if not isinstance(self.error, EmergencyStop):
                await self._motor.heed_stop_line()
            if self._stops:  # a stop looks by itself, and only a free line shows the emergency stop in time
                return
            state = await self.look()
        except InstrumentSilent:
            # A drive that is always busy is not silent and tells nothing either.
            seen_s = self._motor.state.at_s if self._motor.state else now_s
            blind = self._clock.monotonic_s() - seen_s > longest_s
            if not blind and self._clock.monotonic_s() < self._motor.silence_ends_s():
                return  # one answer missed; the next look follows
            raise
        if state.degraded and not self._was_degraded:
            self._notices.note("warning", "inverter.line", "more than 5 requests within 10 s went wrong")
        self._was_degraded = state.degraded
        if self.error is None:
            self._judge(state, steady=given == orders.given and orders.under_way == 0)

    def _judge(self, state: MotorState, steady: bool) -> None:
        orders = self._motor.orders
        if state.fault:
            raise self._tripped(state)
        # Only a motor that was told to run needs somebody: one that stands may wait for its operator.
        unattended_s = state.at_s - self.attended_s
        if orders.run and unattended_s > self._settings.unattended_s:
            raise self._motor.refused(f"nobody looked after it for {unattended_s:.1f} s", "", "unattended")
        if not steady:
            return
        if not orders.taken:
            self._refuse_running(state)
            return
        # Someone else's set value on our drive: a panel, a second master.
        set_hz = state.set_rpm / self._settings.rpm_per_hz
        if not orders.kept(set_hz):
            text = f"its set value is {set_hz:g} Hz and not {orders.target_hz:g} Hz"
            raise self._motor.refused(text, "which other program or panel commands it", "foreign")
        if not orders.obeyed(state.output_frequency_hz, state.at_s):
            text = f"its output is at {state.output_frequency_hz:g} Hz where {orders.due_hz:g} Hz is due"
            raise self._motor.refused(text, "load, stall prevention (OL), who else commands it", NOT_OBEYED)

    def _begin_to_make_safe(self, error: InstrumentError) -> None:
        """Do that while the polls go on, and the emergency stop's line is read on the way down."""
        if not self._latch(error):
            return
        task = asyncio.create_task(self._stop_for(error))
        self._stops.add(task)
        task.add_done_callback(self._stops.discard)

    async def _make_safe(self, error: InstrumentError) -> None:
        """Latch the error and stop the motor, unless that was done for one before it."""
        if self._latch(error):
            await self._stop_for(error)

    async def _stop_for(self, error: InstrumentError) -> None:
        """Stop the motor as that error allows; what goes wrong with it is noted."""
        if not self._motor.orders.may_turn:
            return
        # Of a drive that has tripped, is silent or lost no ramp can be seen, an emergency stop waits for
        # none: run is withdrawn at once.
        tripped = self._motor.state is not None and self._motor.state.fault != ""
        stop: Callable[[], Coroutine[Any, Any, None]] = self._motor.stop
        if tripped or isinstance(error, (*_GONE, EmergencyStop)):
            stop = self._motor.withdraw
        try:
            await self._carry_through(stop())
        except InstrumentError as worse:
            self._notices.note("error", "inverter.stop", str(worse))

    def _latch(self, error: InstrumentError) -> bool:
        pressed = isinstance(error, EmergencyStop) and not isinstance(self.error, EmergencyStop)
        if self.error is not None and not pressed:
            return False
        self.error = error
        self._motor.orders.void = True
        for order in self._orders:  # before one of them takes its turn, which a stop would wait for
            order.cancel()
        self._failed.set()
        self._notices.note("error", f"inverter.{error.code or type(error).__name__}", str(error))
        return True

    def _refuse_running(self, state: MotorState) -> None:
        """Raise for a motor that turns though nobody here has told it to."""
        if not state.running and state.output_frequency_hz <= STANDSTILL_HZ:
            return
        found = (
            f"it already runs: its output is at {state.output_frequency_hz:g} Hz ({state.speed_rpm:g} rpm), "
            f"its set value is {state.set_rpm:g} rpm; nothing was sent to it"
        )
        check = "who runs it (its panel, another program); stop it there, and wait until the motor stands"
        raise self._motor.refused(found, check, "running")

    def _tripped(self, state: MotorState) -> InstrumentRefused:
        check = "the motor and its load, then reset it at its panel"
        return self._motor.refused(f"it has tripped: {state.fault}", check, state.fault)

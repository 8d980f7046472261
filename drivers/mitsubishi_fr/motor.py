"""Looks at one inverter and gives it orders; every order is read back."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from daq.clock import Clock
from daq.errors import DeviceLost, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.conversation import Conversation
from drivers.mitsubishi_fr.registers import Command, Status
from drivers.mitsubishi_fr.settings import InverterSettings, Parameters, checked
from drivers.protocols.instrument import Notices
from drivers.protocols.speed_drive import MotorState

STEP_S = 1.0  # within it a single message has to be answered
OPENING_STEP_S = 3.0  # nothing turns yet: a line that is slow to wake may have its time
OBEYED_S = 0.2  # after it a set value that was acknowledged must read back
OBEY_GRACE_S = 0.5  # on top of 1.5 ramps: polls, and the drive's own 20 ms
RAMP_MARGIN = 1.5  # of a ramp's time, before it counts as overrun
STANDSTILL_HZ = 0.05  # five steps of the output frequency, which is read in 0.01 Hz
RUNS_ABOVE_HZ = 1.0  # the RUN signal comes with Pr.13, 0.5 Hz unless somebody changed it
RECONNECT_S = 0.4  # what a lost line is given to come back, below any watchdog's patience
WITHDRAWALS = 3  # tries; then silence, and the drive's own watchdog
LOOK_AGAIN_S = 0.02  # the drive's own 20 ms again
NOT_OBEYED = "not obeyed"
TOLERANCE = 0.01  # of the due frequency
SMALLEST_TOLERANCE_HZ = 0.1  # ten steps of the set value, where 1 % would be less


class OvertakenOrder(Exception):
    """A stop came, or too much time passed, before the order was complete: the rest of it is not sent."""


@dataclass(slots=True)
class Orders:
    """The last set frequency in Hz, whether to run, and by when the output has to be there (monotonic s).

    `ran`: it was told to run, and has not been seen to run no more. `taken`: network operation was chosen, so
    the motor may turn because of us. `under_way` orders are being given, `given` and `stops` count those that
    were. `stopped`: it is not to start until it is armed anew; for any thread to set. `void`: an error was
    met, and no order counts any more but stops.
    """

    target_hz: float = 0.0
    run: bool = False
    ran: bool = False
    taken: bool = False
    obey_by_s: float = 0.0
    under_way: int = 0
    given: int = 0
    stops: int = 0
    stopped: bool = False
    void: bool = False

    @property
    def may_turn(self) -> bool:
        """Whether the motor may turn because of us, now or by an order that is still under way."""
        return self.taken or self.under_way > 0

    @property
    def due_hz(self) -> float:
        """Where the output has to be."""
        return self.target_hz if self.run else 0.0

    def kept(self, set_hz: float) -> bool:
        """Whether the drive's set value is ours."""
        return abs(set_hz - self.target_hz) < 0.5 * fr.RUNNING_FREQUENCY.scale

    def obeyed(self, output_hz: float, at_s: float) -> bool:
        """Whether the output is where it has to be at `at_s`, or may still be on its way."""
        off_hz = abs(output_hz - self.due_hz)
        return at_s <= self.obey_by_s or off_hz <= max(TOLERANCE * self.due_hz, SMALLEST_TOLERANCE_HZ)


class Errand:
    """An order while it is given: meanwhile, what the drive does is not yet what it was told.

    `still_wanted` is asked before each message and where one is not obeyed; a stop does not ask. One that
    `starts` is not wanted either where the stop has ended by then.
    """

    def __init__(self, orders: Orders, is_stop: bool = False, starts: bool = False) -> None:
        self._orders, self._starts = orders, starts
        orders.stops += is_stop
        self._stops = orders.stops

    def __enter__(self) -> Errand:
        self._orders.under_way += 1
        return self

    def __exit__(self, *exception: object) -> None:
        self._orders.under_way -= 1
        self._orders.given += 1

    def still_wanted(self, now_s: float, expires_s: float) -> None:
        """Raise `OvertakenOrder` after a stop, or late."""
        overtaken = self._orders.stops != self._stops or (self._starts and self._orders.stopped)
        if overtaken or self._orders.void:
            raise OvertakenOrder("a stop overtook it")
        if now_s > expires_s:
            raise OvertakenOrder("it came too late")


class Motor:
    """An inverter behind a conversation. Errors are those of `Conversation`; an order that the drive accepts
    and does not follow is an `InstrumentRefused` with the code "not obeyed"."""

    def __init__(
        self, settings: InverterSettings, talk: Conversation, clock: Clock, notices: Notices
    ) -> None:
        self._settings, self._talk, self._clock, self._notices = settings, talk, clock, notices
        self.parameters = Parameters({})
        self.orders = Orders()
        self.state: MotorState | None = None

    async def read_parameters(self) -> Parameters:
        """Read what a start depends on."""
        patience_s = OPENING_STEP_S - STEP_S  # nothing turns yet
        found: dict[fr.Register, int] = {}
        for block in checked(self._settings):
            answer = await self._talk.read(block, self._soon() + patience_s)
            found |= zip(block.registers, answer, strict=True)
        self.parameters = Parameters(found)
        return self.parameters

    async def look(self, degraded: bool = False) -> MotorState:
        """Ask the drive how it is."""
        monitor = await self._talk.read(fr.MONITOR_BLOCK, self.silence_ends_s())
        (kept,) = await self._talk.read(fr.SET_BLOCK, self.silence_ends_s())
        # Last, so that an output that a trip has brought to zero never comes without the fault.
        status, _ = await self._talk.read(fr.STATUS_BLOCK, self.silence_ends_s())
        fault = ""
        if status & Status.FAULT:
            (code,) = await self._talk.read(fr.LAST_FAULT_BLOCK, self._soon())
            fault = fr.fault_name(code) or "a fault that its history does not name"
        frequency_hz, current_a, voltage_v = (
            register.value(raw) for register, raw in zip(fr.MONITOR_BLOCK.registers, monitor, strict=True)
        )
        self.state = MotorState(
            at_s=self._clock.monotonic_s(),
            running=bool(status & Status.RUNNING),
            set_rpm=fr.RUNNING_FREQUENCY.value(kept) * self._settings.rpm_per_hz,
            speed_rpm=frequency_hz * self._settings.rpm_per_hz,
            output_frequency_hz=frequency_hz,
            output_current_a=current_a,
            output_voltage_v=voltage_v,
            fault=fault,
            degraded=degraded,
        )
        return self.state

    async def heed_stop_line(self) -> None:
        """Read the terminal of the emergency stop, if it has one; raises EmergencyStop where that is open."""
        if (line := self._settings.stop_line) is not None:
            (inputs,) = await self._talk.read(fr.TERMINAL_BLOCK, self.silence_ends_s())
            line.heed(bool(inputs & fr.Terminal[line.terminal]), self._settings.port)

    def longest_stop_s(self, from_hz: float) -> float:
        """Return how long the ramps of a stop take at worst, in s: one down, and one each withdrawal."""
        return (1 + WITHDRAWALS) * self._longest_ramp_s(from_hz)

    def silence_ends_s(self) -> float:
        """When the last request must have been sent: an answer later than its own deadline is none."""
        since_s = self._talk.unanswered_since_s
        now_s = self._clock.monotonic_s()
        return (now_s if since_s is None else since_s) + self._settings.silent_s - self._settings.answer_s

    @property
    def _target(self) -> str:
        """As the inverter shows it, and as the crank has it."""
        hz = self.orders.target_hz
        return f"{hz:g} Hz ({hz * self._settings.rpm_per_hz:.5g} rpm)"

    async def set_frequency(self, hz: float, expires_s: float) -> float:
        """Set the frequency; a running motor goes there on its ramp. Returns it as the drive has it."""
        raw, before_hz = fr.RUNNING_FREQUENCY.raw(hz), self.orders.target_hz
        with Errand(self.orders) as errand:
            await self._take_over(errand, expires_s)
            errand.still_wanted(self._clock.monotonic_s(), expires_s)
            # Before it is sent: from here on the drive may have it, whatever becomes of the answer.
            self.orders.target_hz = fr.RUNNING_FREQUENCY.value(raw)
            try:
                await self._talk.write(fr.RUNNING_FREQUENCY, raw, self._soon())
            except InstrumentRefused:
                self.orders.target_hz = before_hz
                raise
            except InstrumentSilent:
                pass  # its answer alone may be lost; what it reads back tells
            self._expect_ramp()
            order = f"{fr.RUNNING_FREQUENCY} = {hz:g} Hz"
            await self._see(errand, fr.SET_BLOCK, lambda kept: kept == raw, order)
        self._notices.note("info", "inverter.set", f"set to {self._target}")
        return self.orders.target_hz

    async def run_forward(self, expires_s: float) -> None:
        with Errand(self.orders, starts=True) as errand:
            await self._take_over(errand, expires_s)
            # A run command is never repeated blindly: without its answer, the status is read first.
            for _ in range(2):
                errand.still_wanted(self._clock.monotonic_s(), expires_s)
                self.orders.run = self.orders.ran = True
                if await self._talk.command(fr.STATUS_AND_COMMAND, Command.FORWARD, self._soon()):
                    break
                status, _ = await self._talk.read(fr.STATUS_BLOCK, self._soon())
                if status & Status.FORWARD:  # only its answer was lost
                    break
            self._expect_ramp()
            if self.orders.target_hz > 0.0:
                both = Status.RUNNING | Status.FORWARD
                within_s = OBEYED_S + self.parameters.ramp_s(0.0, RUNS_ABOVE_HZ)
                await self._see(
                    errand, fr.STATUS_BLOCK, lambda status: status & both == both, "run forward", within_s
                )
        self._notices.note("info", "inverter.run", f"runs, set to {self._target}")

    async def stop(self, measured_hz: Callable[[], float] | None = None) -> None:
        """Ramp to zero and see that it stands, with run withdrawn at once where the drive then ramps down by
        itself (Pr.250), and at the end of the ramp or at the first thing that goes wrong where it coasts.

        Zero speed is asked for in either case: one of the two orders is enough.
        What `measured_hz` raises comes out of here once run is withdrawn.
        """
        with Errand(self.orders, is_stop=True):
            try:
                if self.parameters.coasts:
                    await self._ask_zero()
                else:
                    with suppress(InstrumentRefused):  # withdrawn again at the end, and told then
                        await self._take_run_back()
                    with suppress(InstrumentRefused, InstrumentSilent):
                        await self._ask_zero()
                await self._see_standing(measured_hz)
            except InstrumentError as error:
                text = f"not seen to ramp down, run is withdrawn: {error}"
                self._notices.note("warning", "inverter.stop", text)
            finally:
                await self._withdraw()

    async def withdraw(self) -> None:
        """Take the run command back at once and wait until the drive has stopped.

        Where that cannot be seen, hush, so that the drive's watchdog stops it, and raise InstrumentSilent.
        """
        if self.orders.run and not (self.state and self.state.fault):
            coasts = "coasts: inverter.off does not mean that the shaft stands"
            does = coasts if self.parameters.coasts else "ramps down by itself (Pr.8)"
            text = f"run is withdrawn at once; by Pr.250 the motor {does}"
            self._notices.note("warning", "inverter.cut", text)
        with Errand(self.orders, is_stop=True):
            await self._withdraw()

    async def hand_back(self) -> None:
        """Give a stopped drive back to its panel; in PU mode silence is no fault (H11: M)."""
        with Errand(self.orders):
            await self._talk.command(fr.OPERATION_MODE, fr.CHOOSE_PANEL, self._soon())
            self.orders.taken = False

    async def _take_over(self, errand: Errand, expires_s: float) -> None:
        """Choose network operation, where it is not chosen."""
        _, mode = await self._talk.read(fr.STATUS_BLOCK, self._soon())
        if mode != fr.NETWORK_MODE:
            errand.still_wanted(self._clock.monotonic_s(), expires_s)
            # Network operation starts the drive's watchdog: from here on it wants to hear something.
            try:
                await self._talk.command(fr.OPERATION_MODE, fr.CHOOSE_NETWORK, self._soon())
                _, mode = await self._talk.read(fr.STATUS_BLOCK, self._soon())
            except asyncio.CancelledError:
                self.orders.taken = True  # it may have it, and is to be handed back
                raise
        if mode != fr.NETWORK_MODE:
            raise self.refused(f"it stays in operation mode {mode}", f"{fr.OPERATION_MODE}, Pr.79 and Pr.340")
        self.orders.taken = True

    async def _see(
        self,
        errand: Errand,
        block: fr.Block,
        obeyed: Callable[[int], bool],
        order: str,
        within_s: float = OBEYED_S,
    ) -> None:
        """Read back until the first register shows that an order is obeyed, or a stop has overtaken it."""
        deadline_s = self._clock.monotonic_s() + within_s
        while not obeyed(raw := (await self._talk.read(block, self._soon()))[0]):
            errand.still_wanted(self._clock.monotonic_s(), math.inf)
            if self._clock.monotonic_s() > deadline_s:
                raise self.refused(f"not obeyed: {order}; it reads {raw}", "", NOT_OBEYED)
            await asyncio.sleep(LOOK_AGAIN_S)

    async def _ask_zero(self) -> None:
        self.orders.target_hz = 0.0
        await self._talk.write(fr.RUNNING_FREQUENCY, 0, self._soon())
        self._expect_ramp()
        if self.orders.run:  # else it is asked for again of a motor that stands: no news
            self._notices.note("info", "inverter.ramp", "zero speed asked for")

    async def _take_run_back(self) -> None:
        ran, self.orders.run = self.orders.run, False
        self._expect_ramp()
        for _ in range(WITHDRAWALS):
            if await self._talk.command(fr.STATUS_AND_COMMAND, Command.STOP, self._soon()):
                if ran:
                    text = "run withdrawn, it ramps down by itself (Pr.250)"
                    self._notices.note("info", "inverter.ramp", text)
                return

    async def _see_standing(self, measured_hz: Callable[[], float] | None) -> None:
        """Look on until it stands, by what is measured where that is known; raises where it does not."""
        began_s = self._clock.monotonic_s()
        state = await self.look()
        # From where it is and not from where it should be: a drive may lag behind its set value.
        limit_s = self._longest_ramp_s(state.output_frequency_hz)
        while True:
            measured = measured_hz() if measured_hz else math.nan
            speed_hz = abs(measured) if math.isfinite(measured) else state.output_frequency_hz
            if speed_hz <= STANDSTILL_HZ:
                return
            if state.fault:
                raise self.refused(f"it tripped on the ramp: {state.fault}", "", state.fault)
            if self._clock.monotonic_s() - began_s > limit_s:
                raise self.refused(f"still at {speed_hz:g} Hz after {limit_s:.2f} s of ramp", "", "overrun")
            await asyncio.sleep(LOOK_AGAIN_S)
            state = await self.look()

    async def _withdraw(self) -> None:
        """Send that until it is seen to run no more."""
        self.orders.run = False
        self._expect_ramp()
        why, reconnect_by_s = "it still runs", self._clock.monotonic_s() + RECONNECT_S
        for _ in range(WITHDRAWALS):
            try:
                await self._talk.command(fr.STATUS_AND_COMMAND, Command.STOP, self._soon())
                # Done is what is seen: the drive says that it runs no more, within one and a half ramps.
                state = await self.look()
                deadline_s = self._clock.monotonic_s() + self._longest_ramp_s(state.output_frequency_hz)
                while state.running and self._clock.monotonic_s() < deadline_s:
                    await asyncio.sleep(LOOK_AGAIN_S)
                    state = await self.look()
                if not state.running:
                    ran, self.orders.ran = self.orders.ran, False
                    if ran:
                        self._notices.note("info", "inverter.off", "run withdrawn")
                    return
            except InstrumentError as error:
                why = str(error)
                lost = isinstance(error, DeviceLost) and self._clock.monotonic_s() < reconnect_by_s
                # a host that does not answer takes seconds: no second time
                if lost and not await self._talk.reconnect():
                    await asyncio.sleep(RECONNECT_S / WITHDRAWALS)
        # Whatever is sent restarts the watchdog, which is all that can stop it now.
        self._talk.hush()
        raise InstrumentSilent(
            self._settings.name,
            self._settings.port,
            f"no answer to a stop that shows it stopped ({why}); nothing more is sent, so that its watchdog "
            f"stops it within {self.parameters.watchdog_s:g} s",
            "THE MOTOR, and the emergency stop",
        )

    def _longest_ramp_s(self, from_hz: float) -> float:
        return max(RAMP_MARGIN * self.parameters.ramp_s(from_hz, 0.0), OBEY_GRACE_S)

    def _expect_ramp(self) -> None:
        from_hz = self.state.output_frequency_hz if self.state else 0.0
        ramp_s = self.parameters.ramp_s(from_hz, self.orders.due_hz)
        self.orders.obey_by_s = self._clock.monotonic_s() + RAMP_MARGIN * ramp_s + OBEY_GRACE_S

    def _soon(self) -> float:
        return self._clock.monotonic_s() + STEP_S

    def refused(self, what: str, check: str = "", code: str = "") -> InstrumentRefused:
        """Return what to raise where the drive does something else than asked."""
        return InstrumentRefused(self._settings.name, self._settings.port, what, check, code)

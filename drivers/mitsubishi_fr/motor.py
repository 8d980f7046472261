"""Looks at one inverter and gives it orders; every order is read back."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

from daq.clock import Clock
from daq.errors import InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.conversation import Conversation
from drivers.mitsubishi_fr.diary import Diary
from drivers.mitsubishi_fr.orders import Errand, Orders
from drivers.mitsubishi_fr.registers import Command, Status
from drivers.mitsubishi_fr.settings import CHECKED, InverterSettings, Parameters
from drivers.protocols.speed_drive import MotorState

STEP_S = 1.0  # within it a single message has to be answered
OPENING_STEP_S = 3.0
OBEYED_S = 0.2
OBEY_GRACE_S = 0.5  # on top of 1.5 ramps: polls, and the drive's own 20 ms
RAMP_MARGIN = 1.5
STANDSTILL_HZ = 0.05
RUNS_ABOVE_HZ = 1.0  # the RUN signal comes with Pr.13, 0.5 Hz unless somebody changed it
WITHDRAWALS = 3
LOOK_AGAIN_S = 0.02
NOT_OBEYED = "not obeyed"


class Motor:
    """An inverter behind a conversation. Errors are those of `Conversation`; an order that the drive accepts
    and does not follow is an `InstrumentRefused` with the code "not obeyed"."""

    def __init__(self, settings: InverterSettings, talk: Conversation, clock: Clock, diary: Diary) -> None:
        self._settings, self._talk, self._clock, self._diary = settings, talk, clock, diary
        self.parameters = Parameters({})
        self.orders = Orders()
        self.state: MotorState | None = None

    async def read_parameters(self) -> Parameters:
        """Read what a start depends on."""
        patience_s = OPENING_STEP_S - STEP_S  # nothing turns yet
        answers = {block: await self._talk.read(block, self._soon() + patience_s) for block in CHECKED}
        self.parameters = Parameters.of(answers)
        return self.parameters

    async def look(self, degraded: bool = False) -> MotorState:
        """Ask the drive how it is."""
        monitor = await self._talk.read(fr.MONITOR_BLOCK, self.silence_ends_s())
        (kept,) = await self._talk.read(fr.SET_BLOCK, self.silence_ends_s())
        # Last, so that an output that a trip has brought to zero never comes without the fault.
        status, _ = await self._talk.read(fr.STATUS_BLOCK, self.silence_ends_s())
        fault = ""
        if status & Status.FAULT:
            fault = (await self.history(1))[0] or "a fault that its history does not name"
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

    def longest_stop_s(self, from_hz: float) -> float:
        """Return how long the ramps of a stop take at worst, in s: one down, and one each withdrawal."""
        return (1 + WITHDRAWALS) * self._longest_ramp_s(from_hz)

    async def history(self, count: int = len(fr.FAULTS)) -> tuple[str, ...]:
        """Return the names of the last faults, newest first; empty for none."""
        codes: tuple[int, ...] = ()
        for first in range(0, count, 4):
            block = fr.block(fr.FAULTS[first], fr.FAULTS[min(first + 4, count) - 1])
            codes += await self._talk.read(block, self._soon())
        return tuple(fr.fault_name(code) for code in codes)

    def silence_ends_s(self) -> float:
        """When an answer must have come, or the drive counts as gone."""
        since_s = self._talk.unanswered_since_s
        return (self._clock.monotonic_s() if since_s is None else since_s) + self._settings.silent_s

    async def set_frequency(self, hz: float, expires_s: float) -> float:
        """Set the frequency; a running motor goes there on its ramp. Returns it as the drive has it."""
        raw, before_hz = fr.RUNNING_FREQUENCY.raw(hz), self.orders.target_hz
        with Errand(self.orders) as errand:
            await self._take_over(errand, expires_s)
            errand.still_wanted(self._clock.monotonic_s(), expires_s)
            self.orders.target_hz = fr.RUNNING_FREQUENCY.value(raw)
            try:
                await self._talk.write(fr.RUNNING_FREQUENCY, raw, self._soon())
            except InstrumentRefused:
                self.orders.target_hz = before_hz
                raise
            except InstrumentSilent:
                pass  # its answer alone may be lost; what it reads back tells
            self._expect_ramp()
            await self._see(fr.SET_BLOCK, lambda kept: kept == raw, f"{fr.RUNNING_FREQUENCY} = {hz:g} Hz")
        self._diary.note("info", "inverter.set", f"set to {self.orders.target_hz:g} Hz")
        return self.orders.target_hz

    async def run_forward(self, expires_s: float) -> None:
        """Let the motor run."""
        with Errand(self.orders) as errand:
            await self._take_over(errand, expires_s)
            for _ in range(2):
                errand.still_wanted(self._clock.monotonic_s(), expires_s)
                self.orders.run = True
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
                    fr.STATUS_BLOCK, lambda status: status & both == both, "run forward", within_s
                )
        self._diary.note("info", "inverter.run", f"runs, set to {self.orders.target_hz:g} Hz")

    async def stop(self, measured_hz: Callable[[], float] | None = None) -> None:
        """Ramp to zero, then withdraw run; where anything goes wrong, withdraw it at once.

        What `measured_hz` raises comes out of here once run is withdrawn.
        """
        with Errand(self.orders, is_stop=True):
            try:
                await self._ramp_down(measured_hz)
            except InstrumentError as error:
                self._diary.note("warning", "inverter.stop", f"no ramp, run is withdrawn at once: {error}")
            finally:
                await self._withdraw()

    async def withdraw(self) -> None:
        """Take the run command back at once and wait until the drive has stopped.

        Where that cannot be seen, hush, so that the drive's watchdog stops it, and raise InstrumentSilent.
        """
        with Errand(self.orders, is_stop=True):
            await self._withdraw()

    async def hand_back(self) -> None:
        """Give a stopped drive back to its panel; in PU mode silence is no fault (H11: M)."""
        with Errand(self.orders):
            await self._talk.command(fr.OPERATION_MODE, fr.CHOOSE_PANEL, self._soon())
            self.orders.taken = False

    async def reset(self) -> None:
        """Send the inverter reset, once; it is never answered (p. 201)."""
        if (await self.look()).running:
            raise self.refused("it runs, and a reset would let the motor coast", "that it stands")
        await self._talk.send(fr.INVERTER_RESET, 0)

    async def _take_over(self, errand: Errand, expires_s: float) -> None:
        """Choose network operation, where it is not chosen."""
        _, mode = await self._talk.read(fr.STATUS_BLOCK, self._soon())
        if mode != fr.NETWORK_MODE:
            errand.still_wanted(self._clock.monotonic_s(), expires_s)
            await self._talk.command(fr.OPERATION_MODE, fr.CHOOSE_NETWORK, self._soon())
            _, mode = await self._talk.read(fr.STATUS_BLOCK, self._soon())
        if mode != fr.NETWORK_MODE:
            raise self.refused(f"it stays in operation mode {mode}", f"{fr.OPERATION_MODE}, Pr.79 and Pr.340")
        self.orders.taken = True

    async def _see(
        self, block: fr.Block, obeyed: Callable[[int], bool], order: str, within_s: float = OBEYED_S
    ) -> None:
        """Read back until the first register shows that an order is obeyed."""
        deadline_s = self._clock.monotonic_s() + within_s
        while not obeyed(raw := (await self._talk.read(block, self._soon()))[0]):
            if self._clock.monotonic_s() > deadline_s:
                raise self.refused(f"not obeyed: {order}; it reads {raw}", "", NOT_OBEYED)
            await asyncio.sleep(LOOK_AGAIN_S)

    async def _ramp_down(self, measured_hz: Callable[[], float] | None) -> None:
        self.orders.target_hz = 0.0
        await self._talk.write(fr.RUNNING_FREQUENCY, 0, self._soon())
        self._expect_ramp()
        if self.orders.run:  # else it is asked for again of a motor that stands: no news
            self._diary.note("info", "inverter.zero", "zero speed asked for")
        began_s = self._clock.monotonic_s()
        state = await self.look()
        limit_s = self._longest_ramp_s(state.output_frequency_hz)
        while (speed_hz := _speed_hz(state, measured_hz)) > STANDSTILL_HZ:
            if state.fault:
                raise self.refused(f"it tripped on the ramp: {state.fault}", "", state.fault)
            if self._clock.monotonic_s() - began_s > limit_s:
                raise self.refused(f"still at {speed_hz:g} Hz after {limit_s:.2f} s of ramp", "", "overrun")
            await asyncio.sleep(LOOK_AGAIN_S)
            state = await self.look()

    async def _withdraw(self) -> None:
        ran, self.orders.run = self.orders.run, False
        self._expect_ramp()
        why = "it still runs"
        for _ in range(WITHDRAWALS):
            try:
                await self._talk.command(fr.STATUS_AND_COMMAND, Command.STOP, self._soon())
                if await self._comes_to_rest():
                    if ran:
                        self._diary.note("info", "inverter.off", "run withdrawn")
                    return
            except InstrumentError as error:
                why = str(error)
        self._talk.hush()
        raise InstrumentSilent(
            self._settings.name,
            self._settings.port,
            f"no answer to a stop that shows it stopped ({why}); nothing more is sent, so that its watchdog "
            f"stops it within {self.parameters.watchdog_s:g} s",
            "THE MOTOR, and the emergency stop",
        )

    async def _comes_to_rest(self) -> bool:
        """Wait for the ramp that follows a withdrawn run; whether it ended."""
        state = await self.look()
        deadline_s = self._clock.monotonic_s() + self._longest_ramp_s(state.output_frequency_hz)
        while state.running and self._clock.monotonic_s() < deadline_s:
            await asyncio.sleep(LOOK_AGAIN_S)
            state = await self.look()
        return not state.running

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


def _speed_hz(state: MotorState, measured_hz: Callable[[], float] | None) -> float:
    measured = measured_hz() if measured_hz else math.nan
    return abs(measured) if math.isfinite(measured) else state.output_frequency_hz

"""An emulated inverter and its driver in one event loop whose time jumps to whatever happens next."""

from __future__ import annotations

import asyncio
import selectors
from collections import deque
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pymodbus.constants import ExcCodes

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentError
from drivers.mitsubishi_fr.conversation import Conversation
from drivers.mitsubishi_fr.emulator.drive import (
    DriveFaults,
    EmulatedDrive,
    FreeMotor,
    InverterSetup,
    Unanswered,
)
from drivers.mitsubishi_fr.emulator.line_faults import Disturbance, LineFaults
from drivers.mitsubishi_fr.frames import READ, Answer, Request, checksum, find_answer, what_was_heard
from drivers.mitsubishi_fr.line import LineHealth, NoAnswer
from drivers.mitsubishi_fr.motor import Motor
from drivers.mitsubishi_fr.poller import Poller
from drivers.mitsubishi_fr.registers import (
    FIRST_NUMBER,
    PARAMETERS,
    RUNNING_FREQUENCY,
    STATUS_AND_COMMAND,
    TERMINAL_FUNCTIONS,
    Command,
)
from drivers.mitsubishi_fr.settings import NO_FUNCTION, InverterSettings
from drivers.protocols.instrument import Notices
from drivers.protocols.speed_drive import MotorOutput

T = TypeVar("T")
GAP_S = 0.002
ANSWERS_AFTER_S = 0.02  # a frame of 20 bytes at 19200 baud and the drive's own time
HZ = 6.67  # 200 rpm at 30 rpm/Hz
RAMP_S = 0.667  # 10 Hz in a second
LOOK_S = 0.26  # two looks of three answers each, in turns with the poll: 12 exchanges of 22 ms
STOP = (STATUS_AND_COMMAND.number, int(Command.STOP))
FORWARD = (STATUS_AND_COMMAND.number, int(Command.FORWARD))
ZERO = (RUNNING_FREQUENCY.number, 0)
SETTINGS = InverterSettings(30.0, 300.0, port="nowhere")


class _Selector(selectors.DefaultSelector):
    """Waits by moving the clock."""

    now_s = 1000.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        assert timeout is not None, "everything waits for something that never comes"
        self.now_s += max(timeout, 0.0)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """Time passes only where everybody waits. It is its own `Clock`."""

    def __init__(self) -> None:
        self._virtual = _Selector()
        super().__init__(self._virtual)

    def time(self) -> float:
        return self._virtual.now_s

    def monotonic_s(self) -> float:
        return self._virtual.now_s

    def unix_ns(self) -> int:
        return round(self._virtual.now_s * 1e9)

    def sleep(self, seconds: float) -> None:
        """Let time pass as for a process that was stopped."""
        self._virtual.now_s += seconds


def in_virtual_time(work: Callable[[VirtualLoop], Coroutine[Any, Any, T]]) -> T:
    loop = VirtualLoop()
    try:
        return loop.run_until_complete(work(loop))
    finally:
        loop.close()


def answer_frame(request: Request, result: list[int] | ExcCodes) -> bytes:
    """Return what a drive sends."""
    if isinstance(result, ExcCodes):
        body = bytes([request.station, request.function | 0x80, result])
    elif request.function == READ:
        data = b"".join(value.to_bytes(2, "big") for value in result)
        body = bytes([request.station, request.function, len(data)]) + data
    else:
        return request.frame()
    return body + checksum(body)


@dataclass
class VirtualLine:
    """A line to whatever `respond` is; keeps the order of what is sent, like any line."""

    loop: VirtualLoop
    respond: Callable[[Request], bytes]
    disturbance: Disturbance = field(default_factory=lambda: Disturbance(LineFaults()))
    answer_s: float = 0.2
    cut: bool = False
    returns: bool = False  # to whoever connects anew
    mute: bool = False
    sent: list[tuple[float, Request]] = field(default_factory=list)
    _coming: deque[tuple[float, bytes]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self.health = LineHealth(self.loop.time)

    async def ask(self, request: Request) -> Answer:
        await self._transmit(request)
        self.health.asked += 1
        heard, deadline_s = b"", self.loop.time() + self.answer_s
        while self._coming and self._coming[0][0] <= deadline_s:
            at_s, data = self._coming.popleft()
            await asyncio.sleep(at_s - self.loop.time())
            heard += data
            answer = find_answer(request, heard)
            if answer is not None:
                self.health.resynchronised += len(heard) > len(answer.frame)
                return answer
        await asyncio.sleep(deadline_s - self.loop.time())
        self.health.note_failure(what_was_heard(request, heard))
        raise NoAnswer(what_was_heard(request, heard))

    async def reopen(self) -> bool:
        if not self.returns:
            raise InstrumentAbsent("inverter", "nowhere", "nobody answers (unplugged)")
        was_cut, self.cut = self.cut, False
        return was_cut

    async def _transmit(self, request: Request) -> None:
        if self.cut:
            raise DeviceLost("inverter", "nowhere", "the connection is lost (unplugged)")
        await asyncio.sleep(GAP_S)
        while self._coming and self._coming[0][0] <= self.loop.time():
            self._coming.popleft()
        self.sent.append((self.loop.time(), request))
        answer = b"" if self.mute else self.respond(request)
        if answer:
            piece = self.disturbance.spoil(request.frame(), answer)
            at_s = self.loop.time() + ANSWERS_AFTER_S + piece.delay_s
            self._coming.append((max(at_s, self._coming[-1][0]) if self._coming else at_s, piece.data))

    def writes(self) -> list[tuple[int, int]]:
        """Return manual number and value of every write so far."""
        return [
            (request.address + FIRST_NUMBER, request.content)
            for _, request in self.sent
            if request.function != READ
        ]


class RecordedMotor(FreeMotor):
    """A free motor that remembers what was put out."""

    def __init__(self) -> None:
        super().__init__()
        self.outputs: list[MotorOutput] = []

    def drive(self, output: MotorOutput) -> None:
        super().drive(output)
        self.outputs.append(output)

    def at(self, time_s: float) -> float:
        """Return what was put out at a time, in Hz."""
        before = [output for output in self.outputs if output.started_s <= time_s]
        return before[-1].at(time_s) if before else 0.0


@dataclass
class Bench:
    """The driver's asynchronous half with an emulated drive on the other end of its line."""

    loop: VirtualLoop
    load: RecordedMotor
    drive: EmulatedDrive
    line: VirtualLine
    motor: Motor
    poller: Poller
    notices: Notices

    @classmethod
    def new(
        cls,
        loop: VirtualLoop,
        parameters: Mapping[int, int] | None = None,
        faults: DriveFaults | None = None,
        line_faults: LineFaults | None = None,
        settings: InverterSettings = SETTINGS,
    ) -> Bench:
        load = RecordedMotor()
        # 10 Hz in 1 s, watchdog 1 s, ramps down where it trips.
        raw = {7: 60, 8: 60, 122: 10}
        if settings.stop_line is not None:
            raw[TERMINAL_FUNCTIONS[settings.stop_line.terminal].number - PARAMETERS] = NO_FUNCTION
        setup = InverterSetup(raw | dict(parameters or {}), faults or DriveFaults())
        drive = EmulatedDrive(setup, load, loop.time)

        def respond(request: Request) -> bytes:
            drive.heard_frame()
            reads = request.function == READ
            count, values = (request.content, None) if reads else (1, [request.content])
            try:
                return answer_frame(request, drive.access(request.address + FIRST_NUMBER, count, values))
            except Unanswered:
                return b""

        line = VirtualLine(loop, respond, Disturbance(line_faults or LineFaults()), settings.answer_s)
        notices = Notices(loop)
        talk = Conversation("inverter", "nowhere", settings.station, line, loop.time)
        motor = Motor(settings, talk, loop, notices)
        poller = Poller(settings, motor, talk, line.health, loop, notices)
        return cls(loop, load, drive, line, motor, poller, notices)

    async def run_at(self, hz: float) -> None:
        """Open, run at a frequency, and be there."""
        await self.poller.check_in()
        await self.motor.set_frequency(hz, self.loop.time() + 3.0)
        await self.motor.run_forward(self.loop.time() + 3.0)
        await self.wait(self.motor.parameters.ramp_s(0.0, hz) + 0.3)

    async def wait(self, seconds: float) -> None:
        """Let time pass for everybody, as somebody who looks after the motor; what was due happens."""
        end_s = self.loop.time() + seconds
        while self.loop.time() < end_s:
            self.poller.attended_s = self.loop.time()
            await asyncio.sleep(min(0.05, max(end_s - self.loop.time(), 1e-3)))
            self.drive.settle()

    def withdrawn_s(self) -> float:
        """Return when run was withdrawn first."""
        stop = (STATUS_AND_COMMAND.address, int(Command.STOP))
        return next(at_s for at_s, request in self.line.sent if (request.address, request.content) == stop)


def on_bench(work: Callable[[Bench], Coroutine[Any, Any, T]], **setup: Any) -> T:
    async def run(loop: VirtualLoop) -> T:
        bench = Bench.new(loop, **setup)
        try:
            return await work(bench)
        finally:
            bench.line.mute = False
            await bench.poller.close()

    return in_virtual_time(run)


async def latched(bench: Bench, within_s: float) -> InstrumentError:
    """Return the error that the poller finds within a time."""
    end_s = bench.loop.time() + within_s
    while bench.poller.error is None:
        assert bench.loop.time() < end_s, "nothing was noticed"
        await bench.wait(0.02)
    return bench.poller.error

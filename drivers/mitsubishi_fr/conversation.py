"""What may be asked twice, what may not, and how an answer that comes too late is kept from being believed.

An answer on an RTU line does not say which request it belongs to. Two rules make up for it: after a request
without its answer, and before a read whose answer would look like that of the request before, a read of yet
another length (a *mark*) goes out. The line keeps the order, so once the mark is answered, nothing older can
come.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from itertools import cycle
from typing import Any

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr.frames import READ, WRITE, Answer, Request
from drivers.mitsubishi_fr.line import Line, NoAnswer
from drivers.mitsubishi_fr.registers import MARKS, Block, Register

# Reads and absolute set values may be repeated, each within its deadline. Run and stop go out once:
# whoever gave them reads the state before giving them again.
ATTEMPTS = 2
MARK_ATTEMPTS = 2
BUSY_S = 0.05  # after exceptions 05 and 06, both of which say "ask again later"

# Modbus Application Protocol V1.1b3, section 7.
EXCEPTIONS = {
    0x01: "illegal function",
    0x02: "illegal data address",
    0x03: "illegal data value",
    0x04: "device failure",
    0x05: "acknowledge, still at work",
    0x06: "device busy",
    0x0A: "gateway path unavailable",
    0x0B: "gateway target does not respond",
}
ACKNOWLEDGE, BUSY = 0x05, 0x06
_LOST = (0x0A, 0x0B)  # a gateway speaks for a drive that it does not reach
DEVICE_FAILURE = "04"
"""`code` of the InstrumentRefused that says the drive itself failed; the rig stops."""


async def _to_its_end(exchange: Coroutine[Any, Any, Answer]) -> Answer:
    """Have it, also where whoever waits is cancelled: what is sent into an answer spoils both."""
    asking = asyncio.create_task(exchange)
    try:
        return await asyncio.shield(asking)
    except asyncio.CancelledError:
        await asyncio.gather(asking, return_exceptions=True)
        raise


class Conversation:
    """Reads and writes of one station over a line, one at a time, in the order in which they are asked for.

    Each raises `InstrumentSilent` where no answer came, `InstrumentRefused` for what the drive refuses
    (`code` is the Modbus exception), `DeviceLost` where line or gateway say so. `expires_s` is a time of
    `monotonic_s` after which nothing is sent any more.
    """

    def __init__(
        self,
        instrument: str,
        address: str,
        station: int,
        line: Line,
        monotonic_s: Callable[[], float],
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._instrument, self._address, self._station = instrument, address, station
        self._line, self._monotonic_s, self._sleep = line, monotonic_s, sleep
        self._turn = asyncio.Lock()  # first come, first served: a stop waits for one exchange
        self._marks = cycle(MARKS)
        self._in_doubt = True  # an earlier client may have left an answer on its way
        self._last_shape: tuple[int, int] | None = None
        self._hushed = False  # nothing is sent any more; for good
        self.unanswered_since_s: float | None = None  # s of the monotonic clock; the poller gives up by it

    def hush(self) -> None:
        """Send nothing from now on, so that the drive's watchdog stops it."""
        self._hushed = True

    async def reconnect(self) -> bool:
        """Connect anew where the line is lost, as a gateway may be back at once; whether it is now."""
        async with self._turn:
            if not self._hushed:
                self._in_doubt = True
                with suppress(InstrumentAbsent):
                    return await self._line.reopen()
        return False

    async def read(self, block: Block, expires_s: float) -> tuple[int, ...]:
        """Return the raw registers of a block; asked again once."""
        request = Request(self._station, READ, block.address, block.count)
        return (await self._insist(request, str(block), ATTEMPTS, expires_s)).registers

    async def write(self, register: Register, raw: int, expires_s: float) -> None:
        """Write an absolute set value; asked again once. Done only when it reads back."""
        request = Request(self._station, WRITE, register.address, raw)
        await self._insist(request, str(register), ATTEMPTS, expires_s)

    async def command(self, register: Register, raw: int, expires_s: float) -> bool:
        """Write once what must not be repeated blindly; returns whether it was acknowledged."""
        request = Request(self._station, WRITE, register.address, raw)
        try:
            await self._insist(request, str(register), 1, expires_s)
        except InstrumentSilent:
            return False
        return True

    async def _insist(self, request: Request, what: str, attempts: int, expires_s: float) -> Answer:
        """Exchange until the answer is there, `attempts` requests or twice as many marks were in vain."""
        missing: NoAnswer | None = None
        # Twice as many: a mark that is lost has cost nothing but time.
        marks, marks_refused = MARK_ATTEMPTS * attempts, 0
        while attempts > 0 and marks > 0:
            # A turn is one exchange, so that a stop never waits for more than that.
            async with self._turn:
                if self._hushed or self._monotonic_s() > expires_s:
                    break
                mark = self._mark_before(request)
                try:
                    answer = await self._ask(mark or request)
                except NoAnswer as error:
                    missing, attempts, marks = error, attempts - (mark is None), marks - (mark is not None)
                    continue
                if mark is not None:
                    # An exception may be the late answer to anything: it settles nothing.
                    self._in_doubt = answer.exception != 0
            # A write that the drive is still at is done for us: what came of it, the caller reads back.
            at_work = request.function == WRITE and answer.exception == ACKNOWLEDGE
            if answer.exception in (ACKNOWLEDGE, BUSY) and not at_work:
                await self._sleep(BUSY_S)
            elif mark is None:
                if answer.exception not in (0, ACKNOWLEDGE):
                    raise self._refused(what, answer.exception)
                return answer
            elif answer.exception:
                marks, marks_refused = marks - 1, answer.exception
        if marks_refused:
            raise self._refused(str(MARKS[0]), marks_refused)
        raise self._silent(what, missing) from missing

    def _mark_before(self, request: Request) -> Request | None:
        # A write needs none: what its late answer would look like is read back before anybody believes it.
        if request.function != READ or not (self._in_doubt or request.shape == self._last_shape):
            return None
        mark = next(self._marks)
        return Request(self._station, READ, mark.address, mark.count)

    async def _ask(self, request: Request) -> Answer:
        doubt, self._in_doubt = self._in_doubt, True  # whatever ends this early leaves an answer on its way
        self._last_shape = request.shape
        if self.unanswered_since_s is None:
            self.unanswered_since_s = self._monotonic_s()
        answer = await _to_its_end(self._line.ask(request))
        self._in_doubt = doubt
        self.unanswered_since_s = None
        return answer

    def _refused(self, what: str, code: int) -> InstrumentRefused | DeviceLost:
        text = f"exception {code:02X} ({EXCEPTIONS.get(code, 'unknown')}) at {what}"
        kind = DeviceLost if code in _LOST else InstrumentRefused
        return kind(self._instrument, self._address, text, "model and register map", f"{code:02X}")

    def _silent(self, what: str, missing: NoAnswer | None) -> InstrumentSilent:
        if self._hushed:
            heard = ": nothing is sent any more, so that its watchdog stops it"
        else:
            heard = f": {missing}" if missing else ": the drive is busy, or it was asked too late"
        return InstrumentSilent(
            self._instrument,
            self._address,
            f"no answer to {what}{heard}",
            "that it is switched on, its station number, speed and parity",
        )

"""What an instrument says of itself: a queue of errors, standard events, and a byte that sums both up.

Registers after IEEE 488.2-1992, chapter 11; bit 2 of the status byte and which error is which event after
SCPI-1999 volume 1, chapter 9, and volume 2, section 21.8. Every command is done before the next is read, and
an answer goes out at once: an operation is always complete, and no message waits (bit 4 of the byte stays 0).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from enum import IntFlag

from drivers.scpi.emulator.command_tree import Command, CommandError, asked, none, number, single, told

ERROR_QUEUE = 20


class StandardEvent(IntFlag):
    """Of the standard event status register, 11.5; reading it clears it."""

    OPERATION_COMPLETE = 1 << 0
    QUERY_ERROR = 1 << 2
    DEVICE_ERROR = 1 << 3
    EXECUTION_ERROR = 1 << 4
    COMMAND_ERROR = 1 << 5
    POWER_ON = 1 << 7


class StatusByte(IntFlag):
    """Of the status byte, 11.2, as *STB? answers."""

    ERROR_QUEUE = 1 << 2
    EVENT_SUMMARY = 1 << 5
    MASTER_SUMMARY = 1 << 6


_EVENTS = {  # by the hundreds of an error's code
    1: StandardEvent.COMMAND_ERROR,
    2: StandardEvent.EXECUTION_ERROR,
    3: StandardEvent.DEVICE_ERROR,
    4: StandardEvent.QUERY_ERROR,
}


class StatusReporting:
    """The error queue and the registers of an instrument that was just switched on."""

    def __init__(self, pending_errors: Sequence[int] = ()) -> None:
        self._errors: deque[CommandError] = deque()
        self._events = StandardEvent.POWER_ON
        self._event_mask = self._service_mask = 0
        for code in pending_errors:
            self.report(CommandError(code))

    def report(self, error: CommandError) -> None:
        """Queue an error and note its event; the last place of a full queue says that it is full."""
        self._note(error)
        if len(self._errors) < ERROR_QUEUE:
            self._errors.append(error)
        else:
            self._errors[-1] = CommandError(-350)
            self._note(self._errors[-1])

    def commands(self) -> list[Command]:
        """What asks for it, and what else every instrument answers alike."""
        return [
            Command("*CLS", apply=told(self._clear)),
            Command("*ESE", self._enable_events, asked(lambda: str(self._event_mask))),
            Command("*ESR", answer=asked(self._take_events)),
            Command("*OPC", told(self._complete), asked(lambda: "1")),
            Command("*SRE", self._enable_service, asked(lambda: str(self._service_mask))),
            Command("*STB", answer=asked(lambda: str(int(self._status_byte)))),
            Command("*TST", answer=asked(lambda: "0")),
            Command("*WAI", apply=none),
            Command("SYSTem:ERRor[:NEXT]", answer=asked(self._next_error)),
            Command("SYSTem:VERSion", answer=asked(lambda: "1999.0")),
        ]

    @property
    def _status_byte(self) -> StatusByte:
        byte = StatusByte.ERROR_QUEUE if self._errors else StatusByte(0)
        if self._events & self._event_mask:
            byte |= StatusByte.EVENT_SUMMARY
        return byte | StatusByte.MASTER_SUMMARY if byte & self._service_mask else byte

    def _note(self, error: CommandError) -> None:
        self._events |= _EVENTS.get(-error.code // 100, StandardEvent.DEVICE_ERROR)

    def _clear(self) -> None:
        self._errors.clear()
        self._events = StandardEvent(0)

    def _complete(self) -> None:
        self._events |= StandardEvent.OPERATION_COMPLETE

    def _take_events(self) -> str:
        taken, self._events = self._events, StandardEvent(0)
        return str(int(taken))

    def _enable_events(self, parameters: Sequence[str]) -> None:
        self._event_mask = _mask(parameters)

    def _enable_service(self, parameters: Sequence[str]) -> None:
        self._service_mask = _mask(parameters) & ~int(StatusByte.MASTER_SUMMARY)  # asks for itself

    def _next_error(self) -> str:
        error = self._errors.popleft() if self._errors else CommandError(0)
        return f'{error.code:+d},"{error}"'


def _mask(parameters: Sequence[str]) -> int:
    value = number(single(parameters), {})
    if not 0.0 <= value <= 255.0:
        raise CommandError(-222)
    return round(value)

"""The instruments of a run, opened together."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

from daq.channel import Channel
from daq.errors import EmergencyStop, InstrumentError
from drivers.lock import InstrumentLock, Latch, lock
from drivers.protocols.card import AcquisitionCard
from drivers.protocols.emergency_stop import LineReader, refuse_open
from drivers.protocols.encoder import PositionEncoder
from drivers.protocols.instrument import Actuator, Logger
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.session.acquisition import JOIN_S
from rig.session.drive import Motion, drive_off_after
from rig.session.progress import Screen
from rig.session.signals import StopRequest
from rig.session.supervisor import Supervisor
from rig.worker_process import Crew


class InstrumentsMissing(InstrumentError):
    """Several instruments failed to open; all of them are named."""

    def __init__(self, errors: Sequence[InstrumentError]) -> None:
        self.errors = tuple(errors)
        Exception.__init__(self, "\n".join(str(error) for error in errors))


@dataclass(frozen=True, slots=True)
class Devices:
    """What a run drives and reads.

    `spare` makes another driver of the same actuator (picklable, for the supervisor); None where no second
    one can be opened beside the first; `spare_beside`: it may speak while the first does.
    `motion(wait, measured_rpm)` is what the actuator does in a run: `wait` waits that many seconds and may
    raise, `measured_rpm` gives the speed of the shaft as the instruments on it see it, NaN where they do not.
    `loggers` measure beside the card, by their tables.
    `line` makes a reader of the emergency stop's line on the card (picklable, for the supervisor);
    `emergency_stop` is what an actuator has seen of one that it reads itself. `latch` keeps what was seen.
    """

    actuator: Actuator
    spare: Callable[[], Actuator] | None
    motion: Callable[[Callable[[float], None], Callable[[], float]], Motion]
    card: AcquisitionCard
    encoder: PositionEncoder | None = None
    loggers: Mapping[str, Logger] = field(default_factory=dict)
    locks: list[InstrumentLock] = field(default_factory=list)
    line: Callable[[], LineReader] | None = None
    emergency_stop: Callable[[], EmergencyStop | None] = lambda: None
    latch: Latch | None = None
    spare_beside: bool = False

    @property
    def logged(self) -> tuple[Channel, ...]:
        """What is measured beside the card, but for an encoder."""
        return tuple(channel for logger in self.loggers.values() for channel in logger.channels)

    def open(self) -> None:
        """Open all, which nobody else may have; on failure close all again and raise what they all said."""
        all_devices = (self.actuator, self.card, self.encoder, *self.loggers.values())
        devices = {each.address: each for each in all_devices if each is not None}
        # what somebody else uses is not even connected to, nor is anything beside it
        self._each(devices.values(), lambda device: self.locks.append(lock(device.name, device.address)))
        self._each(filter(None, all_devices), lambda device: device.open())
        self._each(filter(None, [self.line]), refuse_open)

    def close(self) -> None:
        """Close all; never raises, and leaves behind what only measures and hangs.

        First what moves the rig, for its closing is a way to stop it, with deadlines of its own.
        """
        self.actuator.close()
        for device in (*self.loggers.values(), self.encoder, self.card):
            if device is not None:
                closing = threading.Thread(target=device.close, name=f"{device.name} close", daemon=True)
                closing.start()
                closing.join(JOIN_S)
        while self.locks:
            self.locks.pop().close()

    def _each(self, devices: Iterable[Any], do: Callable[[Any], None]) -> None:
        errors: list[InstrumentError] = []
        for device in devices:
            try:
                do(device)
            except InstrumentError as error:
                errors.append(error)
        if errors:
            self.close()
            raise errors[0] if len(errors) == 1 else InstrumentsMissing(errors)


Connect = Callable[[Scenario, Bench, ExitStack, Screen], tuple[Devices, dict[str, str]]]
"""Makes the devices of a bench, not opened yet, for as long as the stack lasts, and notes for the log."""


def connected(
    stack: ExitStack, connect: Connect, scenario: Scenario, bench: Bench, screen: Screen, stop: StopRequest
) -> tuple[Devices, dict[str, str]]:
    """The bench's devices, open, for as long as `stack` lasts, and the notes that `connect` made for the log.

    Whatever is raised from then on, the drive is off after it.
    """
    stop.check()
    with stop.at_once():
        devices, notes = connect(scenario, bench, stack, screen)
    stack.callback(devices.close)
    stop.check()
    with screen.busy("connecting"):
        devices.open()
    if devices.latch is not None and (seen := devices.latch.told()):
        asks = f"{seen}. Enter once nobody is in danger and it may start again: "
        screen.confirm(asks, lambda: stop.wanted, at_terminal=True)
        stop.check()
        devices.latch.set("")
    stack.enter_context(drive_off_after(devices.actuator, devices.spare, screen))
    screen.say(f"drive      {devices.actuator.identity} at {devices.actuator.address}")
    screen.say(f"card       {len(devices.card.channels)} channels at {devices.card.sample_rate:g} Hz, "
               f"{devices.card.address}")  # fmt: skip
    if devices.encoder is not None:
        screen.say(f"encoder    {devices.encoder.identity} at {devices.encoder.address}")
    for table, logger in devices.loggers.items():
        screen.say(f"{table:<10} {logger.identity} at {logger.address}")
    stop.check()
    return devices, notes


class Standing:
    """The devices of one run after the other: connected once for all that differ in their drive alone.

    `supervisor` watches them, `crew` predicts and derives. The drive is off between two runs. A run
    that raises anything is to be the last before `close`, and whoever sets something by hand closes before.
    """

    def __init__(self, connect: Connect) -> None:
        self._connect = connect
        self._open = ExitStack()
        self._what: object = None
        self._devices: tuple[Devices, dict[str, str]]
        self._supervisor: Supervisor | None = None
        self.crew: Crew

    def __enter__(self) -> Standing:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        opened, self._open = self._open, ExitStack()
        self._what = self._supervisor = None
        with StopRequest():  # a person who asks twice leaves nothing half closed
            opened.__exit__(kind, error, trace)

    def close(self) -> None:
        """Switch the drive off, end all that watches, and hang up."""
        self.__exit__(None, None, None)

    def supervised(self, make: Callable[[], Supervisor]) -> Supervisor:
        """The supervisor of the devices, made for the first run."""
        if self._supervisor is None:
            self._supervisor = make()
            self._open.callback(self._supervisor.close)
        return self._supervisor

    def connected(
        self, scenario: Scenario, bench: Bench, screen: Screen, stop: StopRequest
    ) -> tuple[Devices, dict[str, str]]:
        """The devices for a run, open, and the notes for its log; see `connected`."""
        # an emulated rig that hears no actuator plays one scenario's drive
        deaf = None if bench.actuator.emulated or not bench.emulated else scenario.drive
        what = bench, scenario.rig, scenario.model, scenario.acquisition.sample_rate, deaf
        if self._what != what:
            self.close()
            self.crew = self._open.enter_context(Crew())
            self._devices = connected(self._open, self._connect, scenario, bench, screen, stop)
            self._what = what
        elif self._supervisor is not None:
            devices, _ = self._devices
            if (seen := self._supervisor.emergency_stop or devices.emergency_stop()) is not None:
                raise seen
            self._supervisor.check()
        return self._devices

"""The emulated encoder in a process of its own: what it is, and which faults it is to show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal, get_args

from daq.clock import SystemClock
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.protocols.encoder import Shaft

if TYPE_CHECKING:
    from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder


FaultKind = Literal[
    "duplicate",  # the frame is sent again 130 us later, as after a lost acknowledgement
    "reorder",  # it comes after the next one
    "missing",  # it is not sent
    "wrong_length",  # it has three bytes
    "error_frame",  # a bus error is reported before it
    "receive_overrun",  # it is lost in the interface, which says so
    "bus_off",  # this and everything later is not sent
    "hang_up",  # the server closes its connections
    "garbage",  # the server sends what is no frame
    "heartbeat_stops",
    "positions_stop",
    "stuck",  # it goes on sending the position that it has, as when its coupling came off
    "emergency",  # value: its code; 0 takes all back
    "pre_operational",
    "restart",  # boot-up message, then pre-operational
    "clock_jump",  # value: by how many seconds the interface's clock is set
]


@dataclass(frozen=True, slots=True)
class EncoderFault:
    """A fault at the position frame `at_frame` (from 0, counted since the node was started); happens once."""

    kind: FaultKind
    at_frame: int
    value: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(FaultKind):
            raise ValueError(f"no fault {self.kind}; there are {', '.join(get_args(FaultKind))}")


@dataclass(frozen=True, slots=True)
class EncoderSetup:
    """An encoder of `counts_per_revolution` that tells `revolutions` apart, as `node` on `channel`.

    `device_type`, `mapped` (objects in TPDO 1) and `transmission_type` are what it says. `offset_counts` is
    the position at angle 0. Its own timer runs slow by `period_ppm`; the clock of the timestamps is ahead by
    `clock_offset_s` and fast by `clock_ppm`; each frame is up to `jitter_s` late on the bus, by `seed`, and
    shows where the shaft stood `lag_s` before it was due.
    """

    node: int = 7
    channel: str = "can0"
    counts_per_revolution: int = 4096
    revolutions: int = 1
    scaling: bool = True
    device_type: int = 0x0001_0196
    vendor: int = 0x0000_0000
    product: int = 0x0000_0406
    revision: int = 0x0001_0000
    serial: int = 1
    heartbeat_ms: int = 0
    transmission_type: int = 254
    mapped: tuple[int, ...] = (0x6004_0020,)
    offset_counts: int = 0
    period_ppm: float = 0.0
    clock_ppm: float = 0.0
    clock_offset_s: float = 0.0
    jitter_s: float = 20e-6
    lag_s: float = 0.0
    seed: int = 0
    faults: tuple[EncoderFault, ...] = ()

    @property
    def total_range(self) -> int:
        """Counts until the position starts again at 0."""
        return self.counts_per_revolution * self.revolutions


def start_encoder(shaft: Callable[[], Shaft], setup: EncoderSetup | None = None) -> EmulatedInstrument:
    """Start an emulated CANopen encoder; its address is the `host:port` of its socketcand server.

    `shaft` is called in the new process, so it must be picklable, and returns the angle over time. Raises
    `InstrumentAbsent` where it does not start in time.
    """
    make = partial(_encoder, shaft, setup or EncoderSetup())
    return start(make, "emulated encoder", START_DEADLINE_S)


def _encoder(shaft: Callable[[], Shaft], setup: EncoderSetup) -> EmulatedEncoder:
    from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder  # here, in the new process

    return EmulatedEncoder(shaft(), setup, SystemClock())

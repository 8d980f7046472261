"""The emulated encoder in a process of its own: what it is, and which faults it is to show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from daq.clock import SystemClock
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.protocols.encoder import Shaft
from drivers.rehearsal import Rehearsed

if TYPE_CHECKING:
    from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder


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
    device_type: int = 0x0001_0196  # single-turn; objects.ROTARY
    vendor: int = 0x0000_0000
    product: int = 0x0000_0406
    revision: int = 0x0001_0000
    serial: int = 1
    heartbeat_ms: int = 0  # off, as a new one is: the driver has to ask for it
    transmission_type: int = 254  # with its timer (CiA 301)
    mapped: tuple[int, ...] = (0x6004_0020,)  # the position, 32 bits
    offset_counts: int = 0
    period_ppm: float = 0.0
    clock_ppm: float = 0.0
    clock_offset_s: float = 0.0
    jitter_s: float = 20e-6
    lag_s: float = 0.0
    seed: int = 0
    faults: tuple[Rehearsed, ...] = ()

    @property
    def total_range(self) -> int:
        """Counts until the position starts again at 0."""
        return self.counts_per_revolution * self.revolutions


def spoilt(setup: EncoderSetup) -> EncoderSetup:
    """The encoder with what its faults make of it from the start."""
    for fault in setup.faults:
        if fault.kind == "wrong_device":
            setup = replace(setup, device_type=0)
        elif fault.kind == "period_off":
            setup = replace(setup, period_ppm=fault.number("ppm"))
        elif fault.kind == "rolls_over":
            setup = replace(setup, offset_counts=setup.total_range - 1)
    return setup


def start_encoder(shaft: Callable[[], Shaft], setup: EncoderSetup | None = None) -> EmulatedInstrument:
    """Start an emulated CANopen encoder; its address is the `host:port` of its socketcand server.

    `shaft` is called in the new process, so it must be picklable, and returns the angle over time. Raises
    `InstrumentAbsent` where it does not start in time.
    """
    make = partial(_encoder, shaft, spoilt(setup or EncoderSetup()))
    return start(make, "emulated encoder", START_DEADLINE_S)


def _encoder(shaft: Callable[[], Shaft], setup: EncoderSetup) -> EmulatedEncoder:
    from drivers.canopen_cia406.emulator.encoder import EmulatedEncoder  # here, in the new process

    return EmulatedEncoder(shaft(), setup, SystemClock())

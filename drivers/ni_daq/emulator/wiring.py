"""What is wired to the inputs of the emulated card, and what such a card can do.

Figures of the NI 9234: 24 bit, +-5 V, 51.2 kHz / n with n = 1 to 31, 2 mA IEPE supply, idle noise 50 uV rms
(NI 9234 datasheet, 374238). Counters are those of a chassis with an NI 9401: 32 bit.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from nidaqmx.error_codes import DAQmxErrors

from daq.errors import ConfigurationError, Problem
from daq.quantity import Samples
from drivers.ni_daq.channels import INPUT_NOISE_V
from drivers.rehearsal import ON_A_WIRE, Rehearsed

FASTEST_HZ = 51200.0  # 13.1072 MHz / 256
DIVISORS = range(1, 32)  # n of 51.2 kHz / n
EXCITATION_A = 0.002  # A; the NI 9234 has this and no other
_INPUT = re.compile(r"[A-Za-z][A-Za-z0-9_-]*/ai[0-9]{1,3}")
_COUNTER = re.compile(r"[A-Za-z][A-Za-z0-9_-]*/ctr[0-9]{1,3}")
_OTHER_SLOT = "cDAQ1Mod8/"
_OTHER_SERIAL = 1
_MODULE = re.compile(r"(.+)Mod[0-9]+")


class DaqmxError(Exception):
    """A call that the card refuses, with its DAQmx code."""

    def __init__(self, error: DAQmxErrors, text: str) -> None:
        self.code = int(error.value)
        super().__init__(text)


@dataclass(frozen=True, slots=True)
class Teds:
    """What the sensor's own data sheet says: a serial number, and V per SI unit."""

    serial: int
    volts_per_unit: float


@dataclass(frozen=True, slots=True)
class ChargeStage:
    """A charge amplifier as it really is: what its output can reach (V), its droop, and whether it is reset.

    `corner_hz` is its first-order high-pass, None for none; in reset it gives 0 V whatever the sensor does.
    """

    corner_hz: float | None = None
    output_v: float = 10.0
    reset: bool = False


@dataclass(frozen=True, slots=True)
class LowPassStage:
    """A programmable Butterworth low-pass before the card."""

    corner_hz: float
    order: int = 8


@dataclass(frozen=True, slots=True)
class ResonanceStage:
    """A sensor's own resonance, as it is mounted."""

    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class MarkStage:
    """What a photonic marker really gives for the plant's mark of 0 and 5 V: `level_v`, or less of it."""

    level_v: float = 5.0
    falling: bool = False


@dataclass(frozen=True, slots=True)
class Wire:
    """A sensor chain on an input: which channel of the plant it sees, and what it really makes of it.

    `volts_per_unit` is the true sensitivity in V per SI unit, amplifier included, whatever a bench file says;
    `range_v` is where the input clips, in V; `connected` is false for a cable that hangs loose, `shorted`
    true for one whose conductors touch. Without a `plant_channel` the sensor is in order and shows nothing.
    `corner_hz` is the high-pass of an IEPE sensor, `delay` (s) that of the input.
    """

    plant_channel: str
    volts_per_unit: float
    range_v: float = 5.0
    connected: bool = True
    shorted: bool = False
    charge: ChargeStage | None = None
    low_pass: LowPassStage | None = None
    corner_hz: float | None = None
    resonance: ResonanceStage | None = None
    delay: float | Samples = 0.0
    mark: MarkStage | None = None
    teds: Teds | None = None


@dataclass(frozen=True, slots=True)
class CounterWire:
    """A pulse source on a counter: the plant's angle (rad), speed (rad/s) or marker (V), and its true pulses.

    `preset` is what the counter holds before its first pulse, to rehearse a rollover; a marker is seen above
    `threshold_v`. An encoder may count `backwards`; its index mark sits at the plant's angle `index_at`.
    """

    plant_channel: str
    pulses_per_revolution: int = 1024
    preset: int = 0
    threshold_v: float = 2.5  # half of a 5 V pulse
    backwards: bool = False
    index_at: float = 0.0


@dataclass(frozen=True, slots=True)
class CardWiring:
    """The emulated card: its wires by physical channel (`cDAQ1Mod1/ai0`), and what else it says of itself.

    Each device has `inputs_per_device` inputs, more where more are wired; those without a wire show noise of
    `idle_noise_v` rms (V) made from `seed`. `counters` are wired by name as well (`cDAQ1Mod3/ctr0`).
    `stamps_start`: the chassis is network-synchronized, as a cDAQ-9189 is, and knows when a task began.
    `lines` are digital inputs (`cDAQ1Mod4/port0/line0`) that are on (true) or off, to begin with.
    `faults` come to it by `seed`. Its clock is off by `clock_ppm`.
    """

    wires: Mapping[str, Wire]
    product_type: str = "NI 9234"  # its figures are above
    serial: int = 0x01E24000  # shown in hexadecimal
    inputs_per_device: int = 4
    idle_noise_v: float = INPUT_NOISE_V
    seed: int = 0
    counters: Mapping[str, CounterWire] = field(default_factory=dict)
    counter_product_type: str = "NI 9401"
    counters_per_device: int = 4
    stamps_start: bool = True
    lines: Mapping[str, bool] = field(default_factory=dict)
    faults: tuple[Rehearsed, ...] = ()
    clock_ppm: float = 0.0

    def devices(self) -> dict[str, list[str]]:
        """Return the analog inputs of each device, none for one that counts.

        Raises `ConfigurationError` for names that no input has.
        """
        wrong = [(name, "an input like cDAQ1Mod1/ai0") for name in self.wires if not _INPUT.fullmatch(name)]
        wrong += [
            (name, "a counter like cDAQ1Mod3/ctr0") for name in self.counters if not _COUNTER.fullmatch(name)
        ]
        if wrong:
            problems = [Problem("physical", name, allowed) for name, allowed in wrong]
            raise ConfigurationError("wiring of the emulated card", problems)
        found = _numbered(self.wires, "ai", self.inputs_per_device)
        return found | {device: found.get(device, []) for device in self.counters_of()}

    def counters_of(self) -> dict[str, list[str]]:
        """Return the counters of each device that has any."""
        return _numbered(self.counters, "ctr", self.counters_per_device)

    def product(self, device: str) -> str:
        """What a device says it is."""
        return self.product_type if self.devices()[device] else self.counter_product_type

    def range_v(self, device: str) -> float:
        """What its inputs take, in V."""
        inputs = [wire.range_v for name, wire in self.wires.items() if name.startswith(f"{device}/")]
        return max(inputs, default=Wire("", 1.0).range_v)


def spoilt(wiring: CardWiring) -> CardWiring:
    """The wiring with what its faults do to it from the start."""
    wires, counters, clock_ppm = dict(wiring.wires), dict(wiring.counters), wiring.clock_ppm
    for fault in wiring.faults:
        if fault.kind in ON_A_WIRE:
            physical = next(
                each for each, wire in wires.items() if wire.plant_channel.endswith(fault.channel)
            )
            wires[physical] = _with(fault.kind, wires[physical])
        elif fault.kind == "wrong_module":
            slot = next(iter(wires)).partition("/")[0] + "/"
            wires = {name.replace(slot, _OTHER_SLOT): wire for name, wire in wires.items()}
            counters = {name.replace(slot, _OTHER_SLOT): each for name, each in counters.items()}
        elif fault.kind == "clock_off":
            clock_ppm = fault.number("ppm")
        elif fault.kind == "rolls_over":
            preset = 2**32 - int(fault.number("before"))  # that many counts before the register starts again
            counters = {name: replace(each, preset=preset) for name, each in counters.items()}
    return replace(wiring, wires=wires, counters=counters, clock_ppm=clock_ppm)


def _with(kind: str, wire: Wire) -> Wire:
    match kind:
        case "open":
            return replace(wire, connected=False)
        case "short":
            return replace(wire, shorted=True)
        case "wrong_sensor":
            return replace(wire, teds=Teds(_OTHER_SERIAL, 2.0 * wire.volts_per_unit))
    raise LookupError(kind)


def chassis_of(device: str) -> str | None:
    """Return the chassis that a module is in by its name; None for a device that is no module."""
    match = _MODULE.fullmatch(device)
    return None if match is None else match[1]


def _numbered(names: Iterable[str], kind: str, least: int) -> dict[str, list[str]]:
    highest: dict[str, int] = {}
    for name in names:
        device, _, index = name.partition(f"/{kind}")
        highest[device] = max(highest.get(device, least - 1), int(index))
    return {device: [f"{device}/{kind}{i}" for i in range(last + 1)] for device, last in highest.items()}


@dataclass(frozen=True, slots=True)
class Input:
    """One virtual channel as the client declared it, in V per unit it wants to read."""

    physical: str
    volts_per_unit: float
    maximum: float
    iepe: bool = False


def coerced_rate(rate_hz: float) -> float:
    """Return the slowest rate of the card that is not below `rate_hz`, as DAQmx does."""
    for divisor in reversed(DIVISORS):  # slowest first
        if FASTEST_HZ / divisor >= rate_hz * (1.0 - 1e-9):  # 1e-9: rounding of a rate asked for
            return FASTEST_HZ / divisor
    raise DaqmxError(
        DAQmxErrors.INVALID_ATTRIBUTE_VALUE, f"sample rate {rate_hz:g} Hz is above {FASTEST_HZ:g}"
    )

"""What hangs on the inputs of a card: sensors, the stages behind them, pulses; and what of it cannot be."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date
from typing import Annotated, Any, ClassVar, Final, Literal

from daq.errors import Problem
from daq.quantity import Check, Depending, Flat, Key, Quantity, Samples, Text, Whole, Words, rule
from drivers.ni_daq.sensing import (
    GAIN,
    INPUT_WORDS,
    MEANINGS,
    SENSING_CHECKS,
    keys_of,
    range_of,
    sensitivity_of,
)
from drivers.ni_daq.sensors import SENSORS, Sensor, sensor_of, units_of
from drivers.protocols.emergency_stop import StopLine
from drivers.protocols.instrument import misplaced

MARK_V: Final = 5.0
"""How high a mark is as everybody reads it."""
INPUT_RANGES_V: Final = (5.0, 10.0)
INPUT_NOISE_V: Final = 50e-6
"""Rms of an input itself (NI 9234 datasheet, 374238): what is left where a filter takes the sensor's."""
FASTEST_EDGES_HZ: Final = 9e6
"""What a line of an NI 9401 follows with all eight as inputs (its datasheet, 374068; from memory)."""
_INPUT = re.compile(r"[^/]+/_?(ai|ctr)[0-9]+", re.IGNORECASE)


_ADDRESS = Text('host:port, such as "127.0.0.1:31763"', r"[^\s:]+:\d{1,5}|\[::1\]:\d{1,5}")
_INPUT_TEXT = Text(
    f"an input of the card: {' or '.join(INPUT_WORDS.values())}", r"[A-Za-z0-9_.-]+/(?i:ai|_?ctr)\d{1,3}"
)


_CALIBRATION = rule(
    ("calibrated", "valid_until"),
    lambda part: not (part["calibrated"] and part["valid_until"]) or part["calibrated"] < part["valid_until"],
    "valid_until",
    "a day after calibrated, {calibrated}",
)


def input_range_v(full_scale_v: float) -> float:
    """What an input takes, in V: 5 or, with the modules for larger signals, 10."""
    return next((each for each in INPUT_RANGES_V if full_scale_v <= each), INPUT_RANGES_V[-1])


@dataclass(frozen=True, slots=True)
class Amplifier:
    """A charge amplifier as a stage: beyond `output_v` (V, either side) it is overloaded.

    `corner_hz` is its high-pass of first order (its droop); None where it is not known. Its gain stands with
    the channel. In the `state` reset it gives 0 V.
    """

    serial: Annotated[str, Text("the amplifier's serial number")] = ""
    corner_hz: Annotated[float | None, Quantity("Hz", 0, 1000, above=True, key="corner")] = None
    output_v: Annotated[float | None, Quantity("V", 0.1, 100, key="output")] = None
    state: Annotated[Literal["operate", "reset"], Key()] = "operate"
    calibrated: Annotated[date | None, Key()] = None
    valid_until: Annotated[date | None, Key()] = None
    CHECKS: ClassVar = (
        _CALIBRATION,
        rule(
            ("state",),
            lambda amplifier: amplifier["state"] != "reset",
            "state",
            '"operate" (in reset its output is 0 V, whatever the sensor does)',
        ),
    )


@dataclass(frozen=True, slots=True)
class AntiAliasFilter:
    """A programmable low-pass before the card, set to `corner_hz`; `order` of its Butterworth."""

    serial: Annotated[str, Text("the filter's serial number", default="")]
    corner_hz: Annotated[float, Quantity("Hz", 0.1, 1e6, key="corner")]
    order: Annotated[int, Whole(1, 16)] = 8
    calibrated: Annotated[date | None, Key()] = None
    valid_until: Annotated[date | None, Key()] = None
    CHECKS: ClassVar = (_CALIBRATION,)


@dataclass(frozen=True, slots=True)
class Pulses:
    """A source of pulses on a counter: `per_revolution` of one track.

    Of two tracks in quadrature the counter sees `decoding` (1, 2 or 4) counts for each pulse. `initial_angle`
    in rad is where the shaft stands when the task starts; with `index` it is where the index mark sits, and
    the mark sets the count anew once a revolution, so that nothing lost adds up. One that counts `backwards`
    while the crank turns forwards is turned round where it is read.
    """

    per_revolution: Annotated[int, Whole(1, 10_000_000, key="pulses_per_revolution")]
    decoding: Annotated[int, Words({"x1": 1, "x2": 2, "x4": 4})] = 4
    index: Annotated[bool, Key()] = False
    initial_angle: Annotated[float, Quantity("deg", 0, 359.999)] = 0.0
    backwards: Annotated[bool, Words({"forwards": False, "backwards": True}, key="direction")] = False

    @property
    def counts_per_revolution(self) -> int:
        """Counts for one turn of the shaft."""
        return self.per_revolution * self.decoding

    @property
    def rad_per_count(self) -> float:
        """Resolution in rad."""
        return math.tau / self.counts_per_revolution

    @property
    def counted_from(self) -> float:
        """The `initial_angle` as the counter sees it, in rad."""
        return -self.initial_angle % math.tau if self.backwards else self.initial_angle


@dataclass(frozen=True, slots=True)
class Mark:
    """A once-per-revolution mark: it begins at crank `angle` (rad), and is `level` V high.

    One that is `falling` gives 0 V while it passes, and the level else. Whatever it gives is shown as a mark
    of 0 and 5 V that rises.
    """

    angle: Annotated[float, Quantity("deg", 0, 359.999)] = 0.0
    level: Annotated[float, Quantity("V", 0.1, 100)] = MARK_V
    falling: Annotated[bool, Words({"rising": False, "falling": True}, key="polarity")] = False

    @property
    def gain(self) -> float:
        """Of what is shown, over what it gives."""
        return (-1.0 if self.falling else 1.0) * MARK_V / self.level

    @property
    def offset(self) -> float:
        """Of what is shown, in V."""
        return MARK_V if self.falling else 0.0


@dataclass(frozen=True, slots=True)
class Resonance:
    """A sensor's own resonance, as it is mounted; its damping ratio is assumed where nobody says it."""

    frequency_hz: Annotated[float, Quantity("kHz", 0.1, 1000, key="resonance")]
    damping_ratio: Annotated[float, Quantity("", 0.001, 0.5, key="resonance_damping")] = 0.02


@dataclass(frozen=True, slots=True)
class CardChannel:
    """One input: which sensor is on it, and its calibration.

    `sensitivity` is in V per `unit`, for a charge amplifier in C per `unit` with `gain` in V/C. `range` is
    the largest magnitude to be measured, in `unit`. `excitation_a` is the supply of an IEPE sensor in A; an
    NI 9234 has 2 mA and nothing else. An encoder has `pulses` and neither sensitivity nor range. One that is
    not `modelled` is none of the rig's: no twin predicts it.

    `in_stinger` says of a drive's force whether a gauge between shaker and rig shows it, or it is the coil's.
    `corner_hz` is the high-pass of an IEPE sensor; by `delay` (s, or samples) an input shows later than a
    counter what happens. One that is `inverted` gives below zero what the rig calls positive, and is turned
    round where it is read.
    """

    name: Annotated[str, Text("a channel of the rig", r"[a-z0-9_.]+")]
    physical: Annotated[str, _INPUT_TEXT]
    kind: Annotated[str, Words(SENSORS.keys())]
    sensitivity: Annotated[float, Depending(MEANINGS["sensitivity"], sensitivity_of)] = 1.0
    range: Annotated[float, Depending(MEANINGS["range"], range_of)] = math.inf
    gain: Annotated[float | None, GAIN] = None
    pulses: Annotated[Pulses | None, Flat()] = None
    amplifier: Annotated[Amplifier | None, Text("a table [daq_card.channels.amplifier]")] = None
    anti_alias: Annotated[
        AntiAliasFilter | None, Text("a table [daq_card.channels.filter]", key="filter")
    ] = None
    serial: Annotated[str, Text("the sensor's serial number")] = ""
    calibrated: Annotated[date | None, Key()] = None
    valid_until: Annotated[date | None, Key()] = None
    modelled: Annotated[bool, Key()] = True
    mark: Annotated[Mark | None, Flat()] = None
    in_stinger: Annotated[bool | None, Words({"coil": False, "stinger": True}, key="senses")] = None
    corner_hz: Annotated[float | None, Quantity("Hz", 0, 1000, above=True, key="corner")] = None
    resonance: Annotated[Resonance | None, Flat()] = None
    delay: Annotated[float | Samples | None, Quantity("ms", 0, 200, samples=100)] = None
    inverted: Annotated[bool | None, Key()] = None
    unit: str = "V"  # this and what follows: by the rig's table of channels, no keys of a bench file
    quantity: str = ""
    location: str = ""
    sensor: str = ""
    excitation_a: float = 0.002
    CHECKS: ClassVar = (
        *SENSING_CHECKS,
        _CALIBRATION,
        rule(
            ("resonance", "resonance_damping"),
            lambda channel: channel["resonance_damping"] is None or channel["resonance"] is not None,
            "resonance",
            "what is damped so, beside resonance_damping",
        ),
    )

    @property
    def volts_per_unit(self) -> float:
        """Volts at the input for one `unit`."""
        return self.sensitivity * (1.0 if self.gain is None else self.gain)

    @property
    def full_scale_v(self) -> float:
        """What the card sees at full scale, in V."""
        return self.range * self.volts_per_unit

    @property
    def counted(self) -> bool:
        """Whether it is on a counter."""
        return self.input == "ctr"

    @property
    def expiries(self) -> dict[str, date]:
        """By key, until when the sensor and the stages behind it are calibrated, as far as it is known."""
        parts: dict[str, CardChannel | Amplifier | AntiAliasFilter] = {"": self}
        parts |= {f"{name}.": stage for name, stage in self.stages.items()}
        days = {f"{name}valid_until": part.valid_until for name, part in parts.items()}
        return {key: day for key, day in days.items() if day is not None}

    @property
    def device(self) -> str:
        """The module that the input belongs to."""
        return self.physical.partition("/")[0]

    @property
    def input(self) -> str:
        """`ai` for an analog input, `ctr` for a counter, empty for anything else."""
        match = _INPUT.fullmatch(self.physical)
        return "" if match is None else match[1].lower()

    @property
    def largest(self) -> float:
        """The largest magnitude that arrives undistorted, in `unit`: that of the sensor or its amplifier."""
        if self.mark is not None:
            return self.range * abs(self.mark.gain) + self.mark.offset
        if self.amplifier is None or self.amplifier.output_v is None:
            return self.range
        return min(self.range, self.amplifier.output_v / self.volts_per_unit)

    @property
    def stages(self) -> dict[str, Amplifier | AntiAliasFilter]:
        """What lies between sensor and card, in the order of the signal."""
        stages = {"amplifier": self.amplifier, "filter": self.anti_alias}
        return {name: stage for name, stage in stages.items() if stage is not None}


def _reachable(card: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if card["grpc"] is not None and (wrong := misplaced(card["grpc"])):
        yield "grpc", wrong


@dataclass(frozen=True, slots=True)
class CardSettings:
    """The table [daq_card] of a bench: a card with its channels.

    `grpc` is `host:port` of a device server, None for this machine's driver. `buffer_s` is how long the
    driver keeps samples that nobody has read, in s. `sample_rate_hz` is the rate asked for, by a scenario,
    `stop_line` an emergency stop's line on one of its digital inputs.
    """

    driver: Annotated[Literal["nidaqmx"], Key()] = "nidaqmx"
    grpc: Annotated[str | None, _ADDRESS] = None
    emulated: Annotated[bool, Key()] = False
    buffer_s: Annotated[float, Quantity("s", 0.5, 120, key="buffer")] = 10.0  # a disk may stall so
    channels: tuple[CardChannel, ...] = ()
    sample_rate_hz: float = 0.0  # 0 until a scenario says it, and refused
    name: str = "DAQ card"
    stop_line: StopLine | None = None
    CHECKS: ClassVar = (Check(("grpc",), _reachable),)

    @property
    def ranges(self) -> dict[str, float]:
        """Full scales of what is sampled, by channel, in its unit."""
        return {each.name: each.range for each in self.channels if not each.counted}

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        return {"grpc": address}

    def at(self, address: str) -> CardSettings:
        return replace(self, grpc=address)


_INPUT_WORDS = {"ai": "an analog input (.../ai0)", "ctr": "a counter (.../ctr0)"}
_NUMBERS = {"sensitivity": "above 0", "range": "above 0", "gain": "above 0, in V/C"}
_PULSES = "pulses_per_revolution"
_ONLY_FOR = {
    "gain": "a charge_amplifier",
    "pulses": "a channel on a counter",
    "amplifier": "a charge_amplifier",
}


def problems(settings: CardSettings) -> list[Problem]:
    """Return everything that is wrong, at once."""
    found: list[Problem] = []
    if not settings.channels:
        found.append(Problem("channels", "none", "at least one"))
    elif not any(channel.input == "ai" for channel in settings.channels):
        found.append(Problem("channels", "counters only", "an analog input too, whose clock samples them"))
    for key in ("sample_rate_hz", "buffer_s"):
        if not _positive(getattr(settings, key)):
            found.append(Problem(key, repr(getattr(settings, key)), "above 0"))
    for field in ("name", "physical"):
        counts = Counter(getattr(channel, field) for channel in settings.channels)  # one input, one channel
        found += [Problem(f"channels.{field}", text, "only once") for text, n in counts.items() if n > 1]
    for channel in settings.channels:
        found += _channel_problems(channel)
    return found


def _channel_problems(channel: CardChannel) -> Iterator[Problem]:
    key = f"channels[{channel.name}]"
    sensor = sensor_of(channel)
    if channel.input not in _INPUT_WORDS:
        yield Problem(f"{key}.physical", channel.physical, " or ".join(_INPUT_WORDS.values()))
    elif sensor is None:
        kinds = ", ".join(name for name, kind in SENSORS.items() if kind.on(channel.input) is not None)
        yield Problem(f"{key}.kind", channel.kind, f"on {_INPUT_WORDS[channel.input]} one of {kinds}")
    else:
        if channel.unit not in (units := units_of(sensor, channel.unit, channel.modelled)):
            yield Problem(f"{key}.unit", channel.unit, f"one of {', '.join(units)}")
        for field, value, sound, allowed in _value_rules(channel, sensor):
            if not sound:
                yield Problem(f"{key}.{field}", repr(value), allowed)


def _value_rules(channel: CardChannel, sensor: Sensor) -> Iterator[tuple[str, object, bool, str]]:
    """Field, value, whether it may be so, and what it may be."""
    keys, pulses = keys_of(sensor), channel.pulses
    yield "excitation_a", channel.excitation_a, _positive(channel.excitation_a), "above 0"
    yield "pulses", pulses, pulses is not None or _PULSES not in sensor.needs, "pulses of a counter"
    for field in [each for each in _NUMBERS if each in keys]:
        value = getattr(channel, field)
        yield field, value, value is not None and _positive(value), _NUMBERS[field]
    if pulses is not None:
        angle, turn = pulses.initial_angle, "0 to below one turn, in rad"
        yield "pulses.per_revolution", pulses.per_revolution, pulses.per_revolution >= 1, "at least 1"
        yield "pulses.decoding", pulses.decoding, pulses.decoding in (1, 2, 4), "1, 2 or 4"
        yield "pulses.initial_angle", angle, 0.0 <= angle < math.tau, turn
    for name, stage in channel.stages.items():
        for field in ("corner_hz", "output_v", "order"):
            value = getattr(stage, field, None)
            yield f"{name}.{field}", value, value is None or _positive(value), "above 0"
    takes = {"pulses" if each == _PULSES else each for each in keys}
    for field, only_for in _ONLY_FOR.items():
        value = getattr(channel, field)
        yield field, value, value is None or field in takes, f"only for {only_for}"


def _positive(value: float) -> bool:
    return math.isfinite(value) and value > 0.0

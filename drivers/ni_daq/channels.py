"""What hangs on the inputs of a card: sensors, the stages behind them, and pulses on its counters."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Any, ClassVar, Literal

from daq.quantity import Check, Depending, Flat, Key, Quantity, Text, Whole, Words
from drivers.ni_daq.sensing import (
    GAIN,
    INPUT_WORDS,
    KINDS,
    MEANINGS,
    SENSING_CHECKS,
    range_of,
    sensitivity_of,
)

_INPUT = re.compile(r"[^/]+/_?(ai|ctr)[0-9]+", re.IGNORECASE)


_INPUT_TEXT = Text(
    f"an input of the card: {' or '.join(INPUT_WORDS.values())}", r"[A-Za-z0-9_.-]+/(?i:ai|_?ctr)\d{1,3}"
)


def _ends_after_it_began(part: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    first, last = part["calibrated"], part["valid_until"]
    if first and last and first >= last:
        yield "valid_until", f"a day after calibrated, {first}"


def _operates(amplifier: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if amplifier["state"] == "reset":
        yield "state", '"operate" (in reset its output is 0 V, whatever the sensor does)'


_CALIBRATION = Check(("calibrated", "valid_until"), _ends_after_it_began)


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
    CHECKS: ClassVar = (_CALIBRATION, Check(("state",), _operates))


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
    the mark sets the count anew once a revolution, so that nothing lost adds up.
    """

    per_revolution: Annotated[int, Whole(1, 10_000_000, key="pulses_per_revolution")]
    decoding: Annotated[int, Words({"x1": 1, "x2": 2, "x4": 4})] = 4
    index: Annotated[bool, Key()] = False
    initial_angle: Annotated[float, Quantity("deg", 0, 359.999)] = 0.0

    @property
    def counts_per_revolution(self) -> int:
        """Counts for one turn of the shaft."""
        return self.per_revolution * self.decoding

    @property
    def rad_per_count(self) -> float:
        """Resolution in rad."""
        return math.tau / self.counts_per_revolution


@dataclass(frozen=True, slots=True)
class CardChannel:
    """One input: which sensor is on it, and its calibration.

    `sensitivity` is in V per `unit`, for a charge amplifier in C per `unit` with `gain` in V/C. `range` is
    the largest magnitude to be measured, in `unit`. `excitation_a` is the supply of an IEPE sensor in A; an
    NI 9234 has 2 mA and nothing else. An encoder has `pulses` and neither sensitivity nor range.
    """

    name: Annotated[str, Text("a channel of the rig", r"[a-z0-9_.]+")]
    physical: Annotated[str, _INPUT_TEXT]
    kind: Annotated[str, Words({kind: kind for kind in KINDS})]
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
    unit: str = "V"
    quantity: str = ""
    location: str = ""
    sensor: str = ""
    excitation_a: float = 0.002
    CHECKS: ClassVar = (*SENSING_CHECKS, _CALIBRATION)

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
        if self.amplifier is None or self.amplifier.output_v is None:
            return self.range
        return min(self.range, self.amplifier.output_v / self.volts_per_unit)

    @property
    def stages(self) -> dict[str, Amplifier | AntiAliasFilter]:
        """What lies between sensor and card, in the order of the signal."""
        stages = {"amplifier": self.amplifier, "filter": self.anti_alias}
        return {name: stage for name, stage in stages.items() if stage is not None}


@dataclass(frozen=True, slots=True)
class CardSettings:
    """A card with its channels. `grpc` is `host:port` of a device server, None for this machine's driver.

    `sample_rate_hz` is the rate asked for; `buffer_s` is how long the driver keeps samples that nobody has
    read, in s.
    """

    grpc: str | None
    sample_rate_hz: float
    buffer_s: float
    channels: tuple[CardChannel, ...]
    name: str = "DAQ card"

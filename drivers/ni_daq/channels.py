"""What hangs on the inputs of a card: sensors, the stages behind them, and pulses on its counters."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import date

_INPUT = re.compile(r"[^/]+/_?(ai|ctr)[0-9]+", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Amplifier:
    """A charge amplifier as a stage: beyond `output_v` (V, either side) it is overloaded.

    `corner_hz` is its high-pass of first order (its droop); None where it is not known.
    """

    serial: str = ""
    corner_hz: float | None = None
    output_v: float | None = None
    calibrated: date | None = None
    valid_until: date | None = None


@dataclass(frozen=True, slots=True)
class AntiAliasFilter:
    """A programmable low-pass before the card, set to `corner_hz`; `order` of its Butterworth."""

    serial: str
    corner_hz: float
    order: int = 8
    calibrated: date | None = None
    valid_until: date | None = None


@dataclass(frozen=True, slots=True)
class Pulses:
    """A source of pulses on a counter: `per_revolution` of one track.

    Of two tracks in quadrature the counter sees `decoding` (1, 2 or 4) counts for each pulse. `initial_angle`
    in rad is where the shaft stands when the task starts; with `index` it is where the index mark sits, and
    the mark sets the count anew once a revolution, so that nothing lost adds up.
    """

    per_revolution: int
    decoding: int = 4
    index: bool = False
    initial_angle: float = 0.0

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

    name: str
    physical: str
    kind: str
    sensitivity: float = 1.0
    range: float = math.inf
    gain: float | None = None
    unit: str = "V"
    quantity: str = ""
    location: str = ""
    sensor: str = ""
    serial: str = ""
    calibrated: date | None = None
    valid_until: date | None = None
    excitation_a: float = 0.002
    pulses: Pulses | None = None
    amplifier: Amplifier | None = None
    anti_alias: AntiAliasFilter | None = None

    @property
    def volts_per_unit(self) -> float:
        """Volts at the input for one `unit`."""
        return self.sensitivity * (1.0 if self.gain is None else self.gain)

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

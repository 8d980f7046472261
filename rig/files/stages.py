"""What lies between a sensor and the card in a bench file: charge amplifier, anti-alias filter."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from daq.quantity import Check, Key, Quantity, Text, Whole


@dataclass(frozen=True, slots=True)
class AmplifierStage:
    """A charge amplifier in SI; its gain stands with the channel.

    `corner` is its high-pass in Hz (the droop of its time constant), `output` in V what it can give to either
    side before it is overloaded; None where the file leaves them open. In the `state` reset it gives 0 V.
    """

    serial: Annotated[str, Text("the amplifier's serial number")] = ""
    corner: Annotated[float | None, Quantity("Hz", 0, 1000, above=True)] = None
    output: Annotated[float | None, Quantity("V", 0.1, 100)] = None
    state: Annotated[Literal["operate", "reset"], Key()] = "operate"
    calibrated: Annotated[datetime.date | None, Key()] = None
    valid_until: Annotated[datetime.date | None, Key()] = None


@dataclass(frozen=True, slots=True)
class FilterStage:
    """A programmable low-pass before the card, in SI: `corner` in Hz, `order` of its Butterworth."""

    corner: Annotated[float, Quantity("Hz", 0.1, 1e6)]
    serial: Annotated[str, Text("the filter's serial number")] = ""
    order: Annotated[int, Whole(1, 16)] = 8
    calibrated: Annotated[datetime.date | None, Key()] = None
    valid_until: Annotated[datetime.date | None, Key()] = None


def calibrated_before(part: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """A calibration ends after it began."""
    first, last = part["calibrated"], part["valid_until"]
    if first and last and first >= last:
        yield "valid_until", f"a day after calibrated, {first}"


def _operates(amplifier: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if amplifier["state"] == "reset":
        yield "state", '"operate" (in reset its output is 0 V, whatever the sensor does)'


CALIBRATION: Final = Check(("calibrated", "valid_until"), calibrated_before)
AMPLIFIER_CHECKS: Final = (CALIBRATION, Check(("state",), _operates))
FILTER_CHECKS: Final = (CALIBRATION,)

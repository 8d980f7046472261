"""The settings of a DC supply of the Keysight N6900 / N7900 series (Advanced Power System) that rattle uses.

Sections are those of the N6900/N7900 Series Operating and Service Guide (N7900-90901), chapter 6, "SCPI
Programming Reference"; (M): from memory of guides of the same family, to be checked at the first real one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Annotated, Any, ClassVar, Literal

from daq.quantity import Key, Quantity, rule
from drivers.scpi.language import SERIAL, VISA_ADDRESS, Choice, Number, longest_off_s, reachable

KNOWN_MODELS = re.compile(r"N[67]9[57]\dA")
HIGHEST_V, HIGHEST_A = 160.0, 200.0  # of any model's rating
RESOLUTION_V = 0.01
"""To which the voltage is corrected; the converter of an 80 V model has 1.3 mV (M)."""
OVER_VOLTAGE = 1.1
"""Of the highest voltage that the bench allows: where the supply itself switches off."""
WATCHDOG_DELAY_S = 2.0
"""Silence after which the supply switches off by itself while it drives; it takes 1 s or more."""

_VOLTAGE, _CURRENT, _OUTPUT = "Voltage Subsystem", "Current Subsystem", "Output Subsystem"

# 102 % of the rating can be set, over-voltage to 120 % of it (M); what this model takes it is asked.
VOLTAGE = Number("voltage", "VOLT", "V", 0.0, 1.02 * HIGHEST_V, 5e-3, 1e-3, _VOLTAGE)
PROTECTION = Number("over-voltage protection", "VOLT:PROT", "V", 0.0, 1.2 * HIGHEST_V, 0.02, 2e-3, _VOLTAGE)
SLEW = Number("slew rate", "VOLT:SLEW", "V/s", 0.0, 9.9e37, 1e-3, 0.01, _VOLTAGE)
CURRENT = Number("current limit", "CURR", "A", 0.0, 1.02 * HIGHEST_A, 5e-3, 2e-3, _CURRENT)
WATCHDOG_DELAY = Number("watchdog's delay", "OUTP:PROT:WDOG:DEL", "s", 1.0, 3600.0, 0.5, 0.0, _OUTPUT)
WATCHDOG_ON = Choice("watchdog", "OUTP:PROT:WDOG", "ON", "1", _OUTPUT)
WATCHDOG_OFF = Choice("watchdog", "OUTP:PROT:WDOG", "OFF", "0", _OUTPUT)
CLEAR_PROTECTION = "OUTP:PROT:CLE"
MEASURED_V, MEASURED_A = "MEAS:VOLT?", "MEAS:CURR?"
CONDITION, TROUBLE = "STAT:OPER:COND?", "STAT:QUES:COND?"


class Condition(IntFlag):
    """Operation status group, condition register."""

    CONSTANT_VOLTAGE = 1
    CONSTANT_CURRENT = 2
    OFF = 4


class Trouble(IntFlag):
    """Questionable1 status group, condition register: what has disabled the output; the rest is no such."""

    OVER_VOLTAGE = 1
    OVER_CURRENT = 2
    POWER_FAIL = 4
    OVER_POWER = 8
    OVER_TEMPERATURE = 16
    NEGATIVE_OVER_POWER = 32
    REVERSED_SENSE = 64
    INHIBITED = 512
    WATCHDOG = 2048
    OUTPUT_DYNAMIC = 4096
    SENSE_FAULT = 8192

    @property
    def told(self) -> str:
        return ", ".join(str(each.name).replace("_", " ").lower() for each in self)


@dataclass(frozen=True, slots=True)
class SupplySettings:
    """The table [dc_supply] of a bench: where the supply is, and how far the motor on it may go.

    `rpm_per_volt` is the crank's speed per volt at the motor, `maximum_current` in A bounds its torque. From
    rest to `maximum_speed` the voltage takes `ramp_s`. `resource` is empty where nobody knows it yet; one
    with another `serial` than is given is not driven.
    """

    rpm_per_volt: Annotated[float, Quantity("", 0, 10_000, above=True)]
    maximum_speed_rpm: Annotated[
        float, Quantity("rpm", 0, 100_000, above=True, kept=True, key="maximum_speed")
    ]
    maximum_current: Annotated[float, Quantity("A", 0, HIGHEST_A, above=True)]
    driver: Annotated[Literal["scpi_n6900"], Key()] = "scpi_n6900"
    resource: Annotated[str, VISA_ADDRESS] = ""
    serial: Annotated[str, SERIAL] = ""
    ramp_s: Annotated[float, Quantity("s", 0.1, 60, key="ramp")] = 3.0
    emulated: Annotated[bool, Key()] = False
    name: str = "DC supply"
    timeout_s: float = 2.0  # s; 0.5 at most while it drives
    CHECKS: ClassVar = (
        reachable("supply"),
        rule(
            ("maximum_speed", "rpm_per_volt"),
            lambda supply: supply["maximum_speed"] / supply["rpm_per_volt"] <= HIGHEST_V,
            "maximum_speed",
            lambda supply: (
                f"at most {HIGHEST_V:g} V, not {supply['maximum_speed'] / supply['rpm_per_volt']:g} V: "
                "maximum_speed / rpm_per_volt"
            ),
        ),
    )

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        return {"resource": address}

    def at(self, address: str) -> SupplySettings:
        return replace(self, resource=address)

    @property
    def longest_off_s(self) -> float:
        """See `drivers.scpi.language.longest_off_s`."""
        return longest_off_s(self.resource)

    @property
    def maximum_speed(self) -> float:
        """The highest speed in rad/s."""
        return self.maximum_speed_rpm * math.tau / 60.0

    @property
    def maximum_v(self) -> float:
        """The voltage of the highest speed."""
        return self.maximum_speed_rpm / self.rpm_per_volt

    @property
    def slew_v_per_s(self) -> float:
        return self.maximum_v / self.ramp_s

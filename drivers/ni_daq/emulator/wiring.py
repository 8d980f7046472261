"""What is wired to the inputs of the emulated card, and what such a card can do.

Figures of the NI 9234: 24 bit, +-5 V, 51.2 kHz / n with n = 1 to 31, 2 mA IEPE supply, idle noise 50 uV rms
(NI 9234 datasheet, 374238).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from nidaqmx.error_codes import DAQmxErrors

from daq.errors import ConfigurationError, Problem

FASTEST_HZ = 51200.0
DIVISORS = range(1, 32)
EXCITATION_A = 0.002
_INPUT = re.compile(r"[A-Za-z][A-Za-z0-9_-]*/ai[0-9]{1,3}")


class DaqmxError(Exception):
    """A call that the card refuses, with its DAQmx code."""

    def __init__(self, error: DAQmxErrors, text: str) -> None:
        self.code = int(error.value)
        super().__init__(text)


@dataclass(frozen=True, slots=True)
class Wire:
    """A sensor chain on an input: which channel of the plant it sees, and what it really makes of it.

    `volts_per_unit` is the true sensitivity in V per SI unit, whatever a bench file says; `range_v` is where
    the input clips, in V; `connected` is false for a cable that hangs loose.
    """

    plant_channel: str
    volts_per_unit: float
    range_v: float = 5.0
    connected: bool = True


@dataclass(frozen=True, slots=True)
class CardWiring:
    """The emulated card: its wires by physical channel (`cDAQ1Mod1/ai0`), and what else it says of itself.

    Each device has `inputs_per_device` inputs, more where more are wired; those without a wire show noise of
    `idle_noise_v` rms (V) made from `seed`.
    """

    wires: Mapping[str, Wire]
    product_type: str = "NI 9234"
    serial: int = 0x01E24000
    inputs_per_device: int = 4
    idle_noise_v: float = 50e-6
    seed: int = 0

    def devices(self) -> dict[str, list[str]]:
        """Return the inputs of each device. Raises `ConfigurationError` for names that no input has."""
        wrong = [physical for physical in self.wires if not _INPUT.fullmatch(physical)]
        if wrong:
            problems = [Problem("physical", physical, "an input like cDAQ1Mod1/ai0") for physical in wrong]
            raise ConfigurationError("wiring of the emulated card", problems)
        highest: dict[str, int] = {}
        for physical in self.wires:
            device, _, index = physical.partition("/ai")
            highest[device] = max(highest.get(device, self.inputs_per_device - 1), int(index))
        return {device: [f"{device}/ai{i}" for i in range(last + 1)] for device, last in highest.items()}


@dataclass(frozen=True, slots=True)
class Input:
    """One virtual channel as the client declared it, in V per unit it wants to read."""

    physical: str
    volts_per_unit: float
    maximum: float
    iepe: bool = False


def coerced_rate(rate_hz: float) -> float:
    """Return the slowest rate of the card that is not below `rate_hz`, as DAQmx does."""
    for divisor in reversed(DIVISORS):
        if FASTEST_HZ / divisor >= rate_hz * (1.0 - 1e-9):
            return FASTEST_HZ / divisor
    raise DaqmxError(
        DAQmxErrors.INVALID_ATTRIBUTE_VALUE, f"sample rate {rate_hz:g} Hz is above {FASTEST_HZ:g}"
    )

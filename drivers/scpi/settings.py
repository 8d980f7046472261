"""The settings of a 33220A that rattle uses: command, unit, range, and where the manual says so.

Sections are those of the Agilent 33220A User's Guide (33220-90002), chapter 4, "Remote Interface Reference".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

from daq.quantity import Key, Quantity
from drivers.scpi.language import SERIAL, VISA_ADDRESS, Choice, Number, longest_off_s, reachable


@dataclass(frozen=True, slots=True)
class GeneratorSettings:
    """The table [signal_generator] of a bench: where the generator is and how far it may go.

    `force_per_volt` in N/V is what amplifier and shaker make of a volt at the drive point, where
    `maximum_amplitude` in N bounds |offset| plus peak. `resource` is empty where nobody knows it yet; one
    with another `serial` than is given is not driven.
    """

    force_per_volt: Annotated[float, Quantity("N/V", 0.001, 1000)]
    maximum_amplitude: Annotated[float, Quantity("N", 0, 1000, above=True)]
    driver: Annotated[Literal["scpi_33220a"], Key()] = "scpi_33220a"
    resource: Annotated[str, VISA_ADDRESS] = ""
    serial: Annotated[str, SERIAL] = ""
    emulated: Annotated[bool, Key()] = False
    name: str = "signal generator"
    timeout_s: float = 2.0  # s; 0.5 at most while it drives
    CHECKS: ClassVar = (reachable("generator"),)

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        return {"resource": address}

    def at(self, address: str) -> GeneratorSettings:
        return replace(self, resource=address)

    @property
    def longest_off_s(self) -> float:
        """See `drivers.scpi.language.longest_off_s`."""
        return longest_off_s(self.resource)

    @property
    def maximum_amplitude_v(self) -> float:
        """The largest |offset| plus peak in V, at its output into high impedance."""
        return self.maximum_amplitude / self.force_per_volt


_OUTPUT = "Output Configuration Commands"
_BURST = "Burst Mode Commands"

# Ranges are those into an open circuit; amplitudes are kept to 4 digits, frequencies to 1 uHz.
FREQUENCY = Number("frequency", "FREQ", "Hz", 1e-6, 20e6, 1e-6, 1e-9, _OUTPUT)
AMPLITUDE = Number("amplitude", "VOLT", "Vpp", 0.02, 20.0, 1e-4, 5e-4, _OUTPUT)
OFFSET = Number("offset", "VOLT:OFFS", "V", -10.0, 10.0, 1e-3, 5e-4, _OUTPUT)

SINE = Choice("waveform", "FUNC", "SIN", "SIN", _OUTPUT)
# Told of a load of 50 ohm it would show half of the volts that an open input really gets.
OPEN_CIRCUIT = Choice("output load", "OUTP:LOAD", "INF", "9.9E37", _OUTPUT)
PEAK_TO_PEAK = Choice("amplitude unit", "VOLT:UNIT", "VPP", "VPP", _OUTPUT)  # amplitudes here are in Vpp
TRIGGERED_BURST = (  # a sine that waits for *TRG and then runs without an end
    Choice("burst mode", "BURS:MODE", "TRIG", "TRIG", _BURST),
    Choice("trigger source", "TRIG:SOUR", "BUS", "BUS", "Triggering Commands"),  # before an infinite count
    Choice("burst count", "BURS:NCYC", "INF", "9.9E37", _BURST),
    Choice("burst phase", "BURS:PHAS", "0", "0", _BURST),
    Choice("burst", "BURS:STAT", "ON", "1", _BURST),
)

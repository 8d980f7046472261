"""The impact beam's bench: every instrument, emulated."""

from __future__ import annotations

from typing import Final

BENCH: Final = """\
[signal_generator]
driver = "scpi_33220a"
emulated = true
force_per_volt = "3.6 N/V"
maximum_amplitude = "12 N"

[daq_card]
driver = "nidaqmx"
emulated = true
buffer = "10 s"

[[daq_card.channels]]
name = "drive.force"
physical = "cDAQ1Mod1/ai0"
kind = "voltage"
sensitivity = "100 mV/N"
range = "50 N"
serial = "EMU-101"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "contact.force_upper"
physical = "cDAQ1Mod1/ai1"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "6 mV/pC"
range = "200 N"
serial = "EMU-102"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "contact.force_lower"
physical = "cDAQ1Mod1/ai2"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "6 mV/pC"
range = "200 N"
serial = "EMU-103"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "yoke.force"
physical = "cDAQ1Mod1/ai3"
kind = "force_iepe"
sensitivity = "22.4 mV/N"
range = "200 N"
serial = "EMU-104"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "base.acceleration"
physical = "cDAQ1Mod2/ai0"
kind = "acceleration_iepe"
sensitivity = "100 mV/g"
range = "50 g"
serial = "EMU-105"
calibrated = 2026-05-04
valid_until = 2036-05-04
"""

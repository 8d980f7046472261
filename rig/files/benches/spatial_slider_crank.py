"""The spatial slider-crank's bench: every instrument, emulated."""

from __future__ import annotations

from typing import Final

BENCH: Final = """\
[inverter]
driver = "mitsubishi_fr"
emulated = true
rpm_per_hz = 5.0
maximum_speed = "350 rpm"

[daq_card]
driver = "nidaqmx"
emulated = true
buffer = "10 s"

[[daq_card.channels]]
name = "slider.force_1"
physical = "cDAQ1Mod1/ai0"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-301"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "slider.force_2"
physical = "cDAQ1Mod1/ai1"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-302"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "slider.force_3"
physical = "cDAQ1Mod1/ai2"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-303"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "slider.force_4"
physical = "cDAQ1Mod1/ai3"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-304"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "slider.force_5"
physical = "cDAQ1Mod2/ai0"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-305"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "slider.force_6"
physical = "cDAQ1Mod2/ai1"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-306"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "slider.force_7"
physical = "cDAQ1Mod2/ai2"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-307"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "slider.force_8"
physical = "cDAQ1Mod2/ai3"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"
serial = "EMU-308"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "socket.force"
physical = "cDAQ1Mod3/ai0"
kind = "voltage"
sensitivity = "5 mV/N"
range = "1000 N"
serial = "EMU-309"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "motor.tachometer"
physical = "cDAQ1Mod3/ai1"
kind = "tachometer"
sensitivity = "10 mV/rpm"
range = "400 rpm"
serial = "EMU-310"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "flywheel.marker"
physical = "cDAQ1Mod3/ai2"
kind = "marker"
range = "10 V"
serial = "EMU-311"
calibrated = 2026-05-04
valid_until = 2036-05-04
"""

"""The planar slider-crank's bench: every instrument, emulated."""

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
name = "crank_frame.acceleration_y"
physical = "cDAQ1Mod1/ai0"
kind = "acceleration_iepe"
sensitivity = "50 mV/g"
range = "100 g"
serial = "EMU-201"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "crank_frame.acceleration_x"
physical = "cDAQ1Mod1/ai1"
kind = "acceleration_iepe"
sensitivity = "50 mV/g"
range = "100 g"
serial = "EMU-202"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "piston_frame.acceleration_y"
physical = "cDAQ1Mod1/ai2"
kind = "acceleration_iepe"
sensitivity = "50 mV/g"
range = "100 g"
serial = "EMU-203"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "crank.angle"
physical = "cDAQ1Mod3/ctr0"
kind = "encoder"
pulses_per_revolution = 1024
decoding = "x4"
index = true
serial = "EMU-204"
calibrated = 2026-05-04
valid_until = 2036-05-04

[[daq_card.channels]]
name = "crank.marker"
physical = "cDAQ1Mod1/ai3"
kind = "marker"
range = "10 V"
serial = "EMU-205"
calibrated = 2026-05-04
valid_until = 2036-05-04
"""

"""A kind of sensor that the card may have: a capacitive accelerometer, which gives volts and sees gravity."""

from __future__ import annotations

from drivers.ni_daq.sensors import ACCELERATION, AnalogSensor, SensorKind, declare_voltage

ACCELERATION_MEMS = SensorKind(AnalogSensor(ACCELERATION, declare_voltage, takes=("filter",)))

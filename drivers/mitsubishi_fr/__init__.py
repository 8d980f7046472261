"""Mitsubishi FR-D700 and FR-E700 inverters over Modbus RTU on their PU connector."""

from drivers.mitsubishi_fr.inverter import FrInverter, reset_tripped
from drivers.mitsubishi_fr.settings import InverterMisconfigured, InverterSettings

__all__ = ["FrInverter", "InverterMisconfigured", "InverterSettings", "reset_tripped"]

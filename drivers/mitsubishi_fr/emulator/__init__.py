"""An FR-D700 that is not there: its behaviour, the disturbances of its line, a server that speaks for it."""

from drivers.mitsubishi_fr.emulator.drive import DriveFaults, InverterSetup, Trip
from drivers.mitsubishi_fr.emulator.line_faults import LineFaults
from drivers.mitsubishi_fr.emulator.process import InverterWiring, start_inverter

__all__ = ["DriveFaults", "InverterSetup", "InverterWiring", "LineFaults", "Trip", "start_inverter"]

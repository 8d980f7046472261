"""What the rig asks of its instruments, one file an instrument, and what emulators ask of their plant."""

from drivers.protocols.actuator import Actuator, ActuatorOutput
from drivers.protocols.card import AcquisitionCard, CardReading, Finding, Plant
from drivers.protocols.encoder import (
    Emergency,
    PositionBlock,
    PositionEncoder,
    PositionGap,
    PositionStatistics,
    Shaft,
)
from drivers.protocols.generator import DriveGenerator, DriveSettings
from drivers.protocols.instrument import Instrument
from drivers.protocols.notice import Notice
from drivers.protocols.speed_drive import InverterOutput, MotorLoad, MotorState, SpeedDrive

__all__ = [
    "AcquisitionCard",
    "Actuator",
    "ActuatorOutput",
    "CardReading",
    "DriveGenerator",
    "DriveSettings",
    "Emergency",
    "Finding",
    "Instrument",
    "InverterOutput",
    "MotorLoad",
    "MotorState",
    "Notice",
    "Plant",
    "PositionBlock",
    "PositionEncoder",
    "PositionGap",
    "PositionStatistics",
    "Shaft",
    "SpeedDrive",
]

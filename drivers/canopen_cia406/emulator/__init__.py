"""A CANopen encoder on a bus of its own, behind a socketcand server."""

from drivers.canopen_cia406.emulator.process import start_encoder
from drivers.canopen_cia406.emulator.setup import EncoderSetup

__all__ = ["EncoderSetup", "start_encoder"]

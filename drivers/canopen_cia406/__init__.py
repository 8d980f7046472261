"""Absolute rotary encoders on a CAN bus: CANopen (CiA 301), encoder profile CiA 406."""

from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.canopen_cia406.settings import EncoderSettings

__all__ = ["CanopenEncoder", "EncoderSettings"]

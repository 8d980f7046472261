"""Absolute rotary encoders on a CAN bus: CANopen (CiA 301), encoder profile CiA 406."""

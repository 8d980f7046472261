"""The channels of the planar slider-crank: names and units."""

from __future__ import annotations

CRANK_Y = "crank_frame.acceleration_y"
CRANK_X = "crank_frame.acceleration_x"
PISTON_Y = "piston_frame.acceleration_y"
ANGLE, MARKER = "crank.angle", "crank.marker"
ACCELERATIONS = (CRANK_Y, CRANK_X, PISTON_Y)
_UNITS = {**dict.fromkeys(ACCELERATIONS, "m/s2"), ANGLE: "rad", MARKER: "V"}
CHANNELS = tuple(_UNITS)


def channel_unit(name: str) -> str:
    """Unit of a channel; raises KeyError for a name that the rig does not have."""
    return _UNITS[name]

"""The channels of the spatial slider-crank: names and units.

Points 1 to 4 are at the end towards the crank (+y, -y, +z, -z), 5 to 8 at the other end.
"""

from __future__ import annotations

GUIDE_FORCES = tuple(f"slider.force_{point}" for point in range(1, 9))
FORCES = (*GUIDE_FORCES, "socket.force")
TACHOMETER, MARKER = "motor.tachometer", "flywheel.marker"
CHANNELS = (*FORCES, TACHOMETER, MARKER)


def channel_unit(name: str) -> str:
    """Unit of a channel; raises KeyError for a name that the rig does not have."""
    if name in FORCES:
        return "N"
    return {TACHOMETER: "rad/s", MARKER: "V"}[name]

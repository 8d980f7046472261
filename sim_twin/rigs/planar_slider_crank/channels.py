"""The channels of the planar slider-crank."""

from __future__ import annotations

from sim_twin.rigs.channel_table import ChannelTable, RigChannel, Role


def _on_the_frame(location: str, place: str, group: str, order_rank: int) -> RigChannel:
    return RigChannel(location, "acceleration", "m/s2", Role.VIBRATION, place, group, order_rank)


CHANNELS = ChannelTable(
    (
        _on_the_frame("crank_frame", "y", "crank y", 1),
        _on_the_frame("crank_frame", "x", "crank x", 2),
        _on_the_frame("piston_frame", "y", "piston y", 3),
        RigChannel("crank", "angle", "rad", Role.ANGLE),
        RigChannel("crank", "marker", "V", Role.MARKER),
    )
)
ACCELERATIONS = CHANNELS.with_role(Role.VIBRATION)
CRANK_Y, CRANK_X, PISTON_Y = ACCELERATIONS
ANGLE, MARKER = CHANNELS.angle, CHANNELS.marker

"""The channels of the spatial slider-crank.

Points 1 to 4 are at the end towards the crank (+y, -y, +z, -z), 5 to 8 at the other end.
"""

from __future__ import annotations

from sim_twin.rigs.channel_table import ChannelTable, RigChannel, Role

_BOUNCES_S = 5e-3
"""Of these joints, which are struck from several sides many times a turn, and pressed in between."""
_LOOKED_AT = {3: 2, 4: 3}
"""Points that gravity presses, by their rank among the orders; the socket comes first."""


CHANNELS = ChannelTable(
    (
        *(
            RigChannel(
                "slider",
                "force",
                "N",
                Role.CONTACT,
                str(point),
                "guide",
                _LOOKED_AT.get(point, 0),
                bounces_s=_BOUNCES_S,
            )
            for point in range(1, 9)
        ),
        RigChannel("socket", "force", "N", Role.CONTACT, group="socket", order_rank=1, bounces_s=_BOUNCES_S),
        RigChannel("motor", "tachometer", "rad/s", Role.SPEED),
        RigChannel("flywheel", "marker", "V", Role.MARKER),
    )
)
FORCES = CHANNELS.with_role(Role.CONTACT)
(TACHOMETER,) = CHANNELS.with_role(Role.SPEED)
MARKER = CHANNELS.marker

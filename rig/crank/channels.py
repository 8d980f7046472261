"""The channels of each rig with a crank: what tells its angle, what vibrates, where it is struck."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

ENCODER_ANGLE: Final = "encoder.angle"
"""Of an encoder that sends by itself beside the card, at a rate of its own; any rig's crank may have one."""


@dataclass(frozen=True, slots=True)
class CrankChannels:
    """The angle comes from the channel `angle` where it is measured, else from `marker`.

    `impacts` are groups of channels whose blows are shown together, `ordered` the channels whose orders are
    looked at first. `plain` channels tell how the rig moves rather than how it vibrates.
    """

    angle: str
    marker: str
    plain: frozenset[str]
    ordered: tuple[str, ...]
    impacts: Mapping[str, tuple[str, ...]]

    def heard(self, channels: Collection[str]) -> dict[str, tuple[str, ...]]:
        """Those of `channels` whose blows are shown, in their groups."""
        groups = {
            group: tuple(name for name in names if name in channels) for group, names in self.impacts.items()
        }
        return {group: names for group, names in groups.items() if names}


_CRANK_Y, _CRANK_X = "crank_frame.acceleration_y", "crank_frame.acceleration_x"
_PISTON_Y = "piston_frame.acceleration_y"

PLANAR_SLIDER_CRANK: Final = CrankChannels(
    angle="crank.angle",
    marker="crank.marker",
    plain=frozenset(("crank.angle", "crank.marker", ENCODER_ANGLE)),
    ordered=(_CRANK_Y, _CRANK_X, _PISTON_Y),
    impacts={"crank y": (_CRANK_Y,), "crank x": (_CRANK_X,), "piston y": (_PISTON_Y,)},
)

_GUIDE = tuple(f"slider.force_{point}" for point in range(1, 9))
_SOCKET = "socket.force"

SPATIAL_SLIDER_CRANK: Final = CrankChannels(
    angle="crank.angle",
    marker="flywheel.marker",
    plain=frozenset(("crank.angle", "flywheel.marker", "motor.tachometer", ENCODER_ANGLE)),
    ordered=(_SOCKET, "slider.force_3", "slider.force_4"),
    impacts={"guide": _GUIDE, "socket": (_SOCKET,)},
)

"""A rig with a crank: what it has to tell of itself, and how it is shown then."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from rig.live.crank import mechanism
from rig.live.crank.impact_picture import impact_view
from rig.live.crank.joints import Joint, joints_view
from rig.live.crank.mechanism import Body, Pose, Solid
from rig.live.crank.order_picture import order_view
from rig.live.crank.play import CrankPlay
from rig.live.crank.speed_plot import speed_view
from rig.live.picture import OwnViews, Stage
from rig.live.shown import Shown
from sim_twin.rigs.channel_table import ChannelTable


class CrankPicture(ABC):
    """A mechanism whose crank angle is measured."""

    rig: ClassVar[str]
    __dataclass_fields__: ClassVar[dict[str, Any]]
    channels: ClassVar[ChannelTable]

    @property
    @abstractmethod
    def set_rad_s(self) -> float:
        """The speed that was set, rad/s."""

    @abstractmethod
    def eye(self) -> rrb.EyeControls3D:
        """Where the mechanism is looked at from."""

    @abstractmethod
    def fixed(self) -> tuple[Solid, ...]:
        """What does not move."""

    @abstractmethod
    def bodies(self) -> tuple[Body, ...]:
        """What moves."""

    @abstractmethod
    def poses(self, angle: NDArray[np.float64]) -> tuple[Pose, ...]:
        """Where each body is at crank angles in rad, shape (n,), with ideal joints."""

    @abstractmethod
    def joints(self) -> tuple[Joint, ...]:
        """The joints with clearance."""

    @abstractmethod
    def eccentricity(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Journal's centre less bearing's in m, shape (joints, 2), of a twin whose shape is `points_m`."""

    def views(self, shown: Shown) -> OwnViews:
        """Mechanism, joints, impacts and speed at the side, orders beside the traces."""
        side: list[tuple[rrb.View | rrb.Container, float]] = [(self._mechanism_view(shown), 2.8)]
        if shown.origins.get("predicted"):
            side.append((joints_view(self.joints()), 1.9))
        impacts = [impact_view(group, shown.units[names[0]]) for group, names in self.heard(shown).items()]
        if impacts:
            side.append((rrb.Tabs(*impacts) if len(impacts) > 1 else impacts[0], 2.6))
        side.append((speed_view(self.set_rad_s, shown.window_s), 1.7))
        orders = tuple(order_view(name, shown.units[name]) for name in self.turning(shown))
        return OwnViews(tuple(side), orders, self.channels.plain)

    def play(self, stage: Stage) -> CrankPlay:
        """What fills them."""
        return CrankPlay(self, stage)

    def turning(self, shown: Shown) -> tuple[str, ...]:
        """Those of the channels whose orders are shown."""
        return tuple(name for name in self.channels.ordered if name in shown.units)

    def heard(self, shown: Shown) -> dict[str, tuple[str, ...]]:
        """Those of the channels whose blows are shown, in their groups."""
        return self.channels.heard(shown.units)

    def _mechanism_view(self, shown: Shown) -> rrb.Spatial3DView:
        both = shown.origins.get("measured") and shown.origins.get("predicted")
        whose = "measured" if shown.origins.get("measured") else "predicted"
        line = "; line: the predicted" if both else ""
        return rrb.Spatial3DView(
            origin=mechanism.PATH,
            name=f"Mechanism at the {whose} crank angle, ideal joints{line}",
            line_grid=False,
            eye_controls=self.eye(),
        )

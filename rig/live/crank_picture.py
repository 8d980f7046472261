"""A rig with a crank: what it has to tell of itself, and how it is shown then."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.log.reader import CRANK_SPEED, Origin, derived_name
from daq.log.records import Impact
from rig.derived.order_lines import OrderLines
from rig.derived.settings import role_of
from rig.derived.turns import KEPT_S, Turns, turns_from
from rig.live import mechanism, paths
from rig.live.crank_plots import IMPACT_FRAME, ORDER_FRAME, ImpactPicture, OrderPicture, SpeedPlot, speed_view
from rig.live.mechanism import Body, Joint, JointPicture, MovingMechanism, Pose, Solid, joints_view
from rig.live.picture import Layout, OwnViews, Point, Stage, in_plot, looking
from rig.live.sketch import LATER, Line, sketched
from rig.stream import Block, LastSeconds, Record, Shape
from sim_twin.rigs.channel_table import ChannelTable

_LOOKS_EVERY_S = 0.25
_DRAWS_EVERY_S = 1.0


class CrankPicture(ABC):
    """A mechanism whose crank angle is measured."""

    rig: ClassVar[str]
    channels: ClassVar[ChannelTable]

    speed_rad_s: float
    """The speed that was set."""
    marker_angle_rad: float
    """At which a mark comes."""

    rod_m: float
    seen: ClassVar[tuple[Point, Point, Point]]
    """From where it is looked at, toward where, in lengths of the rod, and what is up."""

    def eye(self) -> rrb.EyeControls3D:
        return looking(self.rod_m, *self.seen)

    def sketch(self, shown: Layout) -> CrankSketch:
        return CrankSketch(self, shown)

    @abstractmethod
    def fixed(self) -> tuple[Solid, ...]: ...

    @abstractmethod
    def bodies(self) -> tuple[Body, ...]: ...

    @abstractmethod
    def poses(self, angle: NDArray[np.float64]) -> tuple[Pose, ...]:
        """Where each body is at crank angles in rad, shape (n,), with ideal joints."""

    @abstractmethod
    def joints(self) -> tuple[Joint, ...]: ...

    @abstractmethod
    def eccentricity(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Journal's centre less bearing's in m, shape (joints, 2), of a twin whose shape is `points_m`."""

    def views(self, shown: Layout) -> OwnViews:
        """Mechanism, joints, impacts and speed at the side, orders beside the traces."""
        both = shown.origins.get("measured") and shown.origins.get("predicted")
        whose = "measured" if shown.origins.get("measured") else "predicted"
        line = "; line: predicted" if both else ""
        moving = rrb.Spatial3DView(
            origin=mechanism.PATH,
            name=f"Mechanism, {whose}{line}",
            line_grid=False,
            eye_controls=self.eye(),
        )
        side: list[tuple[rrb.View | rrb.Container, float]] = [(moving, 2.8)]
        if shown.origins.get("predicted"):
            side.append((joints_view(self.joints()), 1.9))
        impacts = [
            IMPACT_FRAME.view(paths.impacts(group), f"Impacts, {group} [{in_plot(shown.units[names[0]])}]")
            for group, names in self.heard(shown).items()
        ]
        if impacts:
            side.append((rrb.Tabs(*impacts) if len(impacts) > 1 else impacts[0], 2.6))
        side.append((speed_view(self.speed_rad_s, shown.window_s), 1.7))
        orders = tuple(
            ORDER_FRAME.view(paths.orders(name), f"{name} over orders [{in_plot(shown.units[name])}]")
            for name in self.turning(shown)
        )
        return OwnViews(tuple(side), orders, self.channels.plain)

    def play(self, stage: Stage) -> CrankPlay:
        return CrankPlay(self, stage)

    def turning(self, shown: Layout) -> tuple[str, ...]:
        return tuple(name for name in self.channels.ordered if name in shown.units)

    def heard(self, shown: Layout) -> dict[str, tuple[str, ...]]:
        return self.channels.heard(shown.units)


class CrankSketch:
    """The bodies as lines, by the crank angle and with ideal joints."""

    def __init__(self, picture: CrankPicture, shown: Layout) -> None:
        self._picture, self._shown = picture, shown
        place, target, up = (np.array(each) for each in picture.seen)
        right = np.cross(target - place, up)
        upward = np.cross(right, target - place)
        self._plane = np.stack((right / np.linalg.norm(right), upward / np.linalg.norm(upward)))
        turn = np.concatenate([line for each in self._frames(np.linspace(0, 2 * np.pi, 37)) for line in each])
        room = 0.08 * picture.rod_m
        left, low = turn.min(axis=0) - room
        right_edge, high = turn.max(axis=0) + room
        self._room = float(left), float(low), float(right_edge), float(high)

    def note(self, shape: Shape, begin_s: float, cycle_s: float) -> None:
        """Joints are ideal here."""

    def drawn(self, angles: Mapping[Origin, NDArray[np.floating]]) -> dict[str, Any]:
        """One revolution of each origin that shows its angle."""
        each = {self._shown.whose(origin): self._frames(angle) for origin, angle in angles.items()}
        frames = [
            [(whose, line) for whose, of in each.items() for line in of[at]]
            for at in range(min(map(len, each.values()), default=0))
        ]
        path = np.array([frame[1][0] for frame in self._frames(np.linspace(0, 2 * np.pi, 37))])
        still, later = ([], "") if frames else (self._frames(np.zeros(1))[0], LATER)
        caption = f"one revolution, slowed; ideal joints{later}"
        return sketched(caption, [path, *still], frames, self._room)

    def _frames(self, angle: NDArray[np.floating]) -> list[list[Line]]:
        """The line of each body at angles in rad, shape (n,)."""
        picture = self._picture
        known = np.isfinite(angle)
        poses = picture.poses(np.asarray(angle[known], dtype=np.float64))
        bodies = [
            (place[:, None] + np.array(body.line) @ turned.transpose(0, 2, 1)) @ self._plane.T
            for body, (place, turned) in zip(picture.bodies(), poses, strict=True)
        ]
        return [[lines[at] for lines in bodies] for at in range(int(known.sum()))]


class _Turning:
    """One origin's crank: its angle, and what is found by it."""

    def __init__(self, picture: CrankPicture, stage: Stage, turns: Turns, channels: tuple[str, ...]) -> None:
        self.turns = turns
        self.orders = OrderLines()
        self.ordered = {
            name: LastSeconds(KEPT_S) for name in picture.turning(stage.shown) if name in channels
        }
        self.ordered_until = 0
        self.drawn_blocks = 0
        self.looked_s = self.drawn_s = 0.0


class CrankPlay:
    """Mechanism, joints, orders, impacts and speed.

    Impacts and speed come as the log has them. What is found by the angle here waits until that is known: the
    mechanism is looked at four times a second of the origin's own time, orders once a second. What has waited
    longer than turns are kept for is left out.
    """

    def __init__(self, picture: CrankPicture, stage: Stage) -> None:
        self._picture, self._stage = picture, stage
        self._turning: dict[Origin, _Turning] = {}
        for origin, names in stage.shown.origins.items():
            shows = picture.channels
            turns = turns_from(tuple(names), shows.angle, shows.marker, picture.marker_angle_rad)
            if turns is not None:
                self._turning[origin] = _Turning(picture, stage, turns, tuple(names))
        moving = [origin for origin in self._turning if origin != "nominal"]
        self._mechanism = MovingMechanism(stage, picture, moving)
        self._joints = JointPicture(stage, picture.joints())
        self._speed = SpeedPlot(stage, picture.speed_rad_s)
        shown, recording = stage.shown, stage.recording
        self._orders = {name: OrderPicture(recording, name) for name in picture.turning(shown)}
        self._impacts: dict[str, ImpactPicture] = {}
        for group, names in picture.heard(shown).items():
            drawn = ImpactPicture(stage, group, role_of(names[0]))
            self._impacts |= dict.fromkeys(names, drawn)
        self._speeds = {derived_name(origin, CRANK_SPEED): origin for origin in shown.origins}

    def open(self) -> None:
        self._mechanism.open()
        self._joints.open()
        self._speed.open()

    def take(self, record: Record) -> None:
        match record:
            case Block("derived", samples) if samples.channel in self._speeds:
                times_s = self._stage.times_of(samples)
                self._speed.show(self._speeds[samples.channel], times_s, samples.values)
            case Block(origin, samples) if origin in self._turning:
                self._follow(origin, self._turning[origin], samples)
            case Impact() if record.channel in self._impacts:
                whose = self._stage.shown.whose(record.origin)
                time_s = self._stage.time_of(record.time_ns)
                self._impacts[record.channel].add(whose, time_s, record)
            case Shape(time_s, points_m):
                self._joints.show(time_s, self._picture.eccentricity(points_m))

    def finish(self) -> None:
        for impacts in self._impacts.values():
            impacts.finish()

    def _follow(self, origin: Origin, turning: _Turning, block: SampleBlock) -> None:
        if block.channel in turning.ordered:
            turning.ordered[block.channel].add(block)
        if block.channel != turning.turns.channel:
            return
        turning.turns.add(block)
        end_s = block.end_sample / block.sample_rate
        if not 0 <= end_s - turning.looked_s < _LOOKS_EVERY_S:
            turning.looked_s = end_s
            self._mechanism.follow(origin, turning.turns, block.sample_rate)
        if not 0 <= end_s - turning.drawn_s < _DRAWS_EVERY_S:
            turning.drawn_s = end_s
            if turning.ordered:  # the samples whose turns are known, at most what is kept
                recent = turning.ordered.values()
                end = min(turning.turns.known_until, *(each.end_sample for each in recent))
                first = max(min(turning.ordered_until, end), end - round(KEPT_S * block.sample_rate))
                turning.ordered_until = end
                if end > first:
                    values = np.array([each.between(first, end) for each in recent])
                    turning.orders.add(values, turning.turns.at(np.arange(first, end)))
            self._stage.at(end_s)
            whose = self._stage.shown.whose(origin)
            amplitude = turning.orders.amplitude
            if amplitude is not None and turning.orders.blocks != turning.drawn_blocks:
                turning.drawn_blocks = turning.orders.blocks
                for name, each in zip(turning.ordered, amplitude, strict=True):
                    self._orders[name].draw(whose, turning.orders.order, each)

"""Fills the views of a rig with a crank from the blocks of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from daq.block import SampleBlock
from daq.derived_names import CRANK_SPEED, derived_name
from daq.log.reader import Origin
from daq.log.records import Impact
from rig.crank.order_lines import OrderLines
from rig.crank.recent import Recent
from rig.crank.turns import KEPT_S, Turns, turns_from
from rig.live.crank.impact_picture import ImpactPicture
from rig.live.crank.joints import JointPicture
from rig.live.crank.mechanism import MovingMechanism
from rig.live.crank.order_picture import OrderPicture
from rig.live.crank.speed_plot import SpeedPlot
from rig.live.picture import Stage
from rig.stream import Block, Record, Shape

if TYPE_CHECKING:  # it names this module, which fills its views
    from rig.live.crank.picture import CrankPicture

_LOOKS_EVERY_S = 0.25
_DRAWS_EVERY_S = 1.0


class _Turning:
    """One origin's crank: its angle, and what is found by it."""

    def __init__(self, picture: CrankPicture, stage: Stage, turns: Turns, channels: tuple[str, ...]) -> None:
        self.turns = turns
        self.orders = OrderLines()
        self.ordered = {name: Recent(KEPT_S) for name in picture.turning(stage.shown) if name in channels}
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
            turns = turns_from(tuple(names), picture.channels.angle, picture.channels.marker)
            if turns is not None:
                self._turning[origin] = _Turning(picture, stage, turns, tuple(names))
        moving = [origin for origin in self._turning if origin != "nominal"]
        self._mechanism = MovingMechanism(stage, picture, moving)
        self._joints = JointPicture(stage, picture.joints())
        self._speed = SpeedPlot(stage, picture.set_rad_s)
        shown, recording = stage.shown, stage.recording
        self._orders = {name: OrderPicture(recording, name) for name in picture.turning(shown)}
        self._impacts: dict[str, ImpactPicture] = {}
        for group, names in picture.heard(shown).items():
            drawn = ImpactPicture(stage, group, shown.units[names[0]])
            self._impacts |= dict.fromkeys(names, drawn)
        self._speeds = {derived_name(origin, CRANK_SPEED): origin for origin in shown.origins}

    def open(self) -> None:
        """Log what stays."""
        self._mechanism.open()
        self._joints.open()
        self._speed.open()

    def take(self, record: Record) -> None:
        """Show what a record brings to light."""
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
        """Show the last impacts."""
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
            self._order(turning, block.sample_rate)
            self._stage.at(end_s)
            self._draw(origin, turning)

    def _order(self, turning: _Turning, sample_rate: float) -> None:
        """Hand the samples whose turns are known to the orders, at most what is kept."""
        if not turning.ordered:
            return
        recent = turning.ordered.values()
        end = min(turning.turns.known_until, *(each.end_sample for each in recent))
        first = max(min(turning.ordered_until, end), end - round(KEPT_S * sample_rate))
        turning.ordered_until = end
        if end > first:
            values = np.array([each.between(first, end) for each in recent])
            turning.orders.add(values, turning.turns.at(np.arange(first, end)))

    def _draw(self, origin: Origin, turning: _Turning) -> None:
        whose = self._stage.shown.whose(origin)
        amplitude = turning.orders.amplitude
        if amplitude is not None and turning.orders.blocks != turning.drawn_blocks:
            turning.drawn_blocks = turning.orders.blocks
            for name, each in zip(turning.ordered, amplitude, strict=True):
                self._orders[name].draw(whose, turning.orders.order, each)

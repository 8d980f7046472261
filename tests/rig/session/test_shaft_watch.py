"""A shaft's speed by whatever shows it at the moment, and a motor whose loop is closed by that."""

from __future__ import annotations

import math

import numpy as np
import pytest

from daq.block import Flag
from daq.channel import Channel
from daq.errors import InterlockTripped
from drivers.protocols.card import CardReading
from rig.session.motor import Motor
from rig.session.shaft_speed import STANDS_RPM
from rig.session.shaft_watch import ShaftWatch
from tests.rig.session.shafts import STEP_RPM, FakeDrive, SteppedClock

RATE, STEP_S = 10_240.0, 0.02
RAD_S = 200.0 * math.tau / 60.0
FORCE, MARKER = Channel("socket.force", "N"), Channel("flywheel.marker", "V")
TACHOMETER = Channel("motor.tachometer", "rad/s")


class Bench:
    """A motor whose shaft the channels of a card show; its tachometer shows `gain` times the speed."""

    def __init__(self, *channels: Channel, slip: float = 0.0, gain: float = 1.0) -> None:
        self.drive = FakeDrive(SteppedClock(), slip=slip)
        self.watch = ShaftWatch(channels, RATE, self.drive.clock)
        self._channels, self._gain = channels, gain
        self._began_s, self._angle, self._next = self.drive.clock.now_s, 0.0, 0

    def records(self, reading: CardReading) -> bool:
        """As an `Acquisition` before its record begins."""
        return False

    def wait(self, seconds: float) -> None:
        """Let time pass, and the samples of it come."""
        self.drive.clock.sleep(seconds)
        count = round((self.drive.clock.now_s - self._began_s) * RATE) - self._next
        rad_s = self.drive.shaft_rpm() * math.tau / 60.0
        angle = self._angle + rad_s / RATE * np.arange(1, count + 1)
        shown = {
            FORCE.name: np.zeros(count),
            MARKER.name: 5.0 * (np.mod(angle, math.tau) < np.deg2rad(5)),
            TACHOMETER.name: np.full(count, self._gain * rad_s),
        }
        values = np.stack([shown[channel.name] for channel in self._channels])
        flags = (Flag.GOOD,) * len(self._channels)
        reading = CardReading(self._next, values, flags, self.drive.clock.now_s)
        assert list(self.watch.take(reading, self)) == []  # type: ignore[arg-type]
        self._angle, self._next = float(angle[-1]), self._next + count

    def turn(self, rpm: float, seconds: float) -> float:
        """Let the shaft turn so fast for so long; the speed that is shown then."""
        self.drive.ripple = lambda _: rpm
        for _ in range(round(seconds / STEP_S)):
            self.wait(STEP_S)
        return self.watch.rpm()

    def started(self) -> Motor:
        motor = Motor(self.drive, RAD_S, self.wait, self.watch.rpm, self.drive.clock)
        motor.arm(soft=True)
        motor.start(soft=True)
        return motor


def test_a_loop_is_closed_by_a_tachometer_where_neither_angle_nor_mark_shows_the_shaft() -> None:
    bench = Bench(FORCE, TACHOMETER, slip=0.02)
    motor = bench.started()
    assert bench.drive.shaft_rpm() == pytest.approx(200.0, abs=STEP_RPM / 2 + 1e-9)
    assert [notice.code for notice in motor.take_notices()] == ["motor.trimmed"]
    with pytest.raises(InterlockTripped, match="no instrument shows that the shaft turns"):
        Bench(FORCE, slip=0.02).started()


def test_a_tachometer_shows_a_shaft_until_its_marks_do_and_where_they_are_too_slow() -> None:
    """Marks come every 2 s, and four of them tell a speed; the tachometer's is 5 % too high."""
    bench = Bench(MARKER, TACHOMETER, gain=1.05)
    assert math.isnan(bench.turn(0.9 / 1.05 * STANDS_RPM, 0.1))  # it may stand
    assert bench.turn(30.0, 1.0) == pytest.approx(31.5)
    assert bench.turn(30.0, 7.5) == pytest.approx(30.0, rel=1e-3)
    assert bench.turn(10.0, 2.5) == pytest.approx(10.5)  # the next mark is overdue
    assert math.isnan(bench.turn(0.0, 0.1))


def test_a_motor_that_its_marks_show_late_is_trimmed_by_them_all_the_same() -> None:
    """The tachometer takes the shaft up; what is held is the marks' speed, not its own, 5 % off."""
    bench = Bench(MARKER, TACHOMETER, slip=0.02, gain=1.05)
    bench.started()
    assert bench.drive.shaft_rpm() == pytest.approx(200.0, rel=1e-3)

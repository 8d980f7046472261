"""What a person sets is asked for, awaited and believed when it is measured; rest as well."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pytest

from daq.block import Flag
from daq.channel import Channel
from daq.errors import InstrumentRefused, InterlockTripped
from drivers.manual.actuator import ManualActuator
from drivers.manual.settings import ManualMotorSettings
from rig.session.by_hand import HELD_S, REST_S, ByHand, ShaftSeen, SineSeen
from rig.session.drive import Motion, drive_off_after
from rig.session.interlock import ForceWatch
from rig.session.shaft_speed import ShaftSpeed
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.model import SineDrive
from tests.rig.session.fakes import silent_screen
from tests.rig.session.shafts import SteppedClock

RPM = math.tau / 60.0
DRIVE = SpeedDrive(200.0 * RPM)
SETTINGS = ManualMotorSettings(maximum_speed_rpm=300.0, patience_s=60.0)


@dataclass
class Person(ManualActuator):
    """Does by `does(order)` what is asked, after a second."""

    clock: SteppedClock
    does: Callable[[tuple[object, ...], float], float] = lambda order, rpm: rpm
    rpm: float = 0.0
    due: tuple[float, float] = (math.inf, 0.0)
    asked: list[tuple[str, tuple[object, ...]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(SETTINGS)

    def ask(self, words: str, *order: object) -> None:
        self.asked.append((words, order))
        self._moves = True
        self.due = self.clock.now_s + 1.0, self.does(order, self.rpm)

    def measured_rpm(self) -> float:
        """As a marker shows it: the last speed for a turn of it, then nothing of a shaft that has stopped."""
        if self.clock.now_s >= self.due[0]:
            last_rpm, self.rpm = self.rpm, self.due[1]
            if not self.rpm and self.clock.now_s < self.due[0] + 60.0 / (last_rpm or math.inf):
                self.rpm = last_rpm
        return self.rpm or math.nan


def does_it(order: tuple[object, ...], rpm: float) -> float:
    match order:
        case ("set", float(speed)):
            return 1.05 * speed / RPM
        case ("shows", float(shown)) if math.isfinite(shown):
            return rpm * 200.0 * RPM / shown
        case ("rest",):
            return 0.0
    return rpm


def by_hand(person: Person) -> ByHand:
    def wait(seconds: float) -> None:
        person.clock.sleep(seconds)
        motion.check()

    motion = ByHand(person, DRIVE, wait, ShaftSeen(person.measured_rpm, 300.0), person.clock)
    motion.alive = lambda: True
    return motion


def test_a_person_is_asked_told_what_is_measured_and_believed_by_that() -> None:
    person = Person(SteppedClock(), does_it)
    motion: Motion = by_hand(person)
    motion.arm(soft=True)
    assert person.asked == []
    motion.start(soft=True)
    assert person.rpm == pytest.approx(200.0)
    words, orders = zip(*person.asked, strict=True)
    assert words[0].startswith("BY HAND: turn the crank up to 200 rpm and hold it there")
    assert words[1].endswith("measured: 210 rpm")
    assert [order[0] for order in orders] == ["set", "shows"]
    assert [notice.code for notice in motion.take_notices()] == ["manual.asked", "manual.set"]
    assert motion.speed_rad_s == DRIVE.speed


def test_it_has_to_stay_where_it_was_asked_for() -> None:
    clock = SteppedClock()
    person = Person(clock, does_it)
    motion = by_hand(person)
    began_s = clock.now_s
    motion.start(soft=True)
    # told of after two seconds, set right a second later
    assert clock.now_s - began_s == pytest.approx(3.0 + HELD_S, abs=0.05)


def test_a_path_is_asked_for_step_by_step() -> None:
    person = Person(SteppedClock(), lambda order, rpm: order[1] / RPM if order[0] == "set" else rpm)
    by_hand(person).start(soft=True, path=[SpeedDrive(100.0 * RPM)])
    assert [order for _, order in person.asked if order[0] == "set"] == [
        ("set", pytest.approx(100.0 * RPM)),
        ("set", pytest.approx(200.0 * RPM)),
    ]


@pytest.mark.parametrize(("rpm", "shown"), [(0.0, "nothing shows that the shaft turns"), (150.0, "150 rpm")])
def test_patience_ends(rpm: float, shown: str) -> None:
    person = Person(SteppedClock(), lambda order, before: rpm)
    with pytest.raises(InstrumentRefused, match=f"not set within 60 s: {shown}"):
        by_hand(person).start(soft=True)


def test_more_than_the_bench_allows_ends_the_run() -> None:
    person = Person(SteppedClock(), lambda order, before: 331.0)
    with pytest.raises(InterlockTripped, match="331 rpm, beyond what the bench allows"):
        by_hand(person).start(soft=True)


def test_rest_is_asked_for_once_and_seen() -> None:
    person = Person(SteppedClock(), does_it)
    motion = by_hand(person)
    motion.start(soft=True)
    person.asked.clear()
    for stop in (motion.off, motion.cut, motion.ramp_down):
        stop()
        motion.alive = lambda: False  # the card has ended
    assert [order for _, order in person.asked] == [("rest",)]
    motion.arm(soft=True)  # the next run asks again
    motion.alive = lambda: True
    motion.start(soft=True)
    motion.off()
    assert [order[0] for _, order in person.asked].count("rest") == 2


@pytest.mark.parametrize(
    ("alive", "match"), [(True, r"not seen at rest \(2.. rpm\)"), (False, "nothing is measured any more")]
)
def test_rest_that_is_not_seen_is_no_rest(alive: bool, match: str) -> None:
    person = Person(SteppedClock(), lambda order, rpm: 200.0)
    motion = by_hand(person)
    motion.start(soft=True)
    motion.alive = lambda: alive
    began_s = person.clock.now_s
    with pytest.raises(InstrumentRefused, match=rf"{match}.*STOP IT BY HAND"):
        motion.off()
    assert person.clock.now_s - began_s == pytest.approx(REST_S, abs=0.1)
    assert motion.longest_stop_s > REST_S


def test_what_is_asked_of_a_person_once_more_is_not_off_by_that() -> None:
    person, screen, told = Person(SteppedClock(), lambda order, rpm: 200.0), silent_screen(), list[str]()
    motion: Any = by_hand(person)
    motion.start(soft=True)
    motion.close = person.close
    spare = partial(ManualActuator, SETTINGS, off_first=True)
    with (
        pytest.raises(InstrumentRefused, match="not seen at rest") as ending,
        drive_off_after(motion, spare, screen, moved="the drive", not_off=told.append),
    ):
        pass
    assert ending.value.__notes__ == ["THE DRIVE MAY STILL BE ON: switch it off by hand"]
    assert len(told) == 1
    assert "MAY STILL BE ON" in screen.console.export_text()


@pytest.mark.parametrize("when", ["before it is asked", "while it is asked"])
def test_a_stop_by_another_thread_has_the_last_word(when: str) -> None:
    class Overtaken(Person):
        """Hears of a stop just before the order to turn it up."""

        def ask(self, words: str, *order: object) -> None:
            if order[0] == "set":
                stop()
            super().ask(words, *order)

    person = Overtaken(SteppedClock())
    motion = by_hand(person)

    def stop() -> None:
        assert motion._asked_to_rest.acquire(blocking=False)
        Person.ask(person, "STOP", "rest")

    motion.arm(soft=True)
    if when == "before it is asked":
        stop()
    with pytest.raises(InstrumentRefused, match="it is to rest by now"):
        motion.start(soft=True)
    asked = [order[0] for _, order in person.asked]
    assert asked == (["rest"] if when == "before it is asked" else ["rest", "set", "rest"])


def test_a_shaft_whose_marker_is_lost_at_speed_is_not_at_rest() -> None:
    person = Person(SteppedClock(), does_it)
    motion = by_hand(person)
    motion.start(soft=True)
    person.rpm, person.due = math.nan, (math.inf, 0.0)  # its cable is off, and nobody does anything
    person.does = lambda order, rpm: rpm
    with pytest.raises(InstrumentRefused, match=r"nothing shows that the shaft turns.*STOP IT BY HAND"):
        motion.off()


def test_a_shaft_whose_angle_is_lost_at_speed_is_not_at_rest() -> None:
    """Its counter stands as it does of a shaft that has stopped."""
    motion = by_hand(Person(SteppedClock(), does_it))
    motion.start(soft=True)
    motion.seen = ShaftSeen(lambda: 0.0, 300.0)
    unseen = r"nothing shows whether it rests.*still \(0 rpm\).*STOP IT BY HAND"
    with pytest.raises(InstrumentRefused, match=unseen):
        motion.off()


def test_a_shaft_whose_angle_was_seen_to_stop_is_at_rest() -> None:
    person = Person(SteppedClock(), does_it)
    motion = by_hand(person)
    motion.start(soft=True)
    motion.seen = ShaftSeen(lambda: float(np.nan_to_num(person.measured_rpm())), 300.0)
    motion.off()


@pytest.mark.parametrize("ramp_s", [0.5, 1.0, 3.0, 8.0])
def test_a_shaft_that_stops_is_at_rest_by_its_marker_however_fast_it_stops(ramp_s: float) -> None:
    """By the card's own reading of the marks, of a shaft at 200 rpm that a person stops evenly."""
    clock, rate, block = SteppedClock(), 5120.0, 384
    speed = ShaftSpeed([Channel("crank.marker", "V")], rate, clock)
    taken = 0

    def turned(at_s: float) -> float:
        stopping_s = min(max(at_s - 3.0, 0.0), ramp_s)
        return 200.0 / 60.0 * (min(at_s, 3.0) + stopping_s - stopping_s**2 / (2 * ramp_s))

    def measured_rpm() -> float:
        nonlocal taken
        while (taken + block) / rate <= clock.now_s - began_s:
            angles = np.array([turned((taken + k) / rate) for k in range(block)])
            speed.take(taken, np.where(angles % 1.0 < 0.05, 5.0, 0.0))
            taken += block
        return speed.rpm()

    person = Person(clock, does_it)
    began_s = clock.now_s
    motion = ByHand(person, DRIVE, clock.sleep, ShaftSeen(measured_rpm, 300.0), clock)
    motion.alive, motion._moved = (lambda: True), True
    clock.sleep(3.0)
    assert measured_rpm() == pytest.approx(200.0, rel=0.01)
    motion.off()
    stood_s = clock.now_s - began_s - 3.0 - ramp_s
    assert 0.0 < stood_s < 12.0


def test_where_nothing_was_asked_no_speed_is_rest() -> None:
    person = Person(SteppedClock())
    began_s = person.clock.now_s
    by_hand(person).off()
    assert person.clock.now_s - began_s < 1.5


def test_nobody_is_believed_unmeasured() -> None:
    clock = SteppedClock()
    with pytest.raises(InstrumentRefused, match="nothing measures what is set"):
        ByHand(Person(clock, does_it), SineDrive(3.0, 20.0), clock.sleep).start(soft=True)


RATE = 51_200.0


@pytest.mark.parametrize("frequency_hz", [19.6, 20.0, 20.01, 20.6])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_sine_that_is_set_is_seen_in_frequency_and_amplitude(frequency_hz: float, noise: float) -> None:
    watch = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, 60.0)
    seen, drive = SineSeen(watch), SineDrive(3.0, 20.0)
    assert not seen.is_set(drive)
    assert not seen.rests
    watch.take(np.zeros(len(watch._values)))
    assert seen.rests
    at_s = np.arange(2 * int(RATE)) / RATE
    force = 3.0 * np.sin(2 * np.pi * frequency_hz * at_s) + 0.4 * np.sin(6 * np.pi * frequency_hz * at_s)
    force += noise * np.random.default_rng(3).standard_normal(len(at_s))
    for block in np.array_split(force, 20):
        watch.take(block)
    assert watch.frequency_hz == pytest.approx(frequency_hz, rel=2e-4)
    # a sine off by 3 % of its frequency leaks by a tenth of a window of four cycles
    assert watch.amplitude == pytest.approx(3.0, rel=0.03)
    assert seen.is_set(drive) == (abs(frequency_hz - 20.0) < 0.016)
    assert not seen.rests
    assert seen.order(drive) == (20.0, 3.0)
    assert "set the drive to 20 Hz and turn it up to 3 N peak" in seen.words(drive)


@pytest.mark.parametrize("value", [math.nan, 0.0, 9.99])
def test_a_force_whose_sensor_is_blind_is_not_at_rest(value: float) -> None:
    """Its cable is off: nothing, or whatever its input shows then."""
    watch = ForceWatch(Channel("drive.force", "N"), 20.0, RATE, 60.0)
    seen, window = SineSeen(watch), round(watch.over_s * RATE)
    watch.take(np.full(3 * window, value), Flag.OPEN_SENSOR)
    assert not seen.rests
    assert seen.told() == "drive.force shows no number"
    watch.take(np.zeros(window - 1))
    assert not seen.rests
    watch.take(np.zeros(1))
    assert seen.rests

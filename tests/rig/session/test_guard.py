"""What ends a run acts from a thread that waits for nobody, in time, and without a ramp where it must."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import (
    DeviceLost,
    EmergencyStop,
    InstrumentRefused,
    InstrumentSilent,
    InterlockTripped,
    RecorderFailed,
)
from daq.log.records import STOPPING
from daq.log.writer import LogWriter
from daq.time_base.run_clock import RunClock
from drivers import lock as locks
from drivers.lock import Latch
from drivers.protocols.card import CardReading
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator
from rig.files.bench import embedded_bench
from rig.files.scenario import Limit, parse_scenario
from rig.session import driven_rig
from rig.session.devices import Devices
from rig.session.drive import Motion, Shaker
from rig.session.driven_rig import DrivenRig, Hung
from rig.session.encoder_record import HANGS_S
from rig.session.signals import Stopped, StopRequest
from tests.drivers.scripted import ScriptedInstrument
from tests.drivers.test_scpi_bad_answers import Echo
from tests.end_to_end.command import await_true
from tests.rig.session.fakes import RATE, Kept, RecordingGenerator, SteppedCard, silent_screen
from tests.rig.session.test_driven_rig import SCENARIO
from tests.rig.session.test_encoder_record import Lab
from tests.rig.session.test_stops import Idle

LIMIT_N, BLOCK_S = 50.0, 0.1
SOON_S = 0.05
"""From the reading that shows it to the off, with a busy machine in it; the block adds 0.1 s."""
LONG_S = 10.0
"""Whoever waits for a ramp for three times as long is taken for hung, which cuts it as well."""


class TimedGenerator(RecordingGenerator):
    """Says when it was switched off, and whether its settings are as they were told."""

    def __init__(self) -> None:
        super().__init__()
        self.off_s: float | None = None
        self.turned = False

    def off(self) -> None:
        if self.off_s is None:
            self.off_s = time.monotonic()
        super().off()

    def check(self) -> None:
        if self.turned:
            raise InstrumentRefused(self.name, self.address, "VOLT is 9.9, which it was not told")


class RampingMotor:
    """A `Motion` whose ramp takes until it is cut, or for ever."""

    what, speed_rad_s, longest_stop_s, longest_order_s = "a motor", None, 30.0, 3.0

    def __init__(self) -> None:
        self.told: list[str] = []
        self.stands = threading.Event()

    def start(self, soft: bool, path: object = ()) -> None:
        self.told.append("start")

    def ramp_down(self) -> None:
        self.off()

    def off(self) -> None:
        self.told.append("off")
        if not self.stands.wait(LONG_S):
            self.told.append("waited for")
            self.stands.wait()

    def cut(self) -> None:
        self.told.append("cut")
        self.stands.set()

    def check(self) -> None: ...

    def take_notices(self) -> tuple[()]:
        return ()

    def clocks(self, base: object) -> list[object]:
        return []


class Beats(Idle):
    """A supervisor that notes when it was given a sign of life."""

    at_s: ClassVar[list[float]] = []

    def beat(self, patience_s: float = 0.0) -> None:
        self.at_s.append(time.monotonic())


@pytest.fixture(autouse=True)
def beats(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    monkeypatch.setattr(driven_rig, "Supervisor", Beats)
    monkeypatch.setattr(Beats, "at_s", [])
    return Beats.at_s


class Bench:
    """A beam or a motor that moves, with a limit on its card; readings come as the test lets them."""

    def __init__(self, folder: Path, motion: Motion | None) -> None:
        self.scenario = parse_scenario(SCENARIO, "guarded")
        self.generator, self.stop = TimedGenerator(), StopRequest()
        self.level = 0.0
        channels = Channel("drive.force", "N"), Channel("contact.force_upper", "N")
        self.card = SteppedCard(channels, lambda n, k: np.full(len(n), self.level * k))
        moved: Callable[..., Motion] = lambda wait, _: (  # noqa: E731
            motion or Shaker(self.generator, self.scenario.drive, 3.6, wait)
        )
        devices = Devices(self.generator, RecordingGenerator, moved, self.card)
        self.rig = DrivenRig(embedded_bench(), devices, self.stop, silent_screen(), RunClock(SystemClock()))
        self._folder = folder

    @contextmanager
    def moving(self) -> Iterator[DrivenRig]:
        rig, running = self.rig, threading.Event()

        def let() -> None:
            while not running.wait(BLOCK_S / 2):
                self.card.let()

        feeding = threading.Thread(target=let)
        with ExitStack() as stack:
            rig.open_log(stack, self._folder, "guarded")
            rig.stream[:] = [Kept()]
            rig.record([Limit("contact.force_upper", "N", None, LIMIT_N)], None)
            feeding.start()
            stack.callback(feeding.join)
            stack.callback(running.set)
            with rig.moving():
                rig.start(soft=False)
                yield rig


def ended(bench: Bench, error: type[Exception], match: str, during: Callable[[DrivenRig], None]) -> None:
    """What moves has to end by that error."""

    def move() -> None:
        with bench.moving() as rig:
            during(rig)

    with pytest.raises(error, match=match):
        move()


def test_a_limit_switches_off_while_the_sequence_looks_at_nothing(tmp_path: Path) -> None:
    bench = Bench(tmp_path, None)

    def during(rig: DrivenRig) -> None:
        bench.level = 60.0
        await_true("tripped", lambda: rig.acquisition.trips)
        tripped_s = time.monotonic()
        await_true("off", lambda: bench.generator.off_s, 1.0)
        assert (bench.generator.off_s or 0.0) - tripped_s < SOON_S
        rig.watch.check()

    ended(bench, InterlockTripped, r"contact\.force_upper = 60 N", during)


def test_a_sequence_that_hangs_is_switched_off_and_gives_no_sign_of_life(
    tmp_path: Path, beats: list[float]
) -> None:
    bench = Bench(tmp_path, None)

    def during(rig: DrivenRig) -> None:
        rig.watch.check()
        hung_s = time.monotonic()
        await_true("off", lambda: bench.generator.off_s, 1.0)
        time.sleep(0.2)
        assert max(beats) - hung_s < 0.7
        rig.watch.check()

    ended(bench, Hung, r"looked at nothing for 0.6 s", during)


def test_a_run_that_slept_was_steady_until_it_fell_asleep(tmp_path: Path) -> None:
    """What is recorded after that was not driven any more: the supervisor has switched it off meanwhile."""
    bench = Bench(tmp_path, None)
    asleep_ns: list[int] = []

    def during(rig: DrivenRig) -> None:
        rig.watch.wait(0.2)
        with rig._deciding:  # as a guard sleeps
            asleep_ns.append(rig.clock.unix_ns())
            await_true("off", lambda: rig.acquisition.trips, 2.0)
        rig.watch.wait(0.5)

    ended(bench, InterlockTripped, "nobody guards the run", during)
    (kept,) = (each for each in bench.rig.stream if isinstance(each, Kept))
    (stopping,) = (each for each in kept.events if each.code == STOPPING)
    assert abs(stopping.time_ns - asleep_ns[0]) < 0.1e9


def await_off_in_a_second(bench: Bench, rig: DrivenRig, goes_on: threading.Event) -> None:
    """Go through the run while something hangs, which goes on once this one ends."""
    since_s = time.monotonic()
    try:
        while bench.generator.off_s is None:
            rig.watch.wait(0.02)
    finally:
        goes_on.set()
        await_true("off", lambda: bench.generator.off_s, 1.0)
        assert (bench.generator.off_s or 0.0) - since_s < 1.0


def test_an_acquisition_that_hangs_is_switched_off(tmp_path: Path) -> None:
    bench, goes_on = Bench(tmp_path, None), threading.Event()

    def during(rig: DrivenRig) -> None:

        def hang(record: object) -> None:
            goes_on.wait()

        rig.stream.append(hang)
        rig.start_record(round(RATE))
        await_off_in_a_second(bench, rig, goes_on)

    ended(bench, Hung, "the acquisition took too long for a reading", during)


def test_an_acquisition_that_falls_behind_is_switched_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though no reading takes long: its limits would be held against what was seconds ago."""
    bench = Bench(tmp_path, None)
    read = bench.card.read

    def slow(count: int) -> CardReading:
        time.sleep(0.3)
        return read(count)

    def during(rig: DrivenRig) -> None:
        monkeypatch.setattr(bench.card, "read", slow)
        rig.watch.wait(5.0)

    ended(bench, Hung, r"what is measured is seen [12]\.\d s late", during)


def hanging(read: Callable[[int], CardReading], goes_on: threading.Event) -> Callable[[int], CardReading]:
    """A read that hangs until it is let go on."""

    def hang(count: int) -> CardReading:
        goes_on.wait()
        return read(count)

    return hang


def test_a_card_that_hangs_in_its_read_is_noticed_in_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, goes_on = Bench(tmp_path, None), threading.Event()
    hang = hanging(bench.card.read, goes_on)

    def during(rig: DrivenRig) -> None:
        monkeypatch.setattr(bench.card, "read", hang)
        await_off_in_a_second(bench, rig, goes_on)

    ended(bench, Hung, "the acquisition took too long for a reading", during)


def test_an_encoder_that_hangs_in_its_read_is_noticed_in_a_second_and_the_run_lives(
    tmp_path: Path, beats: list[float]
) -> None:
    bench = Bench(tmp_path, None)

    def during(rig: DrivenRig) -> None:
        lab = Lab()
        with lab.record:
            lab.advance(1)
            rig.encoder = lab.record
            rig.watch.wait(0.2)
            assert bench.generator.off_s is None
            lab.clock.now_s += HANGS_S + 0.1  # no positions come
            await_true("off", lambda: bench.generator.off_s, 1.0)
            off_s = time.monotonic()
            await_true("signs of life", lambda: beats[-1] > off_s + 0.1)
            rig.encoder = None
            lab.end()
        rig.watch.check()

    ended(bench, Hung, r"the encoder gave no positions for 0\.9 s", during)


def test_a_guard_that_hangs_is_seen_by_the_acquisition(tmp_path: Path) -> None:
    bench = Bench(tmp_path, None)
    since_s = 0.0

    def during(rig: DrivenRig) -> None:
        nonlocal since_s
        rig._deciding.acquire()  # it hangs while it decides, which stopping does not wait for
        since_s = time.monotonic()
        rig.watch.wait(2.0)

    try:
        ended(bench, InterlockTripped, "nobody guards the run", during)
    finally:
        bench.rig._deciding.release()
    assert (bench.generator.off_s or np.inf) - since_s < 1.0


def test_a_guard_that_fails_switches_off_and_says_what_it_was(tmp_path: Path) -> None:
    bench = Bench(tmp_path, None)

    def broken() -> EmergencyStop | None:
        raise ZeroDivisionError("a driver's fault")

    def during(rig: DrivenRig) -> None:
        rig.devices = replace(rig.devices, emergency_stop=broken)
        await_true("off", lambda: bench.generator.off_s, 1.0)
        rig.devices = replace(rig.devices, emergency_stop=lambda: None)
        rig.watch.wait(2.0)

    ended(bench, Hung, "the guard failed: ZeroDivisionError: a driver's fault", during)


def test_whoever_takes_long_to_hear_of_a_stop_delays_no_off(tmp_path: Path) -> None:
    bench, goes_on = Bench(tmp_path, None), threading.Event()

    def waits(record: object) -> None:
        if getattr(record, "code", "") == STOPPING:
            await_true("off", lambda: bench.generator.off_s, 5.0)
            goes_on.set()

    def during(rig: DrivenRig) -> None:
        rig.stream.append(waits)
        raise ZeroDivisionError("a fault")

    began_s = time.monotonic()
    ended(bench, ZeroDivisionError, "a fault", during)
    assert goes_on.is_set()
    assert (bench.generator.off_s or np.inf) - began_s < 1.0


def test_an_off_that_fails_is_answered_before_whoever_takes_long_to_hear_of_the_stop(tmp_path: Path) -> None:
    bench, answered = Bench(tmp_path, None), threading.Event()
    bench.generator._fails_at = "off"

    def spare() -> RecordingGenerator:
        answered.set()
        return RecordingGenerator()

    bench.rig.devices = replace(bench.rig.devices, spare=spare)
    in_time = list[bool]()

    def waits(record: object) -> None:
        if getattr(record, "code", "") == STOPPING:
            in_time.append(answered.wait(1.0))
            SystemClock().sleep(0.5)  # whoever it is told to is not closed meanwhile
            in_time.append(bench.rig.acquisition._stop.is_set())

    def during(rig: DrivenRig) -> None:
        rig.stream.append(waits)
        raise ZeroDivisionError("a fault")

    ended(bench, ZeroDivisionError, "a fault", during)
    assert in_time == [True, False]


def test_a_drive_that_does_not_go_off_stands_in_the_log(tmp_path: Path) -> None:
    bench = Bench(tmp_path, None)
    bench.generator._fails_at = "off"
    bench.rig.devices = replace(bench.rig.devices, spare=lambda: RecordingGenerator(fails_at="open"))

    def during(rig: DrivenRig) -> None:
        raise ZeroDivisionError("a fault")

    with pytest.raises(ZeroDivisionError) as ending:
        ended(bench, InterlockTripped, "never", during)
    assert ending.value.__notes__ == ["THE DRIVE MAY STILL BE ON: switch it off by hand"]
    (kept,) = (each for each in bench.rig.stream if isinstance(each, Kept))
    (told,) = (each for each in kept.events if each.code == "drive.not_off")
    assert told.level == "error"
    assert "MAY STILL BE ON" in told.text


def test_an_emergency_stop_on_the_way_down_does_not_hide_how_the_drive_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path, None)
    bench.generator._fails_at = "off"

    def spare() -> RecordingGenerator:
        monkeypatch.setattr(Beats, "emergency_stop", pressed())  # since it stays on
        return RecordingGenerator(fails_at="open")

    bench.rig.devices = replace(bench.rig.devices, spare=spare)

    def during(rig: DrivenRig) -> None:
        raise InterlockTripped("interlock: too much")

    with pytest.raises(EmergencyStop) as ending, bench.moving() as rig:
        during(rig)
    assert ending.value.__notes__ == ["THE DRIVE MAY STILL BE ON: switch it off by hand"]


def test_what_has_come_to_rest_is_asked_for_nothing_more(tmp_path: Path) -> None:
    """Whoever switches the generator off meanwhile hears no alarm."""
    bench = Bench(tmp_path, None)
    with bench.moving() as rig:
        rig.ramp_down()
    assert bench.generator.told[-1] == ("close",)


def test_signs_of_life_come_while_all_is_well(tmp_path: Path, beats: list[float]) -> None:
    with Bench(tmp_path, None).moving() as rig:
        beats.clear()
        rig.watch.wait(0.5)
    assert max(np.diff(beats)) < 0.2


def test_a_generator_that_somebody_turns_ends_it(tmp_path: Path) -> None:
    bench = Bench(tmp_path, None)

    def during(rig: DrivenRig) -> None:
        bench.generator.turned = True
        rig.watch.wait(0.3)

    ended(bench, InstrumentRefused, "which it was not told", during)


@pytest.mark.parametrize("after_s", [0.1, 0.6], ids=["double tap", "on the ramp"])
def test_a_second_interrupt_does_not_wait_for_the_ramp(tmp_path: Path, after_s: float) -> None:
    motor = RampingMotor()
    bench = Bench(tmp_path, motor)  # type: ignore[arg-type]

    def interrupt_twice() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(after_s)
        os.kill(os.getpid(), signal.SIGINT)

    person = threading.Thread(target=interrupt_twice)

    def during(rig: DrivenRig) -> None:
        person.start()
        rig.watch.wait(1.0)

    began_s = time.monotonic()
    with bench.stop:
        ended(bench, Stopped, "stopped by a person", during)
    assert time.monotonic() - began_s < LONG_S
    person.join()
    assert motor.told[-1] == "cut"


def test_a_limit_on_the_ramp_does_not_wait_for_it(tmp_path: Path) -> None:
    motor = RampingMotor()
    bench = Bench(tmp_path, motor)  # type: ignore[arg-type]

    def let_it_pass() -> None:
        await_true("on its ramp", lambda: "off" in motor.told)
        bench.level = 60.0

    bounce = threading.Thread(target=let_it_pass)
    with bench.moving() as rig:
        bounce.start()
        rig.ramp_down()
    bounce.join()
    assert motor.told[:3] == ["start", "off", "cut"]


@pytest.mark.parametrize("by", ["limit", "person"])
def test_an_order_that_a_stop_overtakes_does_not_hide_why_it_ended(tmp_path: Path, by: str) -> None:
    motor = RampingMotor()
    motor.stands.set()
    bench = Bench(tmp_path, motor)  # type: ignore[arg-type]

    def during(rig: DrivenRig) -> None:
        if by == "limit":
            bench.level = 60.0
        else:
            bench.stop.asked = 2
        await_true("stopped", lambda: {"off", "cut"} & set(motor.told))
        raise InstrumentRefused("inverter", "fake", "not done: a stop overtook it", code="overtaken")

    error, match = (InterlockTripped, "60 N") if by == "limit" else (Stopped, "by a person")
    ended(bench, error, match, during)


def test_a_limit_that_stops_a_motor_stops_it_on_its_ramp(tmp_path: Path) -> None:
    motor = RampingMotor()
    motor.stands.set()
    bench = Bench(tmp_path, motor)  # type: ignore[arg-type]

    def during(rig: DrivenRig) -> None:
        bench.level = 60.0
        rig.watch.wait(1.0)

    ended(bench, InterlockTripped, r"contact\.force_upper", during)
    assert "cut" not in motor.told
    assert "off" in motor.told


PRESSED_S = 3.0
"""Before it is heard of, so that its own time can be told from that."""


def pressed() -> EmergencyStop:
    return EmergencyStop("port0/line0 of a card", "its line is open", time.monotonic() - PRESSED_S)


@pytest.mark.parametrize("on_ramp", [False, True])
def test_an_emergency_stop_cuts_the_ramp_down_and_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, on_ramp: bool
) -> None:
    motor = RampingMotor()
    bench = Bench(tmp_path, motor)  # type: ignore[arg-type]

    def press() -> None:
        if on_ramp:
            await_true("on its ramp", lambda: "off" in motor.told)
        monkeypatch.setattr(Beats, "emergency_stop", pressed())

    def during(rig: DrivenRig) -> None:
        monkeypatch.setattr(rig.acquisition, "alarm", threading.Event())
        person.start()
        if not on_ramp:
            person.join()  # pressed between the guard's looks
        rig.ramp_down()

    person = threading.Thread(target=press)
    ended(bench, EmergencyStop, "its line is open", during)
    person.join()
    assert motor.told[1:3] == ["off", "cut"] if on_ramp else "off" not in motor.told
    assert "cut" in motor.told


def test_an_emergency_stop_with_a_log_that_takes_nothing_more_leaves_no_doubt_of_the_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motor = RampingMotor()
    motor.stands.set()
    bench, said = Bench(tmp_path, motor), list[str]()  # type: ignore[arg-type]
    monkeypatch.setattr(bench.rig.screen, "warn", said.append)

    def refuse(record: object) -> None:
        raise RecorderFailed("no space left")

    def during(rig: DrivenRig) -> None:
        rig.stream[:] = [refuse]
        monkeypatch.setattr(Beats, "emergency_stop", pressed())
        rig.heed_emergency_stop()

    ended(bench, EmergencyStop, "its line is open", during)
    (stopping,) = said  # nothing went wrong with the drive
    assert stopping.startswith("stopping before its time (emergency stop")


@pytest.mark.parametrize("by", ["supervisor", "actuator"])
def test_an_emergency_stop_switches_off_while_the_sequence_looks_at_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by: str
) -> None:
    bench = Bench(tmp_path, None)
    kept, seen = Kept(), list[EmergencyStop]()
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))
    devices = replace(bench.rig.devices, latch=Latch("generator", "the line"))
    bench.rig.devices = replace(devices, emergency_stop=lambda: seen[0] if seen else None)

    def during(rig: DrivenRig) -> None:
        rig.stream[:] = [kept]
        if by == "actuator":
            seen.append(pressed())
        else:
            monkeypatch.setattr(Beats, "emergency_stop", pressed())
        since_s = time.monotonic()
        await_true("off", lambda: bench.generator.off_s, 1.0)
        assert (bench.generator.off_s or 0.0) - since_s < SOON_S
        # the power that it takes away is no reason of its own
        raise InstrumentRefused("signal generator", "fake", "no answer")

    ended(bench, EmergencyStop, "emergency stop at port0/line0 of a card: its line is open", during)
    (told,) = [event for event in kept.events if event.code == "emergency_stop"]
    (stopping,) = [event for event in kept.events if event.code == STOPPING]
    assert "(emergency stop at port0/line0 of a card: its line is open" in stopping.text
    assert told.time_ns == stopping.time_ns
    off_ns = RunClock(SystemClock()).unix_ns()
    assert off_ns - stopping.time_ns > 0.9 * PRESSED_S * 1e9
    assert (
        Latch("generator", "the line").told()
        == "emergency stop at port0/line0 of a card ended a run: its line is open"
    )


@pytest.mark.parametrize("how", ["refused", "hangs"])
def test_a_latch_that_cannot_be_kept_or_hangs_is_told_and_delays_no_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    bench, kept, goes_on = Bench(tmp_path, None), Kept(), threading.Event()

    class Broken(Latch):
        def set(self, text: str) -> None:
            if how == "hangs":
                goes_on.wait()
            raise InstrumentRefused("generator", "here", "no such folder")

    bench.rig.devices = replace(bench.rig.devices, latch=Broken("generator", "here"))

    def during(rig: DrivenRig) -> None:
        rig.stream[:] = [kept]
        monkeypatch.setattr(Beats, "emergency_stop", pressed())
        since_s = time.monotonic()
        await_true("off", lambda: bench.generator.off_s, 1.0)
        assert (bench.generator.off_s or 0.0) - since_s < SOON_S
        rig.watch.check()

    ended(bench, EmergencyStop, "its line is open", during)
    goes_on.set()
    (told,) = [event for event in kept.events if event.code == "emergency_stop.latch"]
    assert "he next run may not ask whether anybody is in danger: see to that yourself" in told.text
    assert told.text in " ".join(bench.rig.screen.console.export_text().split())


def test_a_latch_waits_for_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))
    motor, latch = RampingMotor(), Latch("inverter", "here")
    bench = Bench(tmp_path, motor)  # type: ignore[arg-type]
    bench.rig.devices = replace(bench.rig.devices, latch=latch)

    def during(rig: DrivenRig) -> None:
        with rig._deciding:  # the guard hangs before its stop
            monkeypatch.setattr(Beats, "emergency_stop", pressed())
            await_true("latched", latch.told, 1.0)
        rig.watch.check()

    ended(bench, EmergencyStop, "its line is open", during)


def test_a_machine_that_starts_no_latch_by_then_delays_no_off_and_latches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))
    bench, latch, start = Bench(tmp_path, None), Latch("generator", "here"), threading.Thread.start
    bench.rig.devices = replace(bench.rig.devices, latch=latch)

    def refuse(thread: threading.Thread) -> None:
        if thread.name == "latch":
            raise RuntimeError("can't start new thread")
        start(thread)

    def during(rig: DrivenRig) -> None:
        monkeypatch.setattr(threading.Thread, "start", refuse)
        monkeypatch.setattr(Beats, "emergency_stop", pressed())
        since_s = time.monotonic()
        await_true("off", lambda: bench.generator.off_s, 1.0)
        assert (bench.generator.off_s or 0.0) - since_s < SOON_S
        rig.watch.check()

    ended(bench, EmergencyStop, "its line is open", during)
    assert latch.told()


def test_a_machine_that_starts_no_thread_more_delays_no_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path, None)

    def refuse(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    def during(rig: DrivenRig) -> None:
        with monkeypatch.context() as full:
            full.setattr(threading.Thread, "start", refuse)
            bench.level = 60.0
            await_true("off", lambda: bench.generator.off_s, 0.5)
        rig.watch.check()

    ended(bench, InterlockTripped, r"contact\.force_upper = 60 N", during)


SERIAL_OFF_S = 0.4


@pytest.mark.parametrize("off_s", [0.0, SERIAL_OFF_S])
def test_signs_of_life_go_on_while_an_off_may_take_its_time(
    tmp_path: Path, beats: list[float], off_s: float
) -> None:
    """On a serial line, where the supervisor's connection would garble it; over a network it may come."""
    bench, goes_on = Bench(tmp_path, None), threading.Event()
    bench.rig.motion = replace(bench.rig.motion, longest_stop_s=off_s)  # type: ignore[type-var]

    def slow() -> None:
        goes_on.wait()

    bench.generator.off = slow  # type: ignore[method-assign]

    def during(rig: DrivenRig) -> None:
        bench.level = 60.0
        await_true("tripped", lambda: rig.acquisition.trips)
        tripped_s = time.monotonic()
        time.sleep(2 * SERIAL_OFF_S)
        goes_on.set()
        assert off_s - 0.05 < max(beats) - tripped_s < off_s + 0.1
        rig.watch.check()

    ended(bench, InterlockTripped, "60 N", during)


def test_an_emergency_stop_waits_for_no_ramp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    motor = RampingMotor()
    bench = Bench(tmp_path, motor)  # type: ignore[arg-type]

    def during(rig: DrivenRig) -> None:
        monkeypatch.setattr(Beats, "emergency_stop", pressed())
        rig.watch.wait(1.0)

    ended(bench, EmergencyStop, "its line is open", during)
    assert motor.told[1] == "cut"
    assert "off" not in motor.told


def test_one_that_is_seen_before_the_start_starts_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path, None)
    monkeypatch.setattr(Beats, "emergency_stop", pressed())
    ended(bench, EmergencyStop, "its line is open", lambda rig: None)
    assert ("start",) not in bench.generator.told
    assert bench.generator.off_s is not None


def test_a_disk_that_hangs_at_the_end_delays_no_off(tmp_path: Path) -> None:
    """What is written last is written by whoever closes the log: the drive is off by then."""
    bench, goes_on, close = Bench(tmp_path, None), threading.Event(), LogWriter.close
    was_off: list[bool] = []

    def hang(writer: LogWriter) -> None:
        was_off.append(bench.generator.off_s is not None)
        goes_on.wait()
        close(writer)

    def run() -> None:
        ended(bench, InterlockTripped, "60 N", during)

    def during(rig: DrivenRig) -> None:
        bench.level = 60.0
        rig.watch.wait(1.0)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(LogWriter, "close", hang)
        running = threading.Thread(target=run)
        running.start()
        await_true("the log is closed", lambda: was_off)
        goes_on.set()
        running.join()
    assert was_off == [True]


class SpareGenerator(RecordingGenerator):
    """A second connection, which says when it was made."""

    at_s: ClassVar[list[float]] = []

    def open(self) -> None:
        self.at_s.append(time.monotonic())


@pytest.mark.parametrize("how", ["silent", "gone"])
def test_a_generator_that_is_lost_is_noticed_in_a_second_and_commanded_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """Its network is gone, or its process; what is commanded then may reach it or not."""
    monkeypatch.setattr(SpareGenerator, "at_s", [])
    echo, lost, off_s = Echo({}), threading.Event(), list[float]()

    def answer(line: str) -> bytes | None:
        answered = echo(line)
        if not lost.is_set():
            return answered
        if line == "OUTP OFF":
            off_s.append(time.monotonic())
        return b"" if how == "silent" else None

    bench = Bench(tmp_path, None)
    with ScriptedInstrument(answer) as instrument:
        generator = ScpiGenerator(GeneratorSettings(3.6, 12.0, resource=instrument.resource))
        generator.open()
        bench.rig.motion = replace(bench.rig.motion, generator=generator)  # type: ignore[type-var]
        bench.rig.devices = replace(bench.rig.devices, spare=SpareGenerator)
        bench.rig.motion.arm(soft=False)
        times = list[float]()

        def during(rig: DrivenRig) -> None:
            rig.watch.wait(0.2)
            times.append(time.monotonic())
            lost.set()
            try:
                rig.watch.wait(5.0)
            finally:
                times.append(time.monotonic())

        error, match = (InstrumentSilent, "no answer to") if how == "silent" else (DeviceLost, "connection")
        ended(bench, error, match, during)
        generator.close()
    lost_s, noticed_s = times
    assert noticed_s - lost_s < 1.0
    commanded_s = min(off_s) if how == "silent" else SpareGenerator.at_s[0]
    assert commanded_s - noticed_s < 0.2

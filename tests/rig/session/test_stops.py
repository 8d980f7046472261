"""A run, dwells and centring stop their rig alike: a mend of what stops one of them reaches all three."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import EmergencyStop, InstrumentSilent, InterlockTripped, RattleError
from daq.log.reader import LogReader
from rig.derived import derivation
from rig.files.bench import embedded_bench
from rig.files.scenario import Scenario, edited, parse_scenario
from rig.live.picture import Layout
from rig.live.view import LiveView
from rig.session import driven_rig, twin_feed
from rig.session.centring import plan_of
from rig.session.centring_run import find_centre
from rig.session.devices import Devices, Standing
from rig.session.drive import Shaker
from rig.session.dwells import DwellRequest, record_dwells
from rig.session.motor import Motor, MotorActuator
from rig.session.progress import Screen
from rig.session.run import RunRequest, run_scenario
from rig.session.signals import Stopped
from rig.session.supervisor import SupervisorTripped
from rig.stream import Record
from tests.accounting import made_up
from tests.rig.session.fakes import RATE, RecordingGenerator, SteppedCard, silent_screen
from tests.rig.session.shafts import FakeDrive, SteppedClock
from tests.rig.session.test_progress import Known

FORCE_PER_VOLT = 3.6
LIMITED = "contact.force_upper", "crank_frame.acceleration_y"
BEAM = """\
rig = "impact_beam"
[model]
shaker_stiffness = "3 kN/m"
[drive]
frequency = "20 Hz"
[acquisition]
sample_rate = "51.2 kHz"
settle = "1 s"
duration = "30 s"
[limits."contact.force_upper"]
abort = "50 N"
"""
CRANK = """\
rig = "planar_slider_crank"
[drive]
speed = "200 rpm"
[acquisition]
sample_rate = "51.2 kHz"
duration = "30 s"
[limits."crank_frame.acceleration_y"]
abort = "50 m/s2"
"""


class Idle:
    """A worker process that is never started, and a supervisor that finds fault where it is told to."""

    error, lost = "", False
    emergency_stop: EmergencyStop | None = None

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def __enter__(self) -> Idle:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def launch(self) -> None:
        pass

    def close(self) -> None:
        pass

    def wait_ready(self, check: Callable[[], None]) -> None:
        check()

    def give(self, item: object) -> None:
        pass

    def finish(self, within_s: float, check: Callable[[], None]) -> None:
        pass

    def take_over(self) -> None:
        pass

    def go_on(self) -> str:
        return ""

    def beat(self, patience_s: float = 0.0) -> None:
        pass

    def check(self) -> None:
        if self.lost:
            raise SupervisorTripped("the supervisor is gone, tripped or dead; no run goes on without it")


class RunningCard(SteppedCard):
    """A card whose samples come by themselves while it runs: the drive, `level` on channels with a limit."""

    def __init__(self, channels: tuple[Channel, ...], generator: RecordingGenerator) -> None:
        self.level, self.gain = 0.0, 1.0
        limited = [channel.name in LIMITED for channel in channels]
        drives = [channel.name == "drive.force" for channel in channels]

        def shown(samples: NDArray[np.int64], row: int) -> NDArray[np.float64]:
            force = self.gain * FORCE_PER_VOLT * generator.sine(samples / RATE) if drives[row] else 0.0
            return force + np.full(len(samples), self.level * limited[row])

        super().__init__(channels, shown)
        self._done = threading.Event()
        self._letting = threading.Thread(target=self._let)

    def start(self) -> None:
        super().start()
        if self._letting.ident is None:
            self._letting.start()

    def open(self) -> None:
        pass

    def close(self) -> None:
        self._done.set()
        if self._letting.is_alive():
            self._letting.join()

    def _let(self) -> None:
        while not self._done.wait(0.01):
            self.let()


class Rig:
    """A rig of either kind; `opening` is what happens while its instruments are connected."""

    def __init__(self, text: str, folder: Path) -> None:
        self.scenario: Scenario = parse_scenario(text, "stopped")
        self.bench = embedded_bench(self.scenario.rig)
        self.folder = made_up(folder)
        self.opening: Callable[[], None] = lambda: None
        units = {channel.name: channel.unit for channel in self.bench.daq_card.channels}
        self.generator, self.drive = RecordingGenerator(), FakeDrive(SteppedClock(), stuck=True)
        channels = tuple(Channel(name, unit) for name, unit in units.items())
        self.card = RunningCard(channels, self.generator)

    def connect(self, *_: object) -> tuple[Devices, dict[str, str]]:
        self.card.open = self.opening  # type: ignore[method-assign]
        if self.scenario.rig == "impact_beam":
            generator = self.generator
            motion = lambda wait, _: Shaker(generator, self.scenario.drive, FORCE_PER_VOLT, wait)  # noqa: E731
            return Devices(generator, RecordingGenerator, motion, self.card), {}  # type: ignore[arg-type]
        inverter = lambda wait, rpm: Motor(self.drive, 200.0 * math.tau / 60.0, wait, rpm)  # noqa: E731
        return Devices(MotorActuator(self.drive), None, inverter, self.card), {}  # type: ignore[arg-type]

    @property
    def stopper(self) -> RecordingGenerator | FakeDrive:
        return self.generator if self.scenario.rig == "impact_beam" else self.drive

    def told(self) -> list[str]:
        """What the generator or the inverter was told to do, in order."""
        return [str(each[0]) for each in self.stopper.told if each[0] != "check"]

    def assert_stopped(self) -> None:
        """It moved, and the last that its drive was told is to go off and to hang up."""
        told = self.told()
        off = "off" if self.stopper is self.generator else "stop"
        assert "start" in told
        assert told[-1] == "close"
        assert off in told[told.index("start") :]
        assert set(told[told.index(off, told.index("start")) :]) <= {off, "close"}

    def events(self) -> list[str]:
        (log,) = self.folder.glob("*.mcap")
        with LogReader(log) as reader:
            return [event.code for event in reader.events()]


def run(rig: Rig, screen: Screen) -> None:
    run_scenario(RunRequest(rig.scenario, rig.bench, rig.connect, rig.folder), screen, SystemClock())


def dwell(rig: Rig, screen: Screen) -> None:
    record_dwells(
        DwellRequest([rig.scenario], rig.bench, 1.0, rig.connect, rig.folder), screen, SystemClock()
    )


def centre(rig: Rig, screen: Screen) -> None:
    plan = plan_of(rig.scenario, rig.bench)
    find_centre(rig.scenario, rig.bench, plan, rig.connect, screen, SystemClock(), rig.folder)


Moves = Callable[[Rig, Screen], None]


@pytest.fixture(params=[(run, BEAM), (run, CRANK), (dwell, CRANK), (centre, BEAM)])
def moved(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Rig, Moves]]:
    monkeypatch.setattr(driven_rig, "Supervisor", Idle)
    for module in (twin_feed, derivation):
        monkeypatch.setattr(module, "WorkerProcess", Idle)
    moves, text = request.param
    with ExitStack() as stack:
        rig = Rig(text, tmp_path)
        stack.callback(rig.card.close)
        yield rig, moves


def ended(rig: Rig, moves: Moves, error: type[RattleError], match: str) -> str:
    """What stands on the screen after the error that has to end it; the error says how the drive is left."""
    screen = silent_screen()
    with pytest.raises(error, match=match) as ending:
        moves(rig, screen)
    moved = "the drive" if rig.scenario.rig == "impact_beam" else "the motor"
    notes = getattr(ending.value, "__notes__", [])
    assert notes == [f"{moved} is off"] or (notes, "start" in rig.told()) == ([], False)
    return screen.console.export_text()


def test_ctrl_c_while_connecting_moves_nothing(moved: tuple[Rig, Moves]) -> None:
    rig, moves = moved
    rig.opening = lambda: signal.raise_signal(signal.SIGINT)
    ended(rig, moves, Stopped, "stopped by a person")
    assert not {"arm_sine", "set_speed", "start"} & set(rig.told())
    assert rig.told()[-2:] in (["off", "close"], ["stop", "close"])


def test_ctrl_c_while_it_moves_stops_it(moved: tuple[Rig, Moves], monkeypatch: pytest.MonkeyPatch) -> None:
    rig, moves = moved
    stopper = rig.stopper
    start = stopper.start

    def interrupted() -> None:
        start()
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(stopper, "start", interrupted)
    ended(rig, moves, Stopped, "stopped by a person")
    rig.assert_stopped()
    assert {"run.interrupted", "drive.stopping"} <= set(rig.events())


def test_nothing_is_armed_while_the_twin_warms_up(
    moved: tuple[Rig, Moves], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody looks at the emergency stop by then."""
    rig, moves = moved
    armed: list[bool] = []

    def warm_up(_: Idle, check: Callable[[], None]) -> None:
        armed.append(bool({"arm_sine", "set_speed"} & set(rig.told())))

    monkeypatch.setattr(Idle, "wait_ready", warm_up)
    monkeypatch.setattr(rig.stopper, "start", lambda: signal.raise_signal(signal.SIGINT))
    ended(rig, moves, Stopped, "stopped by a person")
    assert armed == [False, False] * (moves is run)


def test_it_is_supervised_before_it_moves_whether_a_reading_has_come_or_not(
    moved: tuple[Rig, Moves], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, moves = moved
    stopper, start = rig.stopper, rig.stopper.start
    beats: list[bool] = []

    def beat(_: Idle, patience_s: float = 0.0) -> None:
        if threading.current_thread() is threading.main_thread():  # not by a reading
            beats.append("start" in rig.told())

    def started() -> None:
        assert beats == [False]
        start()
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Idle, "beat", beat)
    monkeypatch.setattr(stopper, "start", started)
    ended(rig, moves, Stopped, "stopped by a person")


def test_a_limit_that_trips_stops_it(moved: tuple[Rig, Moves]) -> None:
    rig, moves = moved
    rig.card.level = 60.0
    said = ended(rig, moves, InterlockTripped, r"interlock: .* = 60 .*, limit 50 .*")
    assert "log so far" in said
    assert rig.told()[-1] == "close"
    assert {"limit.abort", "drive.stopping"} <= set(rig.events())


def test_a_supervisor_that_is_lost_stops_it(
    moved: tuple[Rig, Moves], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, moves = moved
    stopper = rig.stopper
    start = stopper.start

    def lost() -> None:
        start()
        monkeypatch.setattr(Idle, "lost", True)

    monkeypatch.setattr(stopper, "start", lost)
    ended(rig, moves, SupervisorTripped, "the supervisor is gone")
    rig.assert_stopped()


class InTurn:
    """Runs one after the other on what stands, at these frequencies; `before` is what happens before one."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.opened = rig, 0
        self.before: dict[float, Callable[[], None]] = {}
        self.view: LiveView | None = None
        self.said = ""

    def connect(self, *_: object) -> tuple[Devices, dict[str, str]]:
        self.opened += 1
        return self.rig.connect()

    def __call__(self, *hertz: float, duration_s: float = 0.3) -> None:
        screen = silent_screen()
        with Standing(self.connect) as standing:
            for each in hertz:
                self.before.get(each, lambda: None)()
                short = {"acquisition.duration": f"{duration_s} s", "acquisition.settle": "0 s"}
                scenario = edited(self.rig.scenario, {"drive.frequency": f"{each} Hz", **short}, "in turn")
                rig = self.rig
                request = RunRequest(
                    scenario, rig.bench, self.connect, rig.folder, self.view, standing=standing
                )
                run_scenario(request, screen, SystemClock())
                assert self.rig.told()[-1] == "off"
        self.said = screen.console.export_text()

    @property
    def armed_hz(self) -> list[object]:
        return [each[1] for each in self.rig.generator.told if each[0] == "arm_sine"]


@pytest.fixture
def in_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[InTurn]:
    monkeypatch.setattr(driven_rig, "Supervisor", Idle)
    for module in (twin_feed, derivation):
        monkeypatch.setattr(module, "WorkerProcess", Idle)
    monkeypatch.setattr(Idle, "emergency_stop", None)
    rig = Rig(BEAM, tmp_path)
    yield InTurn(rig)
    rig.card.close()


def test_runs_on_what_stands_are_each_armed_and_switched_off_and_it_hangs_up_at_the_end(
    in_turn: InTurn,
) -> None:
    in_turn(20.0, 21.0)
    assert in_turn.opened == 1
    assert in_turn.armed_hz == [20.0, 21.0]
    assert in_turn.rig.told().count("open") == 1
    assert in_turn.rig.told().count("start") == 2
    assert in_turn.rig.told()[-2:] == ["off", "close"]
    logs = sorted(in_turn.rig.folder.glob("*.mcap"))
    assert len(logs) == 2
    for log in logs:
        with LogReader(log) as reader:
            assert reader.complete
            assert reader.series("measured", "drive.force").first_sample == 0


@pytest.mark.parametrize("gain", [1.6, 0.02])
def test_a_start_at_once_is_held_to_its_order_as_a_soft_one_is(in_turn: InTurn, gain: float) -> None:
    in_turn.rig.card.gain = gain
    in_turn.rig.scenario = edited(in_turn.rig.scenario, {"drive.amplitude": "5 N"}, "at once")
    with pytest.raises(InterlockTripped, match=f"drive.force = {gain * 5.0:g} N where 5 is ordered"):
        in_turn(20.0, duration_s=30.0)
    assert in_turn.rig.told()[-2:] == ["off", "close"]


def test_what_trips_in_one_run_lets_none_follow_and_leaves_nothing_connected(in_turn: InTurn) -> None:
    def too_much() -> None:
        in_turn.rig.card.level = 60.0

    in_turn.before[21.0] = too_much
    with pytest.raises(InterlockTripped, match="60 N"):
        in_turn(20.0, 21.0, 22.0)
    assert in_turn.armed_hz == [20.0, 21.0]
    assert in_turn.rig.told()[-2:] == ["off", "close"]


def test_an_emergency_stop_between_two_runs_lets_the_next_not_move(
    in_turn: InTurn, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed() -> None:
        seen = EmergencyStop("port0/line0 of a card", "its line is open", 0.0)
        monkeypatch.setattr(Idle, "emergency_stop", seen)

    in_turn.before[21.0] = pressed
    with pytest.raises(EmergencyStop):
        in_turn(20.0, 21.0)
    assert in_turn.armed_hz == [20.0]
    assert in_turn.rig.told()[-2:] == ["off", "close"]


def test_a_drive_that_does_not_go_off_between_two_runs_ends_them(
    in_turn: InTurn, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator, off = in_turn.rig.generator, in_turn.rig.generator.off

    def fails() -> None:
        off()
        if generator.told.count(("start",)):
            raise InstrumentSilent(generator.name, generator.address, "no answer to off")

    monkeypatch.setattr(generator, "off", fails)
    with pytest.raises(InstrumentSilent, match="no answer to off"):
        in_turn(20.0, 21.0)
    assert in_turn.armed_hz == [20.0]
    assert in_turn.rig.told()[-1] == "close"


def test_a_record_that_ended_early_is_told_and_timed_by_what_was_recorded(in_turn: InTurn) -> None:
    """Until Enter, say: nobody knows how long, and what the disk has room for says nothing."""
    rig, stages = in_turn.rig, list[tuple[str, float, float]]()
    screen, paces = silent_screen(), Known(None)
    screen.paces = paces
    screen.stages.append(lambda text, done, total, *_: stages.append((text, done, total)))
    long = {"acquisition.duration": "20 h", "acquisition.settle": "0 s"}
    request = RunRequest(edited(rig.scenario, long, "long"), rig.bench, rig.connect, rig.folder)
    run_scenario(replace(request, enough=lambda: len(stages) > 5, open_ended=True), screen, SystemClock())
    told = [each for each in stages if each[0] == "recording"]
    assert {total for _, _, total in told} == {0.0}
    assert 0.0 < told[-1][1] < 30.0
    (finish,) = (work for work, _ in paces.kept if work.kind.startswith("finish"))
    assert 0.0 < finish.units < 30.0


class Struck:
    """Impacts of its own: one for each reading."""

    wanted, so_far = 6, 0

    def enough(self) -> bool:
        self.so_far += 1
        return self.so_far >= self.wanted

    def __call__(self, record: Record) -> None:
        pass


def test_a_record_that_impacts_end_is_shown_by_their_count_and_at_most_as_long_as_it_may_last(
    in_turn: InTurn,
) -> None:
    rig, stages = in_turn.rig, list[tuple[str, float, float, str, float | None]]()
    screen = silent_screen()
    screen.stages.append(lambda *stage: stages.append(stage))
    long = {"acquisition.duration": "60 s", "acquisition.settle": "0 s"}
    request = RunRequest(edited(rig.scenario, long, "long"), rig.bench, rig.connect, rig.folder)
    run_scenario(replace(request, counted=Struck()), screen, SystemClock())
    told = [each for each in stages if each[0] == "recording"]
    assert {(total, unit) for _, _, total, unit, _ in told} == {(6.0, "impacts")}
    assert [done for _, done, *_ in told] == sorted(done for _, done, *_ in told)
    assert told[-1][1] == 6.0
    assert all(left_s is not None and left_s <= 60.0 for *_, left_s in told)


class FakeView:
    """What would show runs; notes which layouts, and how often its addresses were asked for."""

    def __init__(self) -> None:
        self.url = self.page_url = ""
        self.dropped, self.opened = 0, 0
        self.shown: list[str] = []

    def show(self, layout: Layout) -> None:
        self.shown.append(layout.title)

    def open(self) -> None:
        self.opened += 1
        self.url = "http://127.0.0.1:1/"

    def offer(self, record: object) -> None:
        self.dropped += 1


def test_one_view_shows_all_runs_on_what_stands(in_turn: InTurn) -> None:
    view = FakeView()
    in_turn.view = cast(LiveView, view)
    in_turn(20.0, 21.0)
    assert len(view.shown) == 2
    assert view.opened == in_turn.said.count("time line ") == 1
    for log in in_turn.rig.folder.glob("*.mcap"):
        with LogReader(log) as reader:
            (dropped,) = (event.text for event in reader.events() if event.code == "view.dropped")
            assert 0 < int(dropped.split()[0]) < view.dropped  # its own alone

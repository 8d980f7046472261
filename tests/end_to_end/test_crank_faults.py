"""However the run of a crank ends early: the motor comes to rest, the log is closed, the words are honest."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from daq.block import NS_PER_S
from daq.log.reader import LogReader, Origin
from daq.log.recover import recover_log
from drivers.canopen_cia406.emulator.process import EncoderSetup
from drivers.mitsubishi_fr.settings import SHORTEST_WATCHDOG_S
from drivers.protocols.speed_drive import MotorOutput
from drivers.rehearsal import rehearsed
from tests.end_to_end.command import Command, Ended, await_gone, await_true, command, rattle
from tests.end_to_end.spied_crank import RAMP_S, RPM, RPM_PER_LEVEL, WATCHDOG_S, SpiedCrank, spied_crank

OVERCURRENT = 0x10
"""E.OC1 in the fault history."""
SAFE_S = 1.0 + 0.2
"""From a device that is lost to the word that stops the motor."""
AT_ONCE_S = 0.3
"""From a second Ctrl-C to the off, of which half is for a busy machine."""
DEAD_S = 1.0
"""From a run that is stopped dead to the ramp down by the shortest watchdog."""
MEASURED = {"crank.angle", "crank.marker", "encoder.angle"}


@pytest.fixture(scope="module")
def crank(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SpiedCrank]:
    """A bench for the tests that leave its inverter and card alive, in their order."""
    with spied_crank(tmp_path_factory.mktemp("crank")) as crank:
        yield crank


@pytest.fixture
def mortal_crank(tmp_path: Path) -> Iterator[SpiedCrank]:
    with spied_crank(tmp_path) as crank:
        yield crank


def stopped(run: Command, crank: SpiedCrank) -> Ended:
    """The end of a run whose motor has to come to rest, with nobody left."""
    children = run.children()
    ended = run.end()
    crank.spy.await_stopping()
    await_gone(children)
    return ended


def last_from_full_speed(outputs: list[MotorOutput]) -> MotorOutput:
    return next(output for output in reversed(outputs) if output.level > 0.5 * RPM / RPM_PER_LEVEL)


def came_down_on_its_ramp(outputs: list[MotorOutput]) -> bool:
    """Whether what was put out last goes from full speed to zero as the ramp has it."""
    down = last_from_full_speed(outputs)
    return down.on and down.target == 0.0 and down.slope_per_s == pytest.approx(60.0 / RAMP_S)


def events(log: Path) -> list[str]:
    with LogReader(log) as reader:
        assert reader.complete
        assert set(reader.channels("measured")) == MEASURED
        return [event.code for event in reader.events()]


def end_s(reader: LogReader, origin: Origin) -> float:
    """When the angle of `origin` ends, Unix epoch."""
    last = [block for _, block in reader.blocks(origin, ["crank.angle"])][-1]
    return last.time_ns / NS_PER_S + len(last) / last.sample_rate


def test_ctrl_c_brings_the_motor_down_on_its_ramp(crank: SpiedCrank, tmp_path: Path) -> None:
    with command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        time.sleep(1.5)  # until something is predicted
        run.signal(signal.SIGINT)
        ended = stopped(run, crank)
    assert ended.code == 130
    assert came_down_on_its_ramp(crank.spy.heard)
    codes = events(ended.log)
    assert "run.interrupted" in codes
    assert codes.index("motor.trimmed") < codes.index("record.start")
    assert "inverter.off" in codes  # seen to stand, run withdrawn
    # what the motor does on its ramp no twin of a steady speed follows
    with LogReader(ended.log) as reader:
        stopping = next(event for event in reader.events() if event.code == "drive.stopping")
        assert end_s(reader, "predicted") <= stopping.time_ns / NS_PER_S + 0.15
        assert end_s(reader, "measured") >= stopping.time_ns / NS_PER_S + 0.5


@pytest.mark.long
def test_ctrl_c_again_ends_the_ramp_at_once(tmp_path: Path) -> None:
    with (
        spied_crank(tmp_path, coasts=True) as crank,
        command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run,
    ):
        run.await_line("recording")
        run.signal(signal.SIGINT)
        crank.spy.await_stopping()
        time.sleep(0.3 * RAMP_S)
        assert came_down_on_its_ramp(crank.spy.heard)
        run.signal(signal.SIGINT)
        again_s = time.monotonic()
        ended = stopped(run, crank)
    assert ended.code == 130
    coasting = crank.spy.heard[-1]
    assert not coasting.on
    assert coasting.started_s - again_s < AT_ONCE_S
    assert events(ended.log).count("run.interrupted") == 1


@pytest.mark.long
def test_a_lost_encoder_brings_the_motor_down(crank: SpiedCrank, tmp_path: Path) -> None:
    crank.spy.heard.clear()
    with command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        killed_s = time.monotonic()
        os.kill(crank.encoder.pid, signal.SIGKILL)
        ended = stopped(run, crank)
    assert ended.code == 1
    assert "encoder at node 7 on socketcand" in ended.err
    assert "last good position" in ended.err
    assert came_down_on_its_ramp(crank.spy.heard)
    assert 0.0 < last_from_full_speed(crank.spy.heard).started_s - killed_s < SAFE_S
    assert "inverter.off" in events(ended.log)


@pytest.mark.long
def test_a_shaft_that_slips_is_an_interlock(tmp_path: Path) -> None:
    # Trimming changes the output every two seconds; once it has been steady for three, the belt slips.
    with (
        spied_crank(tmp_path, slips_after_s=3.0) as crank,
        command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run,
    ):
        run.await_line("settling")
        ended = stopped(run, crank)
        assert ended.code == 3
        assert "interlock: shaft at 240 rpm, wanted 300 rpm for 0.5 s; the motor is off" in ended.err
        codes = events(ended.log)
        assert [code for code in codes if code.startswith("speed.")] == ["speed.off", "speed.abort"]


@pytest.mark.long
def test_an_emergency_of_the_encoder_brings_the_motor_down(tmp_path: Path) -> None:
    # Positions come from before the motor starts; it is up to speed after two seconds and trims for some.
    setup = EncoderSetup(faults=(rehearsed("encoder.emergency@4:value=0x5000"),))
    with (
        spied_crank(tmp_path, encoder=setup) as crank,
        command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run,
    ):
        ended = stopped(run, crank)
        assert ended.code == 3
        assert "interlock: emergency 5000h of the encoder (Device Hardware); the motor is off" in ended.err
        assert came_down_on_its_ramp(crank.spy.heard)
        codes = events(ended.log)
        assert "encoder.emergency" in codes
        assert "inverter.off" in codes


@pytest.mark.long
def test_an_encoder_that_stands_while_the_shaft_turns_is_an_interlock(tmp_path: Path) -> None:
    setup = EncoderSetup(faults=(rehearsed("encoder.stuck@4"),))
    with (
        spied_crank(tmp_path, encoder=setup) as crank,
        command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run,
    ):
        ended = stopped(run, crank)
        assert ended.code == 3
        assert "interlock: encoder shows 0 rpm, wanted 300 rpm for 0." in ended.err
        assert came_down_on_its_ramp(crank.spy.heard)
        codes = events(ended.log)
        assert [code for code in codes if code.startswith("speed.")] == ["speed.off", "speed.abort"]


@pytest.mark.long
def test_a_lost_card_brings_the_motor_down_by_the_inverters_own_word(
    mortal_crank: SpiedCrank, tmp_path: Path
) -> None:
    with command("run", mortal_crank.scenario, "--bench", mortal_crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        killed_s = time.monotonic()
        os.kill(mortal_crank.card.pid, signal.SIGKILL)
        ended = stopped(run, mortal_crank)
    assert ended.code == 1
    assert mortal_crank.card.address in ended.err
    assert came_down_on_its_ramp(mortal_crank.spy.heard)
    assert 0.0 < last_from_full_speed(mortal_crank.spy.heard).started_s - killed_s < SAFE_S
    assert "inverter.off" in events(ended.log)


def refused(crank: SpiedCrank, out: Path) -> str:
    """What a run says that is refused before anything moves."""
    heard = len(crank.spy.heard)
    ended = rattle("run", crank.scenario, "--bench", crank.file, "--out", out)
    assert ended.code == 1
    assert len(crank.spy.heard) == heard
    return ended.err


@pytest.mark.long
def test_a_trip_ends_the_run_with_code_and_time_in_the_log_and_nobody_resets_it(
    mortal_crank: SpiedCrank, tmp_path: Path
) -> None:
    with command("run", mortal_crank.scenario, "--bench", mortal_crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        tripped_ns = time.time_ns()
        mortal_crank.rehearsal.send(rehearsed(f"inverter.trips:code={OVERCURRENT}"))
        ended = stopped(run, mortal_crank)
    assert ended.code == 1
    assert f"inverter at {mortal_crank.actuator.address}: it has tripped: E.OC1" in ended.err
    with LogReader(ended.log) as reader:
        assert reader.complete
        told = reader.events()
    (trip,) = [event for event in told if event.code == "inverter.E.OC1"]
    # A poll every 0.1 s and its answers; processes of a busy machine.
    assert 0.0 <= (trip.time_ns - tripped_ns) * 1e-9 < 1.0
    assert (trip.level, trip.source) == ("error", "inverter")
    assert "inverter.run" not in [event.code for event in told if event.time_ns > trip.time_ns]
    off = next(at for at, output in enumerate(mortal_crank.spy.heard) if not output.on)
    assert all(output.target == 0.0 for output in mortal_crank.spy.heard[off:])
    assert "it has tripped: E.OC1. Check the motor and its load, then reset it at its panel" in refused(
        mortal_crank, tmp_path
    )


@pytest.mark.long
def test_a_killed_run_leaves_a_drive_that_trips_by_itself_and_that_no_run_resets(
    mortal_crank: SpiedCrank, tmp_path: Path
) -> None:
    with command("run", mortal_crank.scenario, "--bench", mortal_crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        children = run.children()
        run.signal(signal.SIGKILL)
        killed_s = time.monotonic()
        mortal_crank.spy.await_stopping()
        assert "the run is gone; the inverter's own watchdog (Pr.122) stops the motor" in run.end().err
    await_gone(children)
    await_true("at rest and tripped", lambda: not mortal_crank.spy.heard[-1].on)
    down = next(output for output in reversed(mortal_crank.spy.heard) if output.on)
    assert came_down_on_its_ramp(mortal_crank.spy.heard)
    # The last poll was up to a period and its answers before.
    assert WATCHDOG_S - 0.5 < down.started_s - killed_s < WATCHDOG_S + 0.5
    assert "it has tripped: E.PUE" in refused(mortal_crank, tmp_path / "again")
    (log,) = tmp_path.glob("*.mcap")
    recovered = tmp_path / "recovered.mcap"
    recover_log(log, recovered)
    with LogReader(recovered) as reader:
        assert "motor.trimmed" in [event.code for event in reader.events()]


@pytest.mark.long
@pytest.mark.parametrize("how", ["frozen", "killed"])
def test_a_motor_whose_run_is_stopped_dead_stops_within_a_second_by_the_shortest_watchdog(
    tmp_path: Path, freeze: Callable[[int], None], how: str
) -> None:
    with (
        spied_crank(tmp_path, watchdog_s=SHORTEST_WATCHDOG_S) as crank,
        command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run,
    ):
        run.await_line("recording")
        children = run.children()
        freeze(run.pid) if how == "frozen" else os.kill(run.pid, signal.SIGKILL)
        stopped_s = time.monotonic()
        crank.spy.await_stopping()
        assert came_down_on_its_ramp(crank.spy.heard)
        assert 0.0 < last_from_full_speed(crank.spy.heard).started_s - stopped_s < DEAD_S
        assert "inverter's own watchdog (Pr.122) stops" in run.end().err
        await_gone(children)


@pytest.mark.long
def test_a_lost_inverter_is_left_to_its_watchdog(mortal_crank: SpiedCrank, tmp_path: Path) -> None:
    with command("run", mortal_crank.scenario, "--bench", mortal_crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        mortal_crank.rehearsal.send(rehearsed("inverter.drop"))
        ended = stopped(run, mortal_crank)
    assert ended.code == 1
    assert "inverter at" in ended.err
    assert "THE MOTOR MAY STILL TURN" in ended.out
    assert came_down_on_its_ramp(mortal_crank.spy.heard)

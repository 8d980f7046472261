"""However the run of a crank ends early: the motor comes to rest, the log is closed, the words are honest."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.log import LogReader
from drivers.canopen_cia406.emulator.setup import EncoderFault, EncoderSetup
from drivers.mitsubishi_fr.emulator import LineFaults
from drivers.protocols import InverterOutput
from tests.end_to_end.command import Command, Ended, await_gone, command
from tests.end_to_end.spied_crank import RAMP_S, RPM, RPM_PER_HZ, SpiedCrank, spied_crank

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
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


def came_down_on_its_ramp(outputs: list[InverterOutput]) -> bool:
    """Whether what was put out last goes from full speed to zero as the ramp has it."""
    down = next(output for output in reversed(outputs) if output.frequency_hz > 0.5 * RPM / RPM_PER_HZ)
    return down.on and down.target_hz == 0.0 and down.slope_hz_per_s == pytest.approx(60.0 / RAMP_S)


def events(log: Path) -> list[str]:
    with LogReader(log) as reader:
        assert reader.complete
        assert set(reader.channels("measured")) == MEASURED
        return [event.code for event in reader.events()]


def test_ctrl_c_brings_the_motor_down_on_its_ramp(crank: SpiedCrank, tmp_path: Path) -> None:
    with command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        run.signal(signal.SIGINT)
        ended = stopped(run, crank)
    assert ended.code == 130
    assert came_down_on_its_ramp(crank.spy.heard)
    codes = events(ended.log)
    assert "run.interrupted" in codes
    assert codes.index("motor.trimmed") < codes.index("record.start")
    assert "inverter.off" in codes  # seen to stand, run withdrawn


def test_a_lost_encoder_brings_the_motor_down(crank: SpiedCrank, tmp_path: Path) -> None:
    crank.spy.heard.clear()
    with command("run", crank.scenario, "--bench", crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        os.kill(crank.encoder.pid, signal.SIGKILL)
        ended = stopped(run, crank)
    assert ended.code == 1
    assert "encoder at node 7 on socketcand" in ended.err
    assert "last good position" in ended.err
    assert came_down_on_its_ramp(crank.spy.heard)
    assert "inverter.off" in events(ended.log)


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


def test_an_emergency_of_the_encoder_brings_the_motor_down(tmp_path: Path) -> None:
    # Positions come from before the motor starts; it is up to speed after two seconds and trims for some.
    setup = EncoderSetup(faults=(EncoderFault("emergency", 4000, 0x5000),))
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


def test_an_encoder_that_stands_while_the_shaft_turns_is_an_interlock(tmp_path: Path) -> None:
    setup = EncoderSetup(faults=(EncoderFault("stuck", 4000),))
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


def test_a_lost_card_brings_the_motor_down_by_the_inverters_own_word(
    mortal_crank: SpiedCrank, tmp_path: Path
) -> None:
    with command("run", mortal_crank.scenario, "--bench", mortal_crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        os.kill(mortal_crank.card.pid, signal.SIGKILL)
        ended = stopped(run, mortal_crank)
    assert ended.code == 1
    assert mortal_crank.card.address in ended.err
    assert came_down_on_its_ramp(mortal_crank.spy.heard)
    assert "inverter.off" in events(ended.log)


def test_a_lost_inverter_is_left_to_its_watchdog(mortal_crank: SpiedCrank, tmp_path: Path) -> None:
    with command("run", mortal_crank.scenario, "--bench", mortal_crank.file, "--out", tmp_path) as run:
        run.await_line("recording")
        mortal_crank.spoil_line(LineFaults(1.0, ("drop",)))
        ended = stopped(run, mortal_crank)
    assert ended.code == 1
    assert "inverter at" in ended.err
    assert "THE MOTOR MAY STILL TURN" in ended.out
    assert came_down_on_its_ramp(mortal_crank.spy.heard)

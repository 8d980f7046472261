"""A run with a motor hangs: it is made to let go, and the inverter's own watchdog stops the motor."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drivers.emulator_process import DriveLink
from drivers.mitsubishi_fr.emulator.drive import InverterSetup
from drivers.mitsubishi_fr.emulator.process import InverterWiring, matching_setup, start_inverter
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.protocols.speed_drive import MotorOutput

ROOT = Path(__file__).parents[3]
PATIENCE_S, WATCHDOG_S, RAMP_S = 0.8, 0.5, 0.6
SETTINGS = InverterSettings(5.0, 350.0)
ON_SILENCE, WATCHDOG = 502, 122
RAMP_TO_200_RPM_S = RAMP_S * 40.0 / 60.0
LATE_S = 1.0  # processes of a busy machine


def setup() -> InverterSetup:
    parameters = {
        **matching_setup(SETTINGS, RAMP_S).parameters,
        WATCHDOG: round(WATCHDOG_S * 10),
        ON_SILENCE: 1,
    }
    return InverterSetup(parameters)


def last_output(link: DriveLink, until_s: float) -> MotorOutput:
    """The last of what is put out, once it is off, or at a time."""
    output = None
    while (left_s := until_s - time.monotonic()) > 0.0:
        if link.receiver.poll(left_s):
            output = link.receiver.recv()
            if not output.on:
                break
    assert output is not None
    return output


@pytest.mark.parametrize("how", ["sequence", "frozen"])
def test_the_motor_stands_within_patience_watchdog_and_ramp(how: str) -> None:
    within_s = PATIENCE_S + WATCHDOG_S + RAMP_TO_200_RPM_S + LATE_S
    command = [sys.executable, "-m", "tests.rig.session.hanging_run"]
    with DriveLink.new() as link, start_inverter(InverterWiring(link.sender), setup()) as inverter:
        with subprocess.Popen(  # noqa: S603
            [*command, inverter.address, str(PATIENCE_S), how],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as run:
            assert run.stdout is not None
            assert run.stdout.readline() == "driving\n"
            if how == "frozen":
                os.kill(run.pid, signal.SIGSTOP)
            hung_s = time.monotonic()
            output = last_output(link, hung_s + within_s)
            _, said = run.communicate(timeout=10)
        assert run.returncode == -signal.SIGKILL
    assert not output.on  # tripped, and at rest: it came down on its ramp
    assert output.level == 0.0 == output.target
    assert output.started_s - hung_s < within_s
    assert "the run gave no sign of life for" in said
    assert "its inverter's own watchdog (Pr.122) stops it" in said

"""A supply, and a person, whose run falls silent: the supervisor switches off, or asks."""

from __future__ import annotations

import multiprocessing
from functools import partial

import pytest

from drivers.manual.actuator import STOP, ManualActuator
from drivers.manual.settings import ManualMotorSettings
from drivers.protocols.emergency_stop import SILENCE_S
from drivers.scpi.emulator.process import start_dc_supply
from drivers.scpi.supply import ScpiSupply
from drivers.scpi.supply_settings import SupplySettings
from rig.session.supervisor import Supervisor
from tests.end_to_end.command import await_true


def test_a_supply_is_switched_off_by_a_connection_of_its_own() -> None:
    receiver, sender = multiprocessing.get_context("spawn").Pipe(duplex=False)
    with start_dc_supply(sender) as emulator, receiver:
        sender.close()
        settings = SupplySettings(5.0, 300.0, 3.0, resource=emulator.address)
        supervisor = Supervisor(partial(ScpiSupply, settings, off_first=True), emulated=True)
        supervisor.launch()
        driver = ScpiSupply(settings)
        driver.open()
        driver.arm(200.0)
        with supervisor:
            supervisor.beat()
            driver.start()
            assert receiver.poll(1.0)
            assert receiver.recv().on
            assert receiver.poll(SILENCE_S + 1.0)
            assert not receiver.recv().on  # sooner than its own watchdog, of 2 s
        driver.close()


def test_a_person_is_asked_once(capfd: pytest.CaptureFixture[str]) -> None:
    settings, said = ManualMotorSettings(maximum_speed_rpm=300.0), ""
    supervisor = Supervisor(partial(ManualActuator, settings, off_first=True), by_hand=True)
    supervisor.launch()
    with supervisor:
        supervisor.beat()

        def asked() -> bool:
            nonlocal said
            said += capfd.readouterr().err
            return STOP in said

        await_true("asked", asked, SILENCE_S + 2.0)
        supervisor._child.process.join(5.0)
    said += capfd.readouterr().err
    assert said.count(STOP) == 1

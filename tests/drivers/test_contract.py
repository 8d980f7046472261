"""What holds for every driver, over every wire it speaks."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentError, InstrumentSilent
from drivers.canopen_cia406.emulator.process import EncoderSetup, start_encoder
from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.emulator_process import EmulatedInstrument
from drivers.mitsubishi_fr.emulator.drive import InverterSetup
from drivers.mitsubishi_fr.emulator.process import start_inverter
from drivers.mitsubishi_fr.inverter import FrInverter
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.protocols.card import AcquisitionCard
from drivers.protocols.encoder import PositionEncoder
from drivers.protocols.generator import DriveGenerator
from drivers.protocols.speed_drive import SpeedDrive
from drivers.scpi.emulator.process import start_dc_supply, start_function_generator
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator
from drivers.scpi.instrument import ScpiSource
from drivers.scpi.supply import ScpiSupply
from drivers.scpi.supply_settings import SupplySettings
from tests.drivers.conftest import WIRING, card_settings
from tests.drivers.encoders import CALM_MS, slow_shaft, socketcand
from tests.drivers.plants import SinePlant

Driver = DriveGenerator | AcquisitionCard | SpeedDrive | PositionEncoder
NOTICED_S = 1.0  # reliability: a lost device is noticed within a second


def _generator(address: str) -> DriveGenerator:
    return ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=address, timeout_s=0.5))


def _card(address: str) -> AcquisitionCard:
    return NiDaqCard(card_settings(address))


def _inverter(address: str, parity: str) -> SpeedDrive:
    return FrInverter(InverterSettings(30.0, 300.0, port=address, parity=parity))


def _encoder(address: str) -> PositionEncoder:
    return CanopenEncoder(socketcand(address, period_s=0.01, timeout_s=0.5))


@dataclass(frozen=True)
class Case:
    start: Callable[[], EmulatedInstrument]
    address: Callable[[EmulatedInstrument], str]
    driver: Callable[[str], Driver]
    arm: Callable[[Driver], object]
    use: Callable[[Driver], object]
    nobody: Callable[[int], str]
    silence: tuple[type[InstrumentError], str] = (InstrumentSilent, "no answer")


def _use_generator(driver: Driver) -> None:
    assert isinstance(driver, ScpiGenerator)
    driver.set_amplitude(1.0)


def _arm_generator(driver: Driver) -> None:
    assert isinstance(driver, ScpiGenerator)
    driver.arm_sine(20.0, 0.5, 0.0, triggered=False)
    driver.start()


def _use_supply(driver: Driver) -> None:
    assert isinstance(driver, ScpiSupply)
    driver.set_speed(100.0)


def _arm_supply(driver: Driver) -> None:
    assert isinstance(driver, ScpiSupply)
    driver.arm(200.0)
    driver.start()


def _use_card(driver: Driver) -> None:
    assert isinstance(driver, NiDaqCard)
    driver.read(51200 // 10)


def _start_card(driver: Driver) -> None:
    assert isinstance(driver, NiDaqCard)
    driver.start()


def _use_inverter(driver: Driver) -> None:
    assert isinstance(driver, FrInverter)
    driver.read()


def _run_inverter(driver: Driver) -> None:
    assert isinstance(driver, FrInverter)
    driver.set_speed(30.0)
    driver.start()


def _use_encoder(driver: Driver) -> None:
    assert isinstance(driver, CanopenEncoder)
    began = time.time()
    while driver.read(5).timestamp_s[-1] < began:  # what was sent before, come or not, is read first
        pass


CASES = {
    "generator on TCP": Case(
        start_function_generator,
        lambda emulator: emulator.addresses[0],
        _generator,
        _arm_generator,
        _use_generator,
        lambda port: f"TCPIP::127.0.0.1::{port}::SOCKET",
    ),
    "generator on a pty": Case(
        start_function_generator,
        lambda emulator: emulator.addresses[1],
        _generator,
        _arm_generator,
        _use_generator,
        lambda port: f"ASRL/dev/pts/{port}::INSTR",
    ),
    "supply": Case(
        start_dc_supply,
        lambda emulator: emulator.address,
        lambda address: ScpiSupply(SupplySettings(5.0, 300.0, 3.0, resource=address, timeout_s=0.5)),
        _arm_supply,
        _use_supply,
        lambda port: f"TCPIP::127.0.0.1::{port}::SOCKET",
    ),
    "card": Case(
        lambda: start_daq_card(SinePlant, WIRING),
        lambda emulator: emulator.address,
        _card,
        _start_card,
        _use_card,
        lambda port: f"127.0.0.1:{port}",
    ),
    "inverter on TCP": Case(
        start_inverter,
        lambda emulator: emulator.addresses[0],
        lambda address: _inverter(address, "E"),
        _run_inverter,
        _use_inverter,
        lambda port: f"socket://127.0.0.1:{port}",
    ),
    "inverter on a pty": Case(
        lambda: start_inverter(setup=InverterSetup({120: 0})),  # no pty keeps a parity
        lambda emulator: emulator.addresses[1],
        lambda address: _inverter(address, "N"),
        _run_inverter,
        _use_inverter,
        lambda port: f"/dev/pts/{port}",
    ),
    "encoder": Case(
        lambda: start_encoder(slow_shaft, EncoderSetup(heartbeat_ms=CALM_MS)),
        lambda emulator: emulator.address,
        _encoder,
        lambda driver: driver.start(),
        _use_encoder,
        lambda port: f"127.0.0.1:{port}",
        (DeviceLost, "no heartbeat for"),
    ),
}


@pytest.fixture(params=list(CASES.values()), ids=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    chosen: Case = request.param
    return chosen


@contextmanager
def running(case: Case) -> Iterator[tuple[EmulatedInstrument, Driver]]:
    with case.start() as emulator:
        driver = case.driver(case.address(emulator))
        driver.open()
        try:
            yield emulator, driver
        finally:
            driver.close()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


def test_nobody_at_the_address(case: Case) -> None:
    driver = case.driver(case.nobody(free_port()))
    with pytest.raises(InstrumentAbsent, match="nobody answers") as caught:
        driver.open()
    assert caught.value.address == driver.address
    assert caught.value.check
    driver.close()


def test_works_again_after_closing_and_opening(case: Case) -> None:
    with running(case) as (_, driver):
        for _ in range(2):
            case.arm(driver)
            case.use(driver)
            if isinstance(driver, ScpiSource):
                driver.off()  # closing leaves its output as it is, and one that drives is refused
            driver.close()
            driver.close()
            driver.open()


def test_not_open(case: Case) -> None:
    with pytest.raises(DeviceLost, match=r"not open|connection is closed"):
        case.use(case.driver(case.nobody(1)))


def test_dies_while_in_use(case: Case) -> None:
    with running(case) as (emulator, driver):
        case.arm(driver)
        case.use(driver)
        os.kill(emulator.pid, signal.SIGKILL)
        emulator.child.process.join()
        died = time.monotonic()
        with pytest.raises(DeviceLost, match=r"connection is lost|device server is gone"):
            case.use(driver)
        assert time.monotonic() - died < NOTICED_S


def test_hangs_while_in_use(case: Case, freeze: Callable[[int], None]) -> None:
    with running(case) as (emulator, driver):
        case.arm(driver)
        case.use(driver)
        freeze(emulator.pid)
        began = time.monotonic()
        error, match = case.silence
        with pytest.raises(error, match=match) as caught:
            case.use(driver)
        # Block 0.1 s, margins 0.4 s and 0.2 s; the generator here 0.5 s, the encoder 0.9 s.
        assert time.monotonic() - began < 1.2
        assert caught.value.check
        os.kill(emulator.pid, signal.SIGCONT)


def test_hangs_before_it_is_opened(case: Case, freeze: Callable[[int], None]) -> None:
    with case.start() as emulator:
        freeze(emulator.pid)
        driver = case.driver(case.address(emulator))
        with pytest.raises(InstrumentSilent, match=r"no answer|does not speak gRPC"):
            driver.open()
        driver.close()
        os.kill(emulator.pid, signal.SIGCONT)

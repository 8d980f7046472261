"""Emulators in processes of their own, and the drivers that talk to them."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator

import psutil
import pytest

from drivers.emulator_process import EmulatedInstrument
from drivers.ni_daq.channels import CardChannel, CardSettings
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.wiring import CardWiring, Wire
from drivers.scpi.emulator.process import start_function_generator
from tests.drivers.plants import SinePlant

# A 20 mV/N force chain and a 10 mV per m/s2 accelerometer: both stay within 5 V for what is used here.
WIRING = CardWiring(
    {
        "cDAQ1Mod1/ai0": Wire("force", 0.02),
        "cDAQ1Mod1/ai1": Wire("acceleration", 0.01),
        "cDAQ1Mod1/ai2": Wire("constant", 0.5),
    }
)
FORCE = CardChannel("drive.force", "cDAQ1Mod1/ai0", "voltage", 0.02, 100.0, unit="N")
ACCELERATION = CardChannel(
    "base.acceleration", "cDAQ1Mod1/ai1", "acceleration_iepe", 0.01, 400.0, unit="m/s2"
)
CONSTANT = CardChannel("constant", "cDAQ1Mod1/ai2", "voltage", 0.5, 8.0, unit="N")
OPEN = CardChannel("nothing", "cDAQ1Mod1/ai3", "force_iepe", 0.01, 100.0, unit="N")


def card_settings(
    address: str | None, *channels: CardChannel, rate: float = 51200.0, buffer_s: float = 4.0
) -> CardSettings:
    return CardSettings(
        grpc=address,
        sample_rate_hz=rate,
        buffer_s=buffer_s,
        channels=channels or (FORCE, ACCELERATION, CONSTANT),
    )


@pytest.fixture(scope="module")
def generator_emulator() -> Iterator[EmulatedInstrument]:
    with start_function_generator() as emulator:
        yield emulator


@pytest.fixture(scope="module")
def card_emulator() -> Iterator[EmulatedInstrument]:
    with start_daq_card(SinePlant, WIRING) as emulator:
        yield emulator


@pytest.fixture
def freeze() -> Iterator[Callable[[int], None]]:
    """Stops a process and lets it go on at the end of the test."""
    frozen: list[int] = []

    def stop(pid: int) -> None:
        os.kill(pid, signal.SIGSTOP)
        frozen.append(pid)
        while psutil.Process(pid).status() != psutil.STATUS_STOPPED:  # the signal may still be on its way
            time.sleep(0.001)

    yield stop
    for pid in frozen:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)

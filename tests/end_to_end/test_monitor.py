"""Sensors watched from the command line: no actuator is ever reached, and taps set the bench right."""

from __future__ import annotations

import math
import re
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.clock import SystemClock
from drivers.emulator_process import DriveLink
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.wiring import CardWiring, CounterWire, Teds, Wire
from drivers.protocols.generator import DriveSettings
from rig.files.bench import load_bench
from tests.end_to_end.command import command
from tests.end_to_end.files import CHANNELS, PLANAR_BENCH, write_bench, write_crank, write_scenario

RATE = 6400.0


@dataclass
class TappedPlant:
    """Sensors at rest; so many volts of a drive are a tap of so much at the channel of its frequency."""

    channels: tuple[str, ...] = CHANNELS
    _next: int = 0
    _taps: list[tuple[int, float, float]] = field(default_factory=list)
    _noise: np.random.Generator = field(default_factory=lambda: np.random.default_rng(3))

    def start(self, sample_rate: float) -> None:
        self._next = 0

    def drive(self, settings: DriveSettings, at_sample: float) -> None:
        self._taps.append((round(settings.frequency_hz), at_sample, settings.amplitude_v))

    def advance(self, count: int) -> NDArray[np.float64]:
        at = np.arange(self._next, self._next + count)
        self._next += count
        rows = self._noise.normal(0.0, 0.01, (len(self.channels), count))
        rows[3] += 0.2 * np.sin(math.tau * 50.0 * at / RATE)
        for row, first, height in self._taps:
            since = np.maximum(at - first, 0.0) / RATE
            rows[row] += height * np.exp(-300.0 * since) * (at >= first)
        return rows


@contextmanager
def untouched() -> Iterator[str]:
    """The address of a generator of which nobody is to want anything: a call there fails the test."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield f"TCPIP::127.0.0.1::{listener.getsockname()[1]}::SOCKET"
        listener.setblocking(False)
        with pytest.raises(BlockingIOError):
            listener.accept()


# as they hang: the two stops' cables are swapped, the yoke's sensor stands on its head
WIRES = {
    "cDAQ1Mod1/ai0": Wire("drive.force", 0.1),
    "cDAQ1Mod1/ai1": Wire("contact.force_lower", 0.02),
    "cDAQ1Mod1/ai2": Wire("contact.force_upper", 0.02),
    "cDAQ1Mod1/ai3": Wire("yoke.force", -0.0224, teds=Teds(4711, 0.0224)),
    "cDAQ1Mod2/ai0": Wire("base.acceleration", 0.0102),
}


def test_taps_set_a_bench_right_and_no_actuator_is_reached(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml")
    scenario.write_text(scenario.read_text().replace("51.2 kHz", "6.4 kHz"))
    with (
        untouched() as generator,
        DriveLink.new() as link,
        start_daq_card(TappedPlant, CardWiring(WIRES), link.receiver) as card,
    ):
        bench = write_bench(tmp_path / "bench.toml", generator, card.address)
        before = bench.read_text().replace('serial = "EMU-104"', "# serial as its TEDS says")
        bench.write_text(f"# room 4\n{before}")
        with command("monitor", scenario, "--bench", bench, "--write", typed="") as running:
            for row, name in enumerate(CHANNELS):
                running.await_line(name)
                time.sleep(0.3)  # a whole block has to be quiet after the tap before
                link.sender.send(DriveSettings(True, float(row), 20.0, 0.0, SystemClock().monotonic_s()))
                running.await_line("tap: ")
                running.type("\n")
            running.await_line("  yoke.force: inverted = true")  # what is typed before that is not its answer
            running.type("y\n")
            ended = running.end()
    assert (ended.code, ended.err) == (0, "")
    assert re.search(r"yoke\.force .* 50 Hz 0\.(2|199|201) N", ended.out)
    assert "TEDS: serial 4711, 22.4 mV per N" in ended.out
    edited = load_bench(bench, "impact_beam")
    found = {each.name: (each.physical, bool(each.inverted)) for each in edited.daq_card.channels}
    assert found == {
        "drive.force": ("cDAQ1Mod1/ai0", False),
        "contact.force_upper": ("cDAQ1Mod1/ai2", False),
        "contact.force_lower": ("cDAQ1Mod1/ai1", False),
        "yoke.force": ("cDAQ1Mod1/ai3", True),
        "base.acceleration": ("cDAQ1Mod2/ai0", False),
    }
    assert bench.read_text().startswith("# room 4\n")


ACCELERATIONS = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y")
TURN, TO_ZERO = 10, 11
"""What a person at the shaft is told, as frequencies: two turns and a bit; on to angle 0."""


@dataclass
class HandTurnedPlant:
    """A crank at rest until it is turned, at a turn a second; its mark begins at 37 degrees."""

    channels: tuple[str, ...] = (*ACCELERATIONS, "crank.angle", "crank.marker")
    _next: int = 0
    _turned: float = 0.3
    _to: float = 0.3
    _taps: list[tuple[int, float, float]] = field(default_factory=list)
    _noise: np.random.Generator = field(default_factory=lambda: np.random.default_rng(3))

    def start(self, sample_rate: float) -> None:
        self._next = 0

    def drive(self, settings: DriveSettings, at_sample: float) -> None:
        code = round(settings.frequency_hz)
        if code in (TURN, TO_ZERO):
            self._to = {TURN: 0.3 + 2.3 * math.tau, TO_ZERO: 3 * math.tau}[code]
        else:
            self._taps.append((code, at_sample, settings.amplitude_v))

    def advance(self, count: int) -> NDArray[np.float64]:
        at = np.arange(self._next, self._next + count)
        self._next += count
        rows = self._noise.normal(0.0, 0.01, (len(self.channels), count))
        for row, first, height in self._taps:
            since = np.maximum(at - first, 0.0) / RATE
            rows[row] += height * np.exp(-300.0 * since) * (at >= first)
        angle = np.minimum(self._turned + math.tau / RATE * np.arange(1, count + 1), self._to)
        self._turned = float(angle[-1])
        rows[3] = angle
        rows[4] += 5.0 * ((angle - math.radians(37.0)) % math.tau < math.radians(5.0))
        return rows


@pytest.mark.long
def test_a_turn_by_hand_sets_encoder_and_mark_of_a_crank_right(tmp_path: Path) -> None:
    scenario = write_crank(tmp_path / "scenario.toml", "planar_slider_crank")
    scenario.write_text(scenario.read_text().replace("25.6 kHz", "6.4 kHz"))
    wires = {f"cDAQ1Mod1/ai{row}": Wire(name, 0.05 / 9.80665) for row, name in enumerate(ACCELERATIONS)}
    wires["cDAQ1Mod1/ai3"] = Wire("crank.marker", 1.0, range_v=10.0)
    # its tracks are swapped: what goes forwards counts backwards
    counters = {"cDAQ1Mod3/ctr0": CounterWire("crank.angle", 1024, backwards=True)}
    with (
        DriveLink.new() as link,
        start_daq_card(HandTurnedPlant, CardWiring(wires, counters=counters), link.receiver) as card,
    ):
        text = PLANAR_BENCH.replace("index = true", "index = false").replace("= 2036", "= 2096")
        head, table = text.split("[daq_card]")
        real = table.replace("emulated = true", f'grpc = "{card.address}"', 1)
        bench = tmp_path / "bench.toml"
        bench.write_text(f"{head}[daq_card]{real}")
        with command("monitor", scenario, "--bench", bench, "--write", typed="") as running:

            def told(code: float, height: float = 1.0) -> None:
                clock_s = SystemClock().monotonic_s()
                link.sender.send(DriveSettings(True, float(code), height, 0.0, clock_s))

            for row, name in enumerate(ACCELERATIONS):
                running.await_line(name)
                time.sleep(0.3)
                told(row, 20.0)
                running.await_line("tap: ")
                running.type("\n")
            running.await_line("turn the shaft forwards")
            told(TURN)
            time.sleep(3.0)
            running.type("\n")
            running.await_line("turn it on to its angle 0")
            told(TO_ZERO)
            time.sleep(1.5)
            running.type("\n")
            running.await_line("  crank.")
            time.sleep(0.5)
            running.type("y\n")
            ended = running.end()
    assert (ended.code, ended.err) == (0, ""), ended.out
    edited = {each.name: each for each in load_bench(bench, "planar_slider_crank").daq_card.channels}
    angle, mark = edited["crank.angle"].pulses, edited["crank.marker"].mark
    assert angle is not None
    assert angle.backwards
    assert mark is not None
    # a sample is 0.06 degrees, a reading of the angle at the mark half a degree
    assert math.degrees(mark.angle) == pytest.approx(37.0, abs=0.6)

"""Instruments are let go at the end, and one that hangs there keeps nobody."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daq.errors import InstrumentRefused, InstrumentSilent
from drivers import lock as locks
from drivers.lock import lock
from rig.files.bench import Bench, embedded_bench
from rig.files.scenario import Scenario, edited, parse_scenario
from rig.session import devices
from rig.session.devices import Devices, Standing, connected
from rig.session.progress import Screen
from rig.session.signals import Stopped, StopRequest
from tests.rig.session.fakes import FAKE, RecordingGenerator, silent_screen
from tests.rig.session.test_driven_rig import SCENARIO


class Part(SimpleNamespace):
    """Notes that it was closed; hangs there if it is to."""

    def __init__(self, name: str, told: list[str], hangs: threading.Event | None = None) -> None:
        super().__init__(name=name, told=told, hangs=hangs)

    def close(self) -> None:
        self.told.append(self.name)
        if self.hangs is not None:
            self.hangs.wait()


def test_one_that_hangs_at_the_end_keeps_neither_the_others_nor_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(devices, "JOIN_S", 0.2)
    told, goes_on = list[str](), threading.Event()
    motion: Any = None
    held = SimpleNamespace(close=lambda: told.append("lock"))
    opened: Any = {
        "actuator": Part("generator", told),
        "encoder": Part("encoder", told, goes_on),
        "card": Part("card", told, goes_on),
        "loggers": {"thermometer": Part("thermometer", told)},
        "locks": [held],
    }
    since_s = time.monotonic()
    Devices(spare=None, motion=motion, **opened).close()
    assert time.monotonic() - since_s < 1.0
    assert told == ["generator", "thermometer", "encoder", "card", "lock"]
    goes_on.set()


PARTS = ("generator", "card", "encoder", "thermometer")


@pytest.mark.parametrize("used", PARTS)
def test_where_somebody_uses_one_of_them_none_is_opened(used: str) -> None:
    """To connect stops an encoder and resets a generator, which the run that has them goes on with."""
    opened = list[str]()

    def part(name: str) -> Any:
        address = f"{name} of {FAKE}"
        return SimpleNamespace(
            name=name, address=address, open=lambda: opened.append(name), close=lambda: None
        )

    generator, card, encoder, thermometer = map(part, PARTS)
    motion: Any = None
    ours = Devices(generator, None, motion, card, encoder, {"thermometer": thermometer})
    with lock(used, f"{used} of {FAKE}"), pytest.raises(InstrumentRefused, match=f"{used} .*: in use by"):
        ours.open()
    assert not opened
    ours.open()  # nothing of ours is held by then
    assert opened == list(PARTS)
    ours.close()


class Connecting:
    """Connects to a new generator each time."""

    def __init__(self, fails_at: str = "") -> None:
        self.generators: list[RecordingGenerator] = []
        self._fails_at = fails_at

    def __call__(
        self, scenario: Scenario, bench: Bench, stack: ExitStack, screen: Screen
    ) -> tuple[Devices, dict[str, str]]:
        self.generators.append(generator := RecordingGenerator(self._fails_at))
        nothing: Any = lambda: None  # noqa: E731
        card: Any = SimpleNamespace(
            name="card", address=f"card of {FAKE}", channels=(), sample_rate=1.0, open=nothing, close=nothing
        )
        motion: Any = None
        return Devices(generator, None, motion, card), {"emulated": "all"}

    def ended(self, number: int) -> bool:
        return self.generators[number].told[-2:] == [("off",), ("close",)]


@pytest.fixture(autouse=True)
def own_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))


BENCH, BEAM = embedded_bench(), parse_scenario(SCENARIO, "beam")


def connect_for(standing: Standing, scenario: Scenario, bench: Bench = BENCH) -> Devices:
    return standing.connected(scenario, bench, silent_screen(), StopRequest())[0]


def test_what_stands_is_connected_once_for_runs_that_differ_in_what_instruments_set() -> None:
    connecting = Connecting()
    with Standing(connecting) as standing:
        first = connect_for(standing, BEAM)
        for settings in (
            {"drive.frequency": "31 Hz"},
            {"drive.amplitude": "3 N", "acquisition.duration": "9 s"},
        ):
            assert connect_for(standing, edited(BEAM, settings, "beam")) is first
        assert not connecting.ended(0)
    assert connecting.ended(0)
    assert len(connecting.generators) == 1


@pytest.mark.parametrize("settings", [{"model.clearance": "0.2 mm"}, {"acquisition.sample_rate": "25.6 kHz"}])
def test_another_rig_or_rate_is_connected_anew_with_the_drive_off_before(settings: dict[str, str]) -> None:
    connecting = Connecting()
    with Standing(connecting) as standing:
        connect_for(standing, BEAM)
        connect_for(standing, edited(BEAM, settings, "beam"))
        assert len(connecting.generators) == 2
        assert connecting.ended(0)
        standing.close()
        assert connecting.ended(1)
        connect_for(standing, BEAM)
        connect_for(standing, BEAM, replace(BENCH, text="another"))
    assert len(connecting.generators) == 4


def test_an_emulated_rig_that_cannot_hear_the_drive_is_started_with_each() -> None:
    connecting, bench = Connecting(), embedded_bench()
    real = replace(bench.actuator, emulated=False)
    deaf = replace(bench, instruments={**bench.instruments, "signal_generator": real})
    with Standing(connecting) as standing:
        for scenario in (BEAM, BEAM, edited(BEAM, {"drive.frequency": "31 Hz"}, "beam")):
            connect_for(standing, scenario, deaf)
    assert len(connecting.generators) == 2


def test_a_signal_ends_the_wait_for_what_is_started_at_once() -> None:
    """An emulated rig is compiled first, for up to a minute in which nobody looks."""

    def connect(*_: object) -> tuple[Devices, dict[str, str]]:
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("went on")

    with (
        ExitStack() as stack,
        StopRequest() as stop,
        pytest.raises(Stopped, match="stopped by a person"),
    ):
        connected(stack, connect, BEAM, BENCH, silent_screen(), stop)
    assert stop.asked == 1


def test_why_a_run_ended_is_not_hidden_by_a_drive_that_does_not_go_off() -> None:
    def run(error: Exception | None) -> None:
        with Standing(Connecting("off")) as standing:
            connect_for(standing, BEAM)
            if error is not None:
                raise error

    with pytest.raises(ZeroDivisionError):
        run(ZeroDivisionError())
    with pytest.raises(InstrumentSilent):  # and ends what goes well else
        run(None)


def test_one_supervisor_watches_until_what_stands_is_closed() -> None:
    told: list[str] = []
    made: Any = SimpleNamespace(close=lambda: told.append("closed"))
    with Standing(Connecting()) as standing:
        connect_for(standing, BEAM)
        assert standing.supervised(lambda: made) is made
        assert standing.supervised(lambda: pytest.fail("a second one")) is made
        assert told == []
    assert told == ["closed"]

"""A person as an actuator: asked on standard error or, an emulated one, over a socket."""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Iterator
from multiprocessing.connection import Connection

import pytest

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.manual.actuator import STOP, ManualActuator
from drivers.manual.emulator.person import EmulatedPerson, shaken, start_person, turned
from drivers.manual.settings import ManualMotorSettings
from drivers.protocols.generator import DriveSettings
from drivers.protocols.instrument import Actuator
from drivers.protocols.speed_drive import MotorOutput
from tests.drivers.scripted import ScriptedInstrument

SETTINGS = ManualMotorSettings(maximum_speed_rpm=300.0)


@pytest.fixture(scope="module")
def person() -> Iterator[tuple[str, Connection]]:
    receiver, sender = multiprocessing.get_context("spawn").Pipe(duplex=False)
    with start_person(turned, sender) as emulator, receiver:
        sender.close()
        yield emulator.address, receiver


def test_an_emulated_person_is_not_quite_right_and_corrects_it(
    person: tuple[str, Connection],
) -> None:
    address, outputs = person
    hand: Actuator = ManualActuator(SETTINGS.at(address))
    spare = ManualActuator(SETTINGS.at(address), off_first=True)
    assert isinstance(hand, ManualActuator)
    hand.open()
    spare.open()
    hand.off()  # nobody was asked for anything
    hand.ask("turn it", "set", 20.0)
    first: MotorOutput = outputs.recv()
    assert (first.on, first.level, first.target) == (True, 0.0, pytest.approx(20.6))
    hand.ask("slower", "shows", 20.4)
    assert outputs.recv().target == pytest.approx(20.6 * 20.0 / 20.4)
    hand.ask("nothing is seen", "shows", math.nan)
    assert outputs.recv().target == pytest.approx(20.6 * 20.0 / 20.4)
    for _ in range(2):
        with pytest.raises(InstrumentRefused, match="nothing shows that it came"):
            spare.off()  # by a connection of its own
    assert outputs.recv().target == 0.0
    for each in (hand, spare, spare):
        each.close()
    hand.off()  # a closed one asks nobody, and is no error
    assert not outputs.poll(0)


def test_a_drive_of_a_shaker_keeps_its_phase_and_is_off_at_rest() -> None:
    class Sink:
        def __init__(self) -> None:
            self.heard = list[DriveSettings]()

        def send(self, output: object, /) -> None:
            assert isinstance(output, DriveSettings)
            self.heard.append(output)

    sink = Sink()
    hand = EmulatedPerson(shaken, sink)
    assert hand.heed("rest") == "ok"
    assert hand.heed("set 20 3") == hand.heed("shows 20.6 3.09") == hand.heed("rest") == "ok"
    assert [(each.on, each.frequency_hz) for each in sink.heard] == [
        (True, pytest.approx(20.6)),
        (True, pytest.approx(20.0)),
        (False, pytest.approx(20.0)),
    ]
    first, second, _ = sink.heard
    advance = math.tau * first.frequency_hz * (second.started_s - first.started_s)
    assert math.cos(second.phase_rad - first.phase_rad - advance) == pytest.approx(1.0)
    for nonsense in ("", "set", "set a", "shows 1", "rest 1", "dance"):
        assert hand.heed(nonsense) == "what?"


def test_a_real_person_reads_what_is_asked_and_waits_for_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    hand = ManualActuator(SETTINGS)
    hand.open()
    assert (hand.identity, hand.address) == ("a person", "the rig")
    hand.ask("BY HAND: turn it", "set", 20.0)
    hand.off()
    hand.off()
    hand.close()
    said = capfd.readouterr().err
    assert "BY HAND: turn it\n" in said
    assert said.count(f"\a{STOP}\n") == 1


@pytest.mark.parametrize(
    ("answer", "error", "match"),
    [
        (b"what?\n", DeviceLost, "answers b'what"),
        (None, DeviceLost, "answers b''"),
        (b"", InstrumentSilent, "no answer"),
    ],
    ids=["refuses", "hangs up", "is silent"],
)
def test_an_emulated_person_who_does_not_answer(
    answer: bytes | None, error: type[Exception], match: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.manual.actuator._ANSWER_S", 0.2)
    with ScriptedInstrument(lambda line: answer) as server:
        hand = ManualActuator(SETTINGS.at(f"127.0.0.1:{server.resource.split('::')[2]}"), off_first=True)
        hand.open()
        with pytest.raises(error, match=match):
            hand.off()
        hand.close()


def test_nobody_listens() -> None:
    with ScriptedInstrument(lambda line: b"") as server:
        port = server.resource.split("::")[2]
    with pytest.raises(InstrumentAbsent, match="rattle emulate"):
        ManualActuator(SETTINGS.at(f"127.0.0.1:{port}")).open()

"""The one table of faults: how it is named, and that every emulator does what stands there."""

from __future__ import annotations

import inspect
import os
import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.errors import ConfigurationError
from drivers.canopen_cia406.emulator import encoder
from drivers.canopen_cia406.emulator import process as encoder_process
from drivers.mitsubishi_fr.emulator import process as inverter_process
from drivers.mitsubishi_fr.emulator import server
from drivers.mitsubishi_fr.emulator.line_faults import KINDS
from drivers.ni_daq.emulator import spoilt, wiring
from drivers.ni_daq.emulator.converter import Converter
from drivers.ni_daq.emulator.spoilt import SpoiltPlant
from drivers.ni_daq.emulator.wiring import CardWiring, CounterWire, DaqmxError, Input, Teds, Wire
from drivers.rehearsal import FAULTS, Fault, Rehearsal, rehearsed
from drivers.scpi.emulator import process as generator_process
from rig.session import spoilt_disk

EVERYWHERE = {"unplugged", "hangs"}
SOURCES = {
    "signal_generator": (generator_process,),
    "dc_supply": (generator_process,),
    "inverter": (server, inverter_process),
    "encoder": (encoder, encoder_process),
    "daq_card": (wiring, spoilt),
    "disk": (spoilt_disk,),
}
"""Where each is told apart by its name."""
LAST_OF_ALL = {"disk.fails", "daq_card.stuck"}
RATE = 1000.0


def test_every_fault_of_the_table_is_somebodys() -> None:
    for name in FAULTS:
        table, _, kind = name.partition(".")
        text = "".join(inspect.getsource(module) for module in SOURCES[table])
        known = EVERYWHERE | {each.replace(" ", "_") for each in KINDS}
        assert kind in known or f'"{kind}"' in text or name in LAST_OF_ALL, name
        assert re.fullmatch(r"E|F([1-9]|[12][0-9]|3[0-5])", FAULTS[name].number)


def test_the_page_of_drills_has_the_table() -> None:
    page = (Path(__file__).parents[2] / "docs" / "drills.md").read_text()
    rows = [
        f"| `{fault.spelled(name)}` | {fault.number} | {fault.told} | {fault.seen} |"
        for name, fault in FAULTS.items()
    ]
    assert page.endswith("\n".join(rows) + "\n")
    for named in re.findall(
        r"`((?:signal_generator|dc_supply|inverter|daq_card|encoder|disk)\.[^`]*)`",
        page.partition("## The table")[0],
    ):
        rehearsed(named)


def test_what_a_fault_says_it_does_is_no_matter_of_when() -> None:
    comes = Fault("F3", "jumps, after it was right (from the start)", "")
    assert not comes.at_start
    assert replace(comes, does="jumps", at_start=True).told == "jumps (from the start)"


def test_a_fault_is_named_with_its_time_and_keys() -> None:
    fault = rehearsed("inverter.refuses@2.5:code=0x0b:count=3")
    assert (fault.table, fault.kind, fault.at_s) == ("inverter", "refuses", 2.5)
    assert [fault.number(key) for key in ("code", "count", "register")] == [11.0, 3.0, 40201.0]
    assert rehearsed("daq_card.open:channel=drive.force").channel == "drive.force"


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("encoder.mising", r"one of signal_generator\.unplugged, .*encoder\.missing"),
        ("encoder.missing@soon", "a number from 0 on instead of 'soon'"),
        ("encoder.missing@-1", "a number from 0 on instead of '-1'"),
        ("daq_card.hangs:by=3", r"of daq_card\.hangs for=\.\.\."),
        ("encoder.stuck:value=1", r"of encoder\.stuck no key"),
        ("daq_card.open@2:channel=drive.force", "no time: daq_card.open is there from the start"),
        ("encoder.wrong_device@0", "no time: "),
        ("disk.full:bytes=", r"of disk\.full bytes=\.\.\."),
    ],
)
def test_what_is_not_there_is_refused_with_what_is(text: str, match: str) -> None:
    with pytest.raises(ConfigurationError, match=match):
        rehearsed(text)


def test_each_comes_once_when_its_time_has_come() -> None:
    late, soon = rehearsed("encoder.missing@2"), rehearsed("encoder.duplicate@1")
    rehearsal = Rehearsal([late, soon])
    assert not list(rehearsal.due(0.9))
    assert list(rehearsal.due(2.0)) == [soon, late]
    assert not list(rehearsal.due(9.0))


def test_what_is_there_from_the_start_does_not_come_again() -> None:
    there = [rehearsed(name) for name, fault in FAULTS.items() if fault.at_start]
    assert not list(Rehearsal(there).due(9.0))
    assert np.array_equal(shown("daq_card.open:channel=contact.force"), WHOLE)


class Steps:
    """A force that counts its samples, and a marker of 5 V for two samples in `turn`."""

    channels = ("contact.force", "crank.marker")

    def __init__(self, turn: int = 10) -> None:
        self._turn, self.made = turn, 0

    def start(self, sample_rate: float) -> None:
        self.made = 0

    def drive(self, output: object, at_sample: float) -> None: ...

    def advance(self, count: int) -> NDArray[np.float64]:
        samples = np.arange(self.made, self.made + count)
        self.made += count
        return np.stack([samples.astype(float), 5.0 * (samples % self._turn < 2)])


def shown(text: str, blocks: int = 40, turn: int = 10) -> NDArray[np.float64]:
    plant = SpoiltPlant(Steps(turn), [rehearsed(text)], seed=1)
    plant.start(RATE)
    return np.concatenate([plant.advance(25) for _ in range(blocks)], axis=1)


WHOLE = np.concatenate([Steps().advance(1000)], axis=1)


def test_a_sensor_sticks_and_clips_for_as_long_as_it_was_told_to() -> None:
    stuck = shown("daq_card.stuck@0.1:for=0.2:channel=contact.force")
    assert (stuck[0, 100:300] == 100.0).all()
    clipped = shown("daq_card.clips@0.1:for=0.2")
    assert (clipped[0, 100:300] > 1e9).all()
    broken = shown("daq_card.not_finite@0.1:for=0.2")
    assert np.flatnonzero(np.isnan(broken[0])).tolist() == list(range(100, 300, 25))
    for each in (stuck, clipped, broken):
        assert np.array_equal(
            np.delete(each, range(100, 300), axis=1), np.delete(WHOLE, range(100, 300), axis=1)
        )


@pytest.mark.parametrize(
    "name", [name for name, fault in FAULTS.items() if name.startswith("daq_card.") and fault.at_start]
)
def test_what_is_so_from_the_start_is_none_of_the_plants(name: str) -> None:
    assert np.array_equal(shown(name), WHOLE)


def test_a_cable_comes_loose_at_its_time_and_its_input_shows_no_more_than_noise() -> None:
    plant = SpoiltPlant(Steps(), [rehearsed("daq_card.comes_loose@0.1:channel=contact.force")], seed=1)
    plant.start(RATE)
    inputs = [Input(f"cDAQ1Mod1/ai{k}", 1e-2, 10.0, iepe=True) for k in range(2)]
    wires = {each.physical: Wire(name, 1e-2, 10.0) for each, name in zip(inputs, plant.channels, strict=True)}
    converter = Converter(CardWiring(wires), plant.channels, inputs, RATE)
    for block in range(8):
        shown = plant.advance(25)
        values, _ = converter.convert(shown, plant.loose)
        comes = block >= 4
        assert converter.fed_by(plant.loose) == (["cDAQ1Mod1/ai0"] if comes else [])
        assert (np.abs(values[0]) < 0.1).all() == comes
        assert values[1] == pytest.approx(shown[1], abs=0.1)


def test_marks_are_left_out_whole_and_as_many_as_were_asked_for() -> None:
    marker = shown("daq_card.marks_missing:share=0.3")[1].reshape(-1, 10)
    assert {tuple(each) for each in marker[:, :2].tolist()} == {(5.0, 5.0), (0.0, 0.0)}
    assert 0.15 < (marker[:, 0] == 0.0).mean() < 0.45
    assert np.array_equal(shown("daq_card.marks_missing:share=0")[1], WHOLE[1])


def test_marks_come_late_each_by_its_lot() -> None:
    marker = shown("daq_card.marks_late:by=0.002")[1].reshape(-1, 10)
    assert {tuple(each) for each in marker[:, :2].tolist()} == {(0.0, 5.0), (0.0, 0.0)}
    assert not marker[:, 2:].any()


def test_a_glitch_follows_as_many_marks_as_were_asked_for() -> None:
    marker = shown("daq_card.marks_doubled:share=0.3", turn=50)[1].reshape(-1, 50)
    assert (marker[:, :2] == 5.0).all()
    glitches = (marker[:, 2:] == 5.0).sum(axis=1)
    assert set(glitches.tolist()) == {0, 1}
    assert 0.1 < glitches.mean() < 0.6


def test_a_channel_chatters_for_as_long_as_it_was_told_to() -> None:
    raised = shown("daq_card.chatters@0.1:height=3:for=0.5")[0] - WHOLE[0]
    assert set(raised.tolist()) == {0.0, 3.0}
    assert np.flatnonzero(raised)[[0, -1]].tolist() == [100, 519]
    assert (raised > 0).sum() == 5 * 20


def test_a_channel_is_off_from_its_time_on() -> None:
    shifted = shown("daq_card.offset@0.1:by=3:channel=contact.force") - WHOLE
    assert np.flatnonzero(shifted[0]).tolist() == list(range(100, 1000))
    assert set(shifted[0, 100:].tolist()) == {3.0}
    assert not shifted[1].any()


def test_an_emergency_stop_is_pressed_at_its_time() -> None:
    pressed: list[int] = []
    steps = Steps()
    plant = SpoiltPlant(
        steps, [rehearsed("daq_card.stop_pressed@0.5")], seed=1, press=lambda: pressed.append(steps.made)
    )
    plant.start(RATE)
    for _ in range(40):
        plant.advance(25)
    assert pressed == [525]  # as the block is made that begins at its time


@pytest.mark.parametrize("kind", ["fails", "sync_fails", "close_fails"])
def test_a_call_to_the_disk_fails(kind: str, tmp_path: Path) -> None:
    file = spoilt_disk.disk_of((rehearsed(f"disk.{kind}"),))(tmp_path / "log")
    failed = {"fails": "write", "sync_fails": "sync", "close_fails": "close"}[kind]
    calls = {
        "write": lambda: (file.write(b"x"), file.flush()),
        "sync": lambda: os.fsync(file.fileno()),
        "close": file.close,
    }
    for name, call in calls.items():
        if name == failed or (name, failed) == ("close", "write"):  # which flushes what could not be written
            with pytest.raises(OSError, match="Input/output error"):
                call()
        else:
            call()


def test_a_disk_that_stalls_keeps_every_call_waiting(tmp_path: Path) -> None:
    """A sync and a write, whichever comes first."""
    file = spoilt_disk.disk_of((rehearsed("disk.stalls:for=0.3"),))(tmp_path / "log")
    begun_s = time.monotonic()
    waited_s: dict[str, float] = {}

    def call(name: str, act: Callable[[], object]) -> None:
        act()
        waited_s[name] = time.monotonic() - begun_s

    def write() -> None:
        file.write(b"x")
        file.flush()

    threads = [threading.Thread(target=call, args=each) for each in (("sync", file.fileno), ("write", write))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert min(waited_s.values()) >= 0.3
    file.close()
    assert time.monotonic() - begun_s < 2.0


def test_a_card_that_overruns_says_so() -> None:
    with pytest.raises(DaqmxError, match="overwritten before they were read"):
        shown("daq_card.overruns@0.5")


def test_cables_and_counters_are_so_from_the_start() -> None:
    faults = [rehearsed(f"daq_card.{kind}") for kind in ("open", "rolls_over:before=7")]
    card = CardWiring(
        {"a/ai0": Wire("f", 1.0), "a/ai1": Wire("g", 1.0)}, counters={"a/ctr0": CounterWire("x")}
    )
    opened = wiring.spoilt(CardWiring(card.wires, counters=card.counters, faults=tuple(faults)))
    assert [wire.connected for wire in opened.wires.values()] == [False, True]
    assert opened.counters["a/ctr0"].preset == 2**32 - 7
    shorted = wiring.spoilt(CardWiring(card.wires, faults=(rehearsed("daq_card.short:channel=g"),)))
    assert [wire.shorted for wire in shorted.wires.values()] == [False, True]
    other = wiring.spoilt(CardWiring(card.wires, faults=(rehearsed("daq_card.wrong_sensor:channel=g"),)))
    assert [wire.teds for wire in other.wires.values()] == [None, Teds(1, 2.0)]

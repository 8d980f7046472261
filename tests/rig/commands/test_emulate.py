"""`rattle emulate`: which faults there are, which of them come where, and what its emulators are told."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import pytest

from daq.errors import RattleError
from drivers.rehearsal import FAULTS
from rig.files.bench import Bench, Emulation
from rig.files.scenario import Scenario
from tests.rig.commands.cli import Call

SCENARIO = Path(__file__).parents[3] / "scenarios" / "impact_beam.toml"
OF_THE_BEAM = "a fault of signal_generator, daq_card; one of the disk stands in the bench of rattle run"


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[Emulation]:
    """What emulators would be told that were started."""
    told: list[Emulation] = []

    def start(scenario: Scenario, bench: Bench) -> NoReturn:
        told.append(bench.emulation)
        raise RattleError("started")

    monkeypatch.setattr("rig.emulation.emulated_bench", start)
    monkeypatch.setattr("signal.signal", lambda *_: None)  # they are this process's
    return told


def test_the_list_names_every_fault_of_the_table(call: Call) -> None:
    answer = call("emulate", "--fault", "list")
    assert answer.code == 0
    assert [line.split(maxsplit=2) for line in answer.out.splitlines()] == [
        [fault.spelled(name), fault.number, f"{fault.told}; {fault.seen}"] for name, fault in FAULTS.items()
    ]


@pytest.mark.parametrize(
    ("fault", "allowed"),
    [
        ("disk.full", f"disk.full: {OF_THE_BEAM}"),
        ("inverter.trips@2", f"inverter.trips: {OF_THE_BEAM}"),
        ("inverter.stop_pressed@2", f"inverter.stop_pressed: {OF_THE_BEAM}"),
        ("daq_card.stop_pressed", "daq_card.stop_pressed: a bench with [emergency_stop] on a line"),
        ("daq_card.open:channel=tip", "daq_card.open:channel=tip: a channel of the card (drive.force, "),
        ("daq_card.melts", "daq_card.melts: one of signal_generator.unplugged, "),
        ("daq_card.clips@soon", "daq_card.clips@soon: a number from 0 on instead of 'soon'"),
    ],
)
def test_a_fault_that_cannot_come_is_refused(
    call: Call, told: list[Emulation], fault: str, allowed: str
) -> None:
    answer = call("emulate", SCENARIO, "--fault", fault)
    assert answer.code == 2
    assert answer.err.startswith("rattle: faults to rehearse:\n")
    (line,) = answer.err.splitlines()[1:]
    assert f" = {allowed}" in line
    assert not told


def test_what_it_is_asked_for_comes_beside_what_its_bench_says(
    call: Call, told: list[Emulation], tmp_path: Path
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text('[emulation]\nseed = 3\nfaults = ["daq_card.hangs@9"]\n')
    asked = ("--fault", "signal_generator.unplugged@4", "--fault", "daq_card.overruns", "--seed", 7)
    for more in (asked, ()):
        assert call("emulate", SCENARIO, "--bench", bench, *more).err == "rattle: started\n"
    of_bench = ("daq_card.hangs@9",)
    assert [each.seed for each in told] == [7, 3]
    assert [each.faults for each in told] == [(*of_bench, asked[1], asked[3]), of_bench]

"""The lines that `rattle emulate` prints are a bench file, by which a run reaches what it has started."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from daq.log.reader import LogReader
from daq.log.recover import verify_log
from rig.files.bench import embedded_bench
from rig.rigs import RIGS
from rig.session.progress import FIRST_START
from tests.end_to_end.command import Command, await_gone, command, rattle
from tests.end_to_end.files import write_crank, write_scenario

pytestmark = pytest.mark.timeout(400)
DEADLINE_S = 300.0
"""On a machine with other work: the inverter's ramps, the loop around them and the record are real time."""
ENCODER = "[encoder]\nemulated = true\n"


def printed_bench(emulators: Command) -> str:
    assert FIRST_START in emulators.await_line("starting")
    emulators.await_line("to reach them")
    lines = [emulators.await_line("")]
    while not lines[-1].startswith("Ctrl-C"):
        lines.append(emulators.await_line(""))
    return "\n".join(lines[:-1])


@contextmanager
def reached(scenario: Path, *asked: object) -> Iterator[Path]:
    """The bench that emulators print, which end with the context and leave nothing."""
    with command("emulate", scenario, *asked) as emulators:
        bench = scenario.with_name("printed.toml")
        bench.write_text(printed_bench(emulators))
        yield bench
        servers = emulators.children()
        emulators.signal(signal.SIGINT)
        assert emulators.end().code == 130
    await_gone(servers)


SHORT, *OTHERS = RIGS


@pytest.mark.long
@pytest.mark.parametrize("rig", [SHORT, *(pytest.param(rig, marks=pytest.mark.long) for rig in OTHERS)])
def test_the_printed_lines_are_a_bench_that_a_run_takes(rig: str, tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    if rig == "impact_beam":
        write_scenario(scenario, settle_s=0.0, duration_s=0.3)
    else:
        write_crank(scenario, rig, 0.3)
    emulated = tmp_path / "emulated.toml"
    emulated.write_text(ENCODER if "encoder" in RIGS[rig].extras else "[emulation]\n")
    with reached(scenario, "--bench", emulated) as bench:
        ended = rattle("run", scenario, "--bench", bench, "--out", tmp_path, deadline_s=DEADLINE_S)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.count(FIRST_START) == 1
    assert verify_log(ended.log).sound
    with LogReader(ended.log) as log:
        assert "emulated" not in log.metadata["run"]
        measured = set(log.channels("measured"))
    on_the_card = {channel.name for channel in embedded_bench(rig).daq_card.channels}
    assert measured == on_the_card | ({"encoder.angle"} if "encoder" in RIGS[rig].extras else set())


@pytest.mark.long
def test_a_run_meets_the_fault_that_was_asked_for_in_the_other_terminal(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.5, duration_s=4.0)
    turned = "signal_generator.set_by_another@2:volts=3"
    with reached(scenario, "--fault", turned, "--seed", 7) as bench:
        ended = rattle("run", scenario, "--bench", bench, "--out", tmp_path, deadline_s=DEADLINE_S)
    assert ended.code == 1
    assert "which it was not told" in ended.err
    assert "the drive is off" in ended.err
    assert verify_log(ended.log).sound

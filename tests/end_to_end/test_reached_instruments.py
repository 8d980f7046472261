"""The lines that `rattle emulate` prints are a bench file, by which a run reaches what it has started."""

from __future__ import annotations

import signal
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
    with command("emulate", scenario, "--bench", emulated) as emulators:
        bench = tmp_path / "printed.toml"
        bench.write_text(printed_bench(emulators))
        ended = rattle("run", scenario, "--bench", bench, "--out", tmp_path, deadline_s=DEADLINE_S)
        servers = emulators.children()
        emulators.signal(signal.SIGINT)
        assert emulators.end().code == 130
    await_gone(servers)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.count(FIRST_START) == 1
    assert verify_log(ended.log).sound
    with LogReader(ended.log) as log:
        assert "emulated" not in log.metadata["run"]
        measured = set(log.channels("measured"))
    on_the_card = {channel.name for channel in embedded_bench(rig).daq_card.channels}
    assert measured == on_the_card | ({"encoder.angle"} if "encoder" in RIGS[rig].extras else set())

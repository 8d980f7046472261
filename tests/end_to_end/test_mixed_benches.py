"""Real and emulated instruments in any mix give logs of one layout."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from daq.log.reader import LogReader
from daq.log.recover import verify_log
from tests.end_to_end.command import await_gone, command, rattle
from tests.end_to_end.conftest import SpiedBench
from tests.end_to_end.files import write_bench, write_scenario


def layout(path: Path) -> dict[str, dict[str, str]]:
    """Topics of samples with their metadata; what instruments they come from is not in it."""
    assert verify_log(path).sound
    with LogReader(path) as log:
        return {
            topic: metadata
            for topic, metadata in log.topic_metadata().items()
            if topic.startswith(("/measured/", "/predicted/"))
        }


@pytest.mark.parametrize("emulated", [pytest.param("card", marks=pytest.mark.long), "generator"])
def test_half_of_the_bench_may_be_emulated(
    bench: SpiedBench, tmp_path: Path, settled_log: Path, emulated: str
) -> None:
    generator = None if emulated == "generator" else bench.generator.address
    card = None if emulated == "card" else bench.card.address
    file = write_bench(tmp_path / "mixed.toml", generator, card, "[emulation]\nseed = 5")
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.85, duration_s=0.3)
    ended = rattle("run", scenario, "--bench", file, "--out", tmp_path)
    assert ended.code == 0, ended.err
    assert layout(ended.log) == layout(settled_log)
    with LogReader(ended.log) as log:
        assert log.metadata["run"]["emulated"].split() == [emulated]
        drive = log.series("measured", "drive.force").values
        codes = {event.code for event in log.events()}
    if emulated == "card":
        # It cannot hear the real generator: it plays the scenario's drive and says so.
        bench.spy.await_off()
        assert "it plays the scenario's drive" in ended.out
        assert abs(drive).max() == pytest.approx(9.0, rel=0.05)
        # what it plays says nothing of the real one's frequency, which is left alone
        assert not codes & {"drive.trimmed", "drive.frequency", "drive.frequency_off"}
    else:
        # The real card's plant hears another generator, which nobody drove.
        assert not bench.spy.moved
        assert "shows no drive" in ended.out


@pytest.mark.long
def test_emulated_instruments_of_another_process_are_real_ones_to_a_run(
    tmp_path: Path, settled_log: Path
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.0, duration_s=0.3)
    with command("emulate", scenario, "--json") as emulators:
        lines = [emulators.await_line("{")]
        while lines[-1] != "}":
            lines.append(emulators.await_line(""))
        addresses = json.loads("".join(lines))
        generator, card = addresses["signal_generator"][0], addresses["daq_card"][0]
        file = write_bench(tmp_path / "bench.toml", generator, card)
        ended = rattle("run", scenario, "--bench", file, "--out", tmp_path)
        servers = emulators.children()
        emulators.signal(signal.SIGINT)
        over = emulators.end()
    assert ended.code == 0, ended.err
    assert over.code == 130
    await_gone(servers)
    assert layout(ended.log) == layout(settled_log)
    with LogReader(ended.log) as log:
        assert "emulated" not in log.metadata["run"]
        assert log.series("measured", "contact.force_upper").values.max() > 10.0

"""Drills of docs/drills.md as a lab does them: by a bench file, on the emulated bench.

What each log holds is compared with what was sent after every test (tests/conftest.py).
"""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.block import sample_time_ns
from daq.log.reader import LogReader
from daq.log.records import STOPPING
from daq.log.recover import recover_log, verify_log
from rig.session.driven_rig import STOPPED
from tests.accounting import disk_failed
from tests.end_to_end.command import Ended, rattle
from tests.end_to_end.files import CHANNELS, write_bench, write_scenario


def drilled(folder: Path, *faults: str) -> Ended:
    scenario = write_scenario(folder / "scenario.toml", settle_s=1.0, duration_s=4.0)
    listed = ", ".join(f'"{fault}"' for fault in faults)
    bench = write_bench(folder / "bench.toml", emulation=f"[emulation]\nseed = 7\nfaults = [{listed}]")
    return rattle("run", scenario, "--bench", bench, "--out", folder)


def causes(log: Path) -> set[str]:
    with LogReader(log) as reader:
        return {gap.cause for gap in reader.gaps()}


def test_a_card_that_is_unplugged(tmp_path: Path) -> None:
    ended = drilled(tmp_path, "daq_card.unplugged@4")
    assert ended.code == 1
    assert "reading samples" in ended.err
    assert "the DAQ card was lost" in causes(ended.log)
    assert verify_log(ended.log).sound


@pytest.mark.long
def test_a_disk_that_stalls_and_a_sensor_that_clips_cost_no_sample(tmp_path: Path) -> None:
    ended = drilled(tmp_path, "disk.stalls@2:for=2", "daq_card.clips@4:channel=contact.force_upper")
    assert (ended.code, ended.err) == (0, "")
    assert not causes(ended.log)
    with LogReader(ended.log) as reader:
        assert "sensor.overload" in [event.code for event in reader.events()]


@pytest.mark.long
def test_a_disk_that_is_full(tmp_path: Path) -> None:
    ended = drilled(tmp_path, "disk.full:bytes=1e6")
    assert ended.code == 1
    assert "No space left on device" in ended.err
    assert recover_log(disk_failed(ended.log), tmp_path / "recovered.mcap").sound


@pytest.mark.long
def test_a_generator_that_somebody_turns(tmp_path: Path) -> None:
    ended = drilled(tmp_path, "signal_generator.set_by_another@3:volts=3")
    assert ended.code == 1
    assert "which it was not told" in ended.err
    assert causes(ended.log) <= {STOPPED, "not predicted"}
    with LogReader(ended.log) as reader:
        (stopping_ns,) = (event.time_ns for event in reader.events() if event.code == STOPPING)
        last_ns = dict[str, int]()
        for _, block in reader.blocks("measured"):
            last_ns[block.channel] = sample_time_ns(block.time_ns, len(block), block.sample_rate)
        stopped = {gap.channel for gap in reader.gaps() if gap.cause == STOPPED}
    assert set(last_ns) == set(CHANNELS)
    assert all(end_ns >= stopping_ns or name in stopped for name, end_ns in last_ns.items())


def test_a_generator_of_another_make_moves_nothing(tmp_path: Path) -> None:
    ended = drilled(tmp_path, "signal_generator.wrong_model")
    assert ended.code == 1
    assert "Another Maker" in ended.err
    assert not list(tmp_path.glob("*.mcap"))

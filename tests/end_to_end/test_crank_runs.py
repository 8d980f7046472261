"""The slider-cranks from end to end: every channel measured and predicted, one layout on any bench."""

from __future__ import annotations

import json
import math
import signal
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from daq.block import SampleBlock
from daq.log.reader import LogReader, Origin
from daq.log.recover import verify_log
from drivers.canopen_cia406.settings import EncoderSettings
from rig.emulation import encoder_setup
from rig.files.bench import Emulation
from rig.rigs import RIGS
from tests.end_to_end.command import await_gone, command, rattle
from tests.end_to_end.files import write_crank, write_crank_bench

pytestmark = pytest.mark.timeout(400)
DEADLINE_S = 300.0
"""On a machine with other work: the inverter's ramps, the loop around them and the record are real time."""
DURATION_S = 1.0
ORIGINS: tuple[Origin, Origin] = ("measured", "predicted")
PLANAR, SPATIAL = "planar_slider_crank", "spatial_slider_crank"
REFERENCES = {PLANAR: ("crank.angle", 200.0), SPATIAL: ("flywheel.marker", 230.0)}
EMULATION = Emulation(seed=7)
MOUNTED = encoder_setup(EncoderSettings(7, "socketcand", options={"channel": "can0"}), 7, EMULATION)
MOUNTING = f"{360.0 * MOUNTED.offset_counts / MOUNTED.counts_per_revolution} deg"
ENCODER = f'[encoder]\nemulated = true\nmounting = "{MOUNTING}"\n[emulation]\nseed = 7\n'


def layout(path: Path) -> dict[str, dict[str, str]]:
    """Topics of samples with their metadata, of a sound log."""
    assert verify_log(path).sound
    with LogReader(path) as log:
        return {
            topic: metadata
            for topic, metadata in log.topic_metadata().items()
            if topic.startswith(("/measured/", "/predicted/"))
        }


@pytest.fixture(scope="module")
def planar_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on the emulated bench with a CAN encoder, on a rig that anybody can have again."""
    folder = tmp_path_factory.mktemp("planar")
    scenario = write_crank(folder / "scenario.toml", PLANAR, DURATION_S)
    (folder / "bench.toml").write_text(ENCODER)
    ended = rattle("run", scenario, "--bench", folder / "bench.toml", "--out", folder, deadline_s=DEADLINE_S)
    assert (ended.code, ended.err) == (0, "")
    return ended.log


@pytest.fixture(scope="module")
def spatial_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on the embedded bench, on whatever rig the day brings."""
    folder = tmp_path_factory.mktemp("spatial")
    scenario = write_crank(folder / "scenario.toml", SPATIAL, DURATION_S)
    ended = rattle("run", scenario, "--out", folder, deadline_s=DEADLINE_S)
    assert (ended.code, ended.err) == (0, "")
    return ended.log


@pytest.fixture(params=[PLANAR, pytest.param(SPATIAL, marks=pytest.mark.long)])
def rig_and_log(request: pytest.FixtureRequest) -> tuple[str, Path]:
    name = "planar_log" if request.param == PLANAR else "spatial_log"
    return request.param, request.getfixturevalue(name)


def test_every_channel_is_measured_and_predicted_over_the_same_samples(rig_and_log: tuple[str, Path]) -> None:
    rig, path = rig_and_log
    wanted = {name: RIGS[rig].channels.unit(name) for name in RIGS[rig].channels}
    assert verify_log(path).ledger_missing == 0
    with LogReader(path) as log:
        found: dict[tuple[str, str], list[SampleBlock]] = {}
        for origin, block in log.blocks():
            found.setdefault((origin, block.channel), []).append(block)
        for origin in ORIGINS:
            units = {name: channel.unit for name, channel in log.channels(origin).items()}
            assert {name: unit for name, unit in units.items() if name != "encoder.angle"} == wanted
            for name in wanted:
                blocks = found[origin, name]
                assert blocks[0].first_sample == 0
                assert all(before.end_sample == after.first_sample for before, after in pairwise(blocks))
                assert blocks[-1].end_sample == round(DURATION_S * 25_600)
                assert all(np.isfinite(block.values).all() for block in blocks)


def test_the_shaft_turns_as_the_scenario_wants_and_the_twin_with_it(rig_and_log: tuple[str, Path]) -> None:
    rig, path = rig_and_log
    reference, rpm = REFERENCES[rig]
    with LogReader(path) as log:
        measured, predicted = (log.series(origin, reference).values for origin in ORIGINS)
        codes = [event.code for event in log.events()]
    assert "twin.aligned" in codes
    assert "motor.trimmed" in codes
    times_s = np.arange(len(measured)) / 25_600
    if rig == PLANAR:
        speed = np.polyfit(times_s, measured, 1)[0]
        # both count 4096 a revolution; the twin's mean speed is fitted to the measured one
        assert np.abs(measured - predicted).max() < 3 * math.tau / 4096
    else:
        marks = np.flatnonzero(np.diff((measured > 2.5).astype(int)) == 1)
        speed = math.tau * (len(marks) - 1) / (times_s[marks[-1]] - times_s[marks[0]])
        twins = np.flatnonzero(np.diff((predicted > 2.5).astype(int)) == 1)
        # a mark rises within a sample, and noise of 0.02 V may move that by one
        assert np.abs(marks - twins[: len(marks)]).max() <= 2
    # half a step of the inverter is 0.0125 %, a marker's edge 1 in 20 000, the loop's own mean 0.02 %
    assert speed * 60.0 / math.tau == pytest.approx(rpm, rel=5e-4)


def test_the_emulated_rig_never_gives_the_twins_own_numbers(rig_and_log: tuple[str, Path]) -> None:
    _, path = rig_and_log
    with LogReader(path) as log:
        measured, predicted = log.table("measured"), log.table("predicted")
    for name in predicted:
        if name not in ("crank.angle", "encoder.angle", "crank.marker", "flywheel.marker"):
            # equal values come by chance alone, where a force is near zero and quantised
            assert np.mean(measured[name].values == predicted[name].values) < 0.01, name


def test_an_encoder_on_the_bus_shows_the_same_shaft_by_a_clock_of_its_own(planar_log: Path) -> None:
    with LogReader(planar_log) as log:
        assert log.channels("measured")["encoder.angle"].unit == "rad"
        predicted = log.series("predicted", "encoder.angle")
        encoder, card = log.series("measured", "encoder.angle"), log.series("measured", "crank.angle")
        devices = {clock.device for clock in log.clocks()}
    assert devices == {"host", "inverter", "encoder"}
    assert encoder.values.dtype == np.float64
    assert encoder.sample_rate == pytest.approx(1000.0, rel=1e-3)
    speed = np.polyfit(np.arange(len(encoder.values)), encoder.values, 1)[0] * encoder.sample_rate
    # the same speed by another clock, each 20 ppm off at most a few times, over some hundred counts of 4096
    assert speed == pytest.approx(
        np.polyfit(np.arange(len(card.values)), card.values, 1)[0] * 25_600, rel=2e-3
    )
    # as it is mounted, the prediction lies on it: but for what the bus delays, some 0.5 ms of 21 rad/s
    times_s = encoder.times_s() + (encoder.time_ns - predicted.time_ns) / 1e9
    within = (times_s > 0) & (times_s < len(predicted.values) / predicted.sample_rate - 1e-3)
    twin = np.interp(times_s, np.arange(len(predicted.values)) / predicted.sample_rate, predicted.values)
    apart = np.angle(np.exp(1j * (encoder.values - twin)))[within]
    assert np.abs(apart).max() < 0.04


@pytest.mark.long
def test_instruments_of_another_process_are_real_ones_and_give_the_same_layout(
    planar_log: Path, tmp_path: Path
) -> None:
    scenario = write_crank(tmp_path / "scenario.toml", PLANAR, DURATION_S)
    (tmp_path / "emulated.toml").write_text(ENCODER)
    with command("emulate", scenario, "--bench", tmp_path / "emulated.toml", "--json") as emulators:
        lines = [emulators.await_line("{")]
        while lines[-1] != "}":
            lines.append(emulators.await_line(""))
        addresses = json.loads("".join(lines))
        assert list(addresses) == ["inverter", "daq_card", "encoder"]
        places = (addresses[table][0] for table in addresses)
        bench = write_crank_bench(tmp_path / "real.toml", *places)
        with bench.open("a") as file:
            file.write(f'mounting = "{MOUNTING}"\n')
        ended = rattle("run", scenario, "--bench", bench, "--out", tmp_path, deadline_s=DEADLINE_S)
        servers = emulators.children()
        emulators.signal(signal.SIGINT)
        over = emulators.end()
    assert (ended.code, ended.err, over.code) == (0, "", 130)
    await_gone(servers)
    assert layout(ended.log) == layout(planar_log)
    with LogReader(ended.log) as log:
        assert "emulated" not in log.metadata["run"]


def test_the_twin_alone_gives_the_predicted_half_of_the_layout(
    rig_and_log: tuple[str, Path], tmp_path: Path
) -> None:
    rig, path = rig_and_log
    scenario = write_crank(tmp_path / "scenario.toml", rig, DURATION_S)
    alone = tmp_path / "twin.mcap"
    ended = rattle("predict", scenario, "--out", alone, deadline_s=DEADLINE_S)
    assert ended.code == 0, ended.err
    predicted = {topic: each for topic, each in layout(path).items() if topic.startswith("/predicted/")}
    predicted.pop("/predicted/encoder.angle", None)  # where that encoder is mounted says a bench alone
    assert layout(alone) == predicted

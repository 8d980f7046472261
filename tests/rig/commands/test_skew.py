"""`rattle skew`: an encoder that is late, told from how it is mounted by runs at two speeds."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.writer import LogWriter
from tests.rig.commands.cli import Call

RATE, PERIOD_S, COUNTS = 25_600.0, 1e-3, 65_536
START_NS = 1_790_000_000_000_000_000
MOUNTED_RAD = 0.8
COUNT_RAD = math.tau / COUNTS
MARKER = Channel("crank.marker", "V")
ANGLE = Channel("crank.angle", "rad")
ENCODER = Channel("encoder.angle", "rad", scale=COUNT_RAD, raw_unit="count")


def write(
    path: Path,
    rpm: float,
    skew_s: float,
    card: Channel = MARKER,
    chain: dict[str, object] | None = None,
    beside: float | None = None,
    seed: int | None = None,
    late_s: float = 0.0,
) -> Path:
    """A run at a speed: the card's channel, and an encoder that shows the angle of `skew_s` ago.

    `chain` is what the run says of the channel; `beside` is by how much the card's angle, recorded beside the
    marker, is off; `seed` is that of an emulated rig; the card's channel comes `late_s` too late.
    """
    seconds = 6.0
    omega = rpm * math.tau / 60.0
    card_rad = 0.3 + omega * (np.arange(round(seconds * RATE)) / RATE - late_s)
    noise = np.random.default_rng(round(rpm)).normal(scale=0.02, size=len(card_rad))
    values = {"crank.marker": 5.0 * (np.mod(card_rad, math.tau) < 0.09) + noise, "crank.angle": card_rad}
    shown = 0.3 + omega * (np.arange(0.0, seconds, PERIOD_S) - skew_s) + MOUNTED_RAD
    encoder = np.floor(shown / COUNT_RAD) * COUNT_RAD
    rows = [
        (card, RATE, values[card.name].astype(np.float64 if card is ANGLE else np.float32)),
        (ENCODER, 1 / PERIOD_S, encoder),
    ]
    if beside is not None:
        rows.append((ANGLE, RATE, card_rad + beside))
    with LogWriter(path) as log:
        if chain is not None:
            log.add_metadata("run", {f"chain.{card.name}": json.dumps(chain)})
        if seed is not None:
            log.add_metadata("run", {"emulation_seed": str(seed)})
        for channel, rate, row in rows:
            log.declare("measured", channel)
            size = round(0.1 * rate)
            for first in range(0, len(row), size):
                at_ns = sample_time_ns(START_NS, first, rate)
                block = SampleBlock(channel.name, first, at_ns, rate, row[first : first + size])
                log.add_block("measured", block, at_ns)
    return path


def test_emulated_rigs_that_were_drawn_apart_are_refused_together(call: Call, tmp_path: Path) -> None:
    one, other = (
        write(tmp_path / f"{rpm:g}-{seed}.mcap", rpm, 2e-3, seed=seed)
        for rpm, seed in ((103.0, 7), (251.0, 8))
    )
    answer = call("skew", one, other)
    assert answer.code == 1
    assert "not of one rig: 103-7.mcap (seed 7), 251-8.mcap (seed 8)" in answer.err
    assert call("skew", one, write(tmp_path / "same.mcap", 251.0, 2e-3, seed=7)).code == 0


@pytest.mark.parametrize("skew_s", [2e-3, -2e-3, 0.0])
@pytest.mark.parametrize("card", [MARKER, ANGLE], ids=["marker", "angle"])
def test_two_speeds_tell_a_skew_to_50_us_and_the_mounting(
    call: Call, tmp_path: Path, skew_s: float, card: Channel
) -> None:
    runs = [write(tmp_path / f"{rpm}.mcap", rpm, skew_s, card) for rpm in (103.0, 251.0)]
    found = json.loads(call("skew", *runs, "--json").out)
    assert found["skew_s"] == pytest.approx(skew_s, abs=50e-6)
    assert found["skew_uncertainty_s"] < 50e-6
    assert found["angle_rad"] == pytest.approx(MOUNTED_RAD, abs=1e-3)
    said = call("skew", *runs).out
    assert f"encoder late by {found['skew_s'] * 1e6:.1f}" in said
    assert "10 marks at 103.0" in said


LATE_S = 1e-3
DELAYED: tuple[dict[str, object], ...] = (
    {"delay_s": LATE_S},
    {"delay_s": LATE_S - 1 / (math.tau * 400.0), "filter": {"corner_hz": 400.0, "order": 1}},
)


@pytest.mark.parametrize("chain", DELAYED, ids=["input", "filter"])
def test_what_the_bench_says_that_a_marker_is_late_is_no_part_of_the_encoders_lag(
    call: Call, tmp_path: Path, chain: dict[str, object]
) -> None:
    runs = [write(tmp_path / f"{rpm}.mcap", rpm, 2e-3, chain=chain, late_s=LATE_S) for rpm in (103.0, 251.0)]
    found = json.loads(call("skew", *runs, "--json").out)
    assert found["skew_s"] == pytest.approx(2e-3, abs=50e-6)
    assert found["angle_rad"] == pytest.approx(MOUNTED_RAD, abs=1e-3)
    assert [each["mark_late_s"] for each in found["recordings"]] == [pytest.approx(LATE_S)] * 2
    assert "its marks 1000.0 us earlier than the card shows them" in call("skew", *runs).out


def test_one_speed_cannot_tell_and_says_so(call: Call, tmp_path: Path) -> None:
    answer = call("skew", write(tmp_path / "run.mcap", 200.0, 2e-3))
    assert answer.code == 0
    assert "cannot be told apart" in answer.out
    assert "record a second speed" in answer.out


def test_an_angle_whose_zero_is_anywhere_is_refused(call: Call, tmp_path: Path) -> None:
    run = write(tmp_path / "run.mcap", 200.0, 2e-3, ANGLE, chain={"pulses": {"index": False}})
    answer = call("skew", run)
    assert answer.code == 1
    assert "crank.angle cannot tell where the encoder stands" in answer.err


def test_the_mark_is_believed_before_an_angle_that_began_anywhere(call: Call, tmp_path: Path) -> None:
    runs = [write(tmp_path / f"{rpm}.mcap", rpm, 2e-3, MARKER, beside=rpm / 100.0) for rpm in (103.0, 251.0)]
    found = json.loads(call("skew", *runs, "--json").out)
    assert found["skew_s"] == pytest.approx(2e-3, abs=50e-6)


def test_a_run_without_the_encoder_is_refused(call: Call, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap") as log:
        log.declare("measured", MARKER)
        log.add_block("measured", SampleBlock("crank.marker", 0, START_NS, RATE, np.zeros(10)), START_NS)
    answer = call("skew", tmp_path / "run.mcap")
    assert answer.code == 1
    assert "no encoder.angle in it" in answer.err


def test_no_mark_of_a_long_log_is_forgotten(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.session.shaft_speed._MOST_MARKS", 5)
    runs = [write(tmp_path / f"{rpm}.mcap", rpm, 2e-3) for rpm in (103.0, 251.0)]
    found = json.loads(call("skew", *runs, "--json").out)
    assert [each["revolutions"] for each in found["recordings"]] == [10, 25]

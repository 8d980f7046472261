"""Dwells on the emulated bench: an encoder's lag told from its mounting, checked by another instrument."""

from __future__ import annotations

import json
import math
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.block import NS_PER_S
from daq.log.reader import LogReader
from daq.log.recover import verify_log
from tests.end_to_end.command import command, rattle
from tests.end_to_end.files import write_crank

pytestmark = [pytest.mark.long, pytest.mark.timeout(400)]
DEADLINE_S = 300.0
LAG_S = 2e-3
FASTEST_S = 1e-3
"""From one program to another over a socket; 0.3 to 0.4 ms on an idle machine, more on a busy one."""
RPM = (60.0, 280.0)
BENCH = '[encoder]\nemulated = true\n[emulation]\nseed = 7\nencoder_lag = "2 ms"\n'


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("dwells"))


def record(folder: Path) -> Path:
    ended = rattle(*arguments(folder), deadline_s=DEADLINE_S)
    assert (ended.code, ended.err) == (0, "")
    return ended.log


def arguments(folder: Path) -> tuple[object, ...]:
    scenario = write_crank(folder / "scenario.toml", "planar_slider_crank")
    (folder / "bench.toml").write_text(BENCH)
    speeds = ", ".join(f"{rpm:g} rpm" for rpm in RPM)
    return "dwell", scenario, "--speeds", speeds, "--bench", folder / "bench.toml", "--out", folder


@pytest.fixture(scope="module")
def found(log: Path) -> dict[str, Any]:
    ended = rattle("skew", log, "--json")
    assert ended.code == 0
    told: dict[str, Any] = json.loads(ended.out)
    return told


def test_the_shaft_dwells_at_each_speed_and_everything_is_recorded(log: Path) -> None:
    assert verify_log(log).sound
    assert verify_log(log).ledger_missing == 0
    with LogReader(log) as reader:
        card = reader.series("measured", "crank.angle")
        events = [event for event in reader.events() if event.code.startswith("dwell.")]
        start_ns = next(block.time_ns for _, block in reader.blocks("measured", ["crank.angle"]))
        assert not reader.channels("predicted")
        assert reader.metadata["run"]["dwells"] == "60, 280 rpm, 8 s each"
    assert [event.code for event in events] == ["dwell.start", "dwell.end"] * 2
    times_s = np.arange(len(card.values)) / card.sample_rate
    for rpm, begun, ended in zip(RPM, events[::2], events[1::2], strict=True):
        at_s = [(event.time_ns - start_ns) / NS_PER_S for event in (begun, ended)]
        assert at_s[1] - at_s[0] == pytest.approx(8.0, abs=0.5)
        low, high = np.searchsorted(times_s, [at_s[0] + 0.2, at_s[1] - 0.2])
        speed = np.polyfit(times_s[low:high], card.values[low:high], 1)[0]
        # half a step of the inverter is 0.04 % of 60 rpm; a mean over no whole number of turns does the rest
        assert speed * 60.0 / math.tau == pytest.approx(rpm, rel=5e-3)


def test_the_skew_is_known_to_50_us_and_the_counter_on_the_card_agrees(
    log: Path, found: dict[str, Any]
) -> None:
    (here,) = found["recordings"]
    assert here["skew_uncertainty_s"] < 50e-6
    with LogReader(log) as reader:
        card = reader.series("measured", "crank.angle")
        blocks = [block for _, block in reader.blocks("measured", ["encoder.angle"])]
    card_s = np.arange(len(card.values)) / card.sample_rate
    index = np.concatenate([block.first_sample + np.arange(len(block)) for block in blocks])
    times_s = here["first_s"] + index * here["period_s"]
    shown = np.concatenate([block.values for block in blocks])
    apart = shown - found["angle_rad"] - np.interp(times_s, card_s, card.values)
    apart = np.mod(apart + math.pi, math.tau) - math.pi
    slow, fast = (apart[(times_s > low) & (times_s < low + 5.0)].mean() for low in (2.0, times_s[-1] - 6.0))
    # two encoders of 4096 counts differ by up to a count, alike at every speed; the skew would not
    assert abs(fast - slow) < 50e-6 * (RPM[1] - RPM[0]) * math.tau / 60.0
    assert abs(slow) < 2 * math.tau / 4096


def test_the_seeded_lag_is_found(found: dict[str, Any]) -> None:
    """With what the fastest frame took; tests/rig/session/test_encoder_skew.py has all clocks in hand."""
    assert -found["skew_uncertainty_s"] < found["skew_s"] - LAG_S < found["skew_uncertainty_s"] + FASTEST_S
    assert found["skew_uncertainty_s"] < 1.5e-3


def test_the_card_s_stamp_joins_the_clocks(log: Path) -> None:
    """Half of what the call to start it took would be 0.4 ms and more."""
    with LogReader(log) as reader:
        assert "clock.stamp_ignored" not in {event.code for event in reader.events()}
        assert min(each.uncertainty_s for each in reader.clocks() if each.device == "encoder") < 0.35e-3


def test_an_interrupted_dwell_leaves_a_motor_at_rest_and_a_sound_log(tmp_path: Path) -> None:
    with command(*arguments(tmp_path)) as dwell:
        dwell.await_line("dwell 2 of 2")
        dwell.signal(signal.SIGINT)
        ended = dwell.end(DEADLINE_S)
    assert ended.code == 130
    assert verify_log(ended.log).sound
    with LogReader(ended.log) as reader:
        codes = [event.code for event in reader.events()]
    assert codes[-1] == "inverter.off"
    assert "run.interrupted" in codes
    assert "speed.abort" not in codes  # the ramp down is no runaway

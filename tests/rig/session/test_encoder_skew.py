"""A lag of 2 ms from the encoder's frames through record and log to the answer, with all clocks in hand."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.writer import LogWriter
from drivers.protocols.encoder import PositionBlock
from rig.session.encoder_record import encoder_channel
from tests.rig.commands.cli import caller
from tests.rig.session.test_encoder_record import COUNTS, PERIOD_S, Lab, SteppedEncoder

RATE = 25_600.0
LAG_S = 2e-3
MOUNTED_RAD = 1.3
DWELL_S = 8.0
SPEEDS = (60.0 * math.tau / 60.0, 280.0 * math.tau / 60.0)


def angle(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of a shaft that turns at one speed, then at the other."""
    return np.where(
        time_s < DWELL_S, SPEEDS[0] * time_s, SPEEDS[0] * DWELL_S + SPEEDS[1] * (time_s - DWELL_S)
    )


class LateEncoder(SteppedEncoder):
    """Its timer 20 ppm slow, its stamps 15 ppm slow and jittered, its frames up to some ms on their way."""

    def __init__(self, lag_s: float) -> None:
        super().__init__(frozenset(), angle)
        self._lag_s, self._random = lag_s, np.random.default_rng(3)

    def read(self, count: int) -> PositionBlock:
        assert self._allowed.acquire(timeout=10)
        number = np.arange(self._next, self._next + count)
        self._next += count
        taken = number * PERIOD_S * (1.0 + 20e-6)
        turned = angle(taken - self._lag_s) + MOUNTED_RAD
        counts = np.floor(turned / math.tau * COUNTS).astype(np.int64) % COUNTS
        stamp = 5e5 + taken * (1.0 - 15e-6) + self._random.uniform(0.0, 20e-6, count)
        arrival = self._zero_s + taken + self._random.exponential(1e-3, count)
        return PositionBlock(number, arrival, stamp, counts)


def recorded(log: Path, lag_s: float) -> Path:
    lab = Lab(encoder=LateEncoder(lag_s))
    blocks = lab.recorded(0.3, 2 * DWELL_S - 0.5, 158)
    card_s = np.arange(round(2 * DWELL_S * RATE)) / RATE
    marker = (5.0 * (np.mod(angle(card_s), math.tau) < 0.09)).astype(np.float32)
    with LogWriter(log) as writer:
        writer.declare("measured", Channel("crank.marker", "V"))
        writer.declare("measured", encoder_channel(lab.encoder))
        for first in range(0, len(marker), 2560):
            at_ns = sample_time_ns(lab.base.start_ns, first, RATE)
            block = SampleBlock("crank.marker", first, at_ns, RATE, marker[first : first + 2560])
            writer.add_block("measured", block, at_ns)
        for block in blocks:
            writer.add_block("measured", block, block.time_ns)
        for record in lab.record.clocks(at_last=True):
            writer.add_clock(record)
    return log


def test_a_lag_of_2_ms_is_found_to_50_us_and_told_from_the_mounting(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """What frames are late on their way, some ms, no log can tell from a lag: both logs have it alike."""
    skews = []
    for lag_s in (0.0, LAG_S):
        log = recorded(tmp_path / f"{lag_s}.mcap", lag_s)
        found = json.loads(caller(monkeypatch, capfd)("skew", log, "--json").out)
        (here,) = found["recordings"]
        assert here["skew_uncertainty_s"] < 50e-6
        assert found["angle_rad"] == pytest.approx(MOUNTED_RAD, abs=1.5e-3)  # half a count, 30 us at 18 rad/s
        # with the skew taken out, its positions lie where the shaft stood so
        number = round((here["first_s"] + lag_s) / PERIOD_S)
        stood_s = number * PERIOD_S * (1.0 + 20e-6) - lag_s
        assert here["first_s"] == pytest.approx(stood_s, abs=100e-6)
        assert here["period_s"] == pytest.approx(PERIOD_S * (1.0 + 20e-6), rel=1e-5)
        skews.append(here["skew_s"])
    assert skews[1] - skews[0] == pytest.approx(LAG_S, abs=50e-6)

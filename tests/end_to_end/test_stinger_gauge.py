"""A whole run with a force gauge between shaker and beam, which the bench declares."""

from __future__ import annotations

import cmath
from pathlib import Path

import numpy as np
import pytest

from daq.log.reader import LogReader, Origin
from rig.derived.settings import from_record
from tests.end_to_end.command import rattle
from tests.end_to_end.files import write_bench, write_scenario

SHAKER = """
[model]
shaker_mass = "80 g"
shaker_stiffness = "3000 N/m"
shaker_damping = "25 N s/m"
"""
ORDERED_N, HZ, RATE = 9.0, 20.0, 51_200.0


def sine(log: LogReader, origin: Origin) -> complex:
    """Amplitude and phase of what the gauge shows at the drive's frequency."""
    shown = log.series(origin, "drive.force")
    at = np.arange(shown.first_sample, shown.end_sample)
    return complex(2j * np.mean(shown.values * np.exp(-2j * np.pi * HZ / RATE * at)))


@pytest.mark.long
@pytest.mark.timeout(200)
def test_what_the_gauge_shows_lies_over_its_prediction(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "s.toml", settle_s=1.0, duration_s=4.0, limits=SHAKER)
    bench = write_bench(tmp_path / "bench.toml", emulation="[emulation]\nseed = 7")
    own = 'name = "drive.force"\n'
    assert own in bench.read_text()
    bench.write_text(bench.read_text().replace(own, f'{own}senses = "stinger"\n'))
    ended = rattle("run", scenario, "--bench", bench, "--out", tmp_path)
    assert ended.code == 0, ended.err
    with LogReader(ended.log) as log:
        measured, predicted = sine(log, "measured"), sine(log, "predicted")
        largest = {
            origin: float(np.abs(log.series(origin, "drive.force").values).max())
            for origin in ("measured", "predicted")
        }
        settled = from_record(log.metadata["derived"])
    # a healthy drive is off by 1 %, of one deviation; what chatters adds as much over 80 cycles
    assert abs(measured) == pytest.approx(abs(predicted), rel=0.06)
    assert cmath.phase(measured / predicted) == pytest.approx(0.0, abs=np.deg2rad(2))
    assert settled["measured"].cycle_hz == pytest.approx(HZ, rel=1e-3)
    assert "cannot be followed" not in ended.log.with_suffix(".html").read_text(encoding="utf-8")
    # the coil's own would be 9 N and no more: the gauge feels the impacts
    assert min(largest.values()) > 2 * ORDERED_N

"""What Deck and Dubowsky saw (seed 000 section 4), in short; the long versions are in the benchmarks.

The motion is chaotic once anything strikes: what is said of it holds for several starts together, and for
speeds that lie apart from the onset at 147 to 151 rpm, where start and last bit decide.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from sim_twin.mechanisms.simulation import Trace
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank, rig_of_the_figures
from sim_twin.rigs.spatial_slider_crank.motion import simulation

RIG = rig_of_the_figures()
VERTICAL = [2, 3, 6, 7]
IMPACT = 0.01
"""m/s; slower onsets are the ripple of a surface that is about to part."""
PER_TURN = 8192
STARTS, SIX_STARTS = (0.0, 2.0, 4.0), (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
"""Crank angles from which it sets out, rad."""


def turns(rig: SpatialSliderCrank, rpm: float, count: int, settle: int = 6, start: float = 0.0) -> Trace:
    motion = simulation(rig, SpeedDrive(rpm * 2 * pi / 60), start, 60 / rpm / PER_TURN)
    motion.advance(settle * PER_TURN)
    return motion.advance(count * PER_TURN)


def impacts_a_turn(
    rig: SpatialSliderCrank, rpm: float, count: int = 6, starts: tuple[float, ...] = STARTS
) -> list[float]:
    """Of each start, once 16 turns have passed."""
    return [impacts(turns(rig, rpm, count, settle=16, start=start)) / count for start in starts]


def impacts(trace: Trace) -> int:
    hits = trace.episodes
    return int(np.count_nonzero(np.isin(hits[:, 1], VERTICAL) & (hits[:, 2] >= IMPACT)))


def cycle_peaks(trace: Trace, point: int) -> np.ndarray:
    return trace.outputs[point].reshape(-1, PER_TURN).max(axis=1)


@pytest.mark.long
@pytest.mark.parametrize("rpm", [130, 144])
def test_no_start_gives_impacts_well_below_150_rpm(rpm: float) -> None:
    assert max(impacts_a_turn(RIG, rpm)) == 0


@pytest.mark.long
@pytest.mark.parametrize("rpm", [156, 200])
def test_every_start_gives_many_a_turn_well_above_150_rpm(rpm: float) -> None:
    # 27 to 60 in 18 starts on three processors
    assert min(impacts_a_turn(RIG, rpm, 4)) > 10


def test_at_230_rpm_peaks_vary_as_in_the_source() -> None:
    # Source: 27 to 80 N in 38 cycles at a vertical sensor that it does not name. The ends of the range of so
    # few scatter and now and then a cycle has hardly a peak, so eight cycles in ten are compared, as
    # the median over starts: from six starts 41 to 54 N and 72 to 90 N.
    each = [cycle_peaks(turns(RIG, 230, 12, start=start), 7) for start in STARTS]
    low, high = np.median([np.quantile(peaks, [0.1, 0.9]) for peaks in each], axis=0)
    assert 27.0 < low < 2.2 * 27.0, "a tenth above the largest of six starts"
    assert high == pytest.approx(80.0, rel=0.2)
    assert high > 1.3 * low, "or they would be regular: 1.5 to 2.0 from six starts"


def test_without_impacts_peaks_repeat() -> None:
    peaks = cycle_peaks(turns(RIG, 110, 5), 2)
    assert np.ptp(peaks) < 0.05 * peaks.mean()
    assert peaks.mean() > 1.0


@pytest.mark.long
def test_without_friction_most_starts_give_no_impacts_at_150_rpm() -> None:
    # At 150 rpm 0.5 to 2.8 a turn from all of six starts, and none from any without friction. Further from
    # the onset both strike (at 152 rpm 15 to 24 a turn, and 0.5 to 4): hence the share of starts.
    smooth = replace(RIG, friction=0.0)
    struck = [np.count_nonzero(impacts_a_turn(rig, 150, starts=SIX_STARTS)) for rig in (RIG, smooth)]
    assert struck[0] >= 4, "two starts in three"
    assert struck[1] <= 2, "one start in three"


def test_half_a_nanometre_changes_the_times_of_impact() -> None:
    moved = replace(RIG, contact_span=RIG.contact_span + 5e-10)
    one, other = (turns(rig, 230, 2, settle=0).episodes for rig in (RIG, moved))
    n = min(len(one), len(other))
    assert np.abs(one[:n, 0] - other[:n, 0]).max() > 1e-3
    # The very first contact knows nothing of it yet.
    assert one[0, 0] == pytest.approx(other[0, 0], abs=1e-9)


@pytest.mark.parametrize("change", [{"guide_clearance": 0.5e-3, "socket_clearance": 0.5e-3}])
def test_force_rises_with_speed_and_clearance(change: dict[str, float]) -> None:
    peak = {rpm: cycle_peaks(turns(RIG, rpm, 8), 2).mean() for rpm in (110, 170, 230)}
    assert peak[110] < peak[170] < peak[230]
    assert cycle_peaks(turns(replace(RIG, **change), 230, 8), 2).mean() > peak[230]

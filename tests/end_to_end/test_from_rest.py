"""From rest, before chaos acts, measured and predicted waveforms can be laid over each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.log.reader import LogReader, Origin
from rig.session.run import PRE_TRIGGER_S

# Tolerances: 300 healthy draws of physics.md section 5 (sim_twin.healthy) with their noise, through the
# sensor chain, against the nominal twin: the first sampled peak varies by 2.5 % (one sigma; drive 1 %,
# clearance 2 %, stiffness 5 % and gain 0.5 % make most of it) and is 1.3 % high, for noise only adds to a
# maximum; the first contact varies by 32 us. Four sigma and the bias; the sample raster adds 20 us.
PEAK_SHARE = 0.12
CONTACT_S = 4 * 32e-6 + 20e-6
TOUCHED_N = 1.0


def first_impact(force: NDArray[np.floating], rate: float) -> tuple[float, float]:
    """Time of the first contact in s since sample 0, and its peak in N."""
    begin = int(np.argmax(force > TOUCHED_N))
    end = begin + int(np.argmax(force[begin:] < TOUCHED_N / 2))
    return begin / rate, float(force[begin:end].max())


def test_first_impacts_overlay_within_the_healthy_tolerances(rest_log: Path) -> None:
    origins: tuple[Origin, Origin] = ("measured", "predicted")
    with LogReader(rest_log) as log:
        forces = [log.series(origin, "contact.force_upper") for origin in origins]
    (measured_s, measured_n), (predicted_s, predicted_n) = (
        first_impact(force.values, force.sample_rate) for force in forces
    )
    assert measured_n == pytest.approx(predicted_n, rel=PEAK_SHARE)
    assert measured_s == pytest.approx(predicted_s, abs=CONTACT_S)


def test_twin_meets_the_stop_as_late_after_the_drives_onset_as_physics_says(rest_log: Path) -> None:
    with LogReader(rest_log) as log:
        drive = log.series("predicted", "drive.force")
        upper = log.series("predicted", "contact.force_upper")
    onset_s = int(np.argmax(np.abs(drive.values) > 0.01)) / drive.sample_rate
    contact_s, peak_n = first_impact(upper.values, upper.sample_rate)
    # physics.md: 4.4826 ms and 28.895 N; the threshold and the raster cost a sample or two; the channel's
    # filter and the raster take up to 5 % of a peak that is some five samples wide.
    assert contact_s - onset_s == pytest.approx(4.4826e-3, abs=60e-6)
    assert peak_n == pytest.approx(28.895, rel=0.05)


def test_record_shows_the_rest_before_the_drive(rest_log: Path) -> None:
    with LogReader(rest_log) as log:
        before = log.table("measured", end_s=PRE_TRIGGER_S)
        events = [event.code for event in log.events()]
    # Seven sigma of their noise, 0.02 N and 0.05 N: one of 2,560 samples is above five in one run of 700.
    assert np.abs(before["drive.force"].values).max() < 0.14
    assert np.abs(before["contact.force_upper"].values).max() < 0.35
    assert "drive.not_seen" not in events

"""What the source saw, on the blind check's spatial crank; and its figures beside the twin's."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.blind.spatial.engine import SOCKET
from benchmarks.blind.spatial.mechanism import Motion, moved
from benchmarks.blind.spatial.rig import Friction, Spatial
from sim_twin.mechanisms.run import CONTACT, ONSET
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.kernel import SLIDER_SPEED_ROW
from sim_twin.rigs.spatial_slider_crank.model import rig_of_the_figures
from sim_twin.rigs.spatial_slider_crank.motion import simulation

Array = NDArray[np.float64]
VERTICAL = (2, 3, 6, 7)
RATE, EACH = 51_200, 4
NAMES = ("peak socket", "peak guide", "rms socket", "rms 3", "mean socket", "mean 3", "rms acceleration",
         "onsets socket", "onsets guide")  # fmt: skip
TURNS, SETTLE = 24, 4
pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]


def figures(rpm: float) -> Spatial:
    return Spatial(rpm * pi / 30, axis_angle=65 * pi / 180)


def turn(rpm: float) -> int:
    return round(60 / rpm * RATE)


@cache
def run(rig: Spatial, turns: int, start: float = 0.0) -> Motion:
    samples = turn(rig.speed * 30 / pi)
    return moved(rig, start, 2 * pi / rig.speed / samples / EACH, turns * samples, EACH)


def peaks(motion: Motion, rpm: float, settle: int) -> Array:
    """Of each contact in each turn after the first `settle`, N."""
    return motion.forces.reshape(9, -1, turn(rpm)).max(axis=2)[:, settle:]


def impacts(rig: Spatial, turns: int, settle: int) -> float:
    """A turn, at the vertical points, at 1 cm/s or more."""
    onsets = run(rig, turns).onsets
    late = onsets[onsets[:, 0] > settle * 2 * pi / rig.speed]
    return float(np.sum(np.isin(late[:, 1], VERTICAL) & (late[:, 2] >= 0.01)) / (turns - settle))


def test_impacts_in_the_guide_begin_between_150_and_200_rpm() -> None:
    # the twin's begin at 148 to 150
    assert impacts(figures(140), 14, 10) < 1
    assert impacts(figures(170), 8, 4) > 5


def test_peaks_at_230_rpm_vary_as_in_figure_16() -> None:
    found = peaks(run(figures(230), TURNS), 230, SETTLE)[list(VERTICAL)]
    low, high = found.min(axis=1), found.max(axis=1)
    # 27 to 80 N at one of them; half to twice of that, for a rig whose inertia and incline are not known
    assert np.any((low > 13.5) & (low < 54) & (high > 40) & (high < 160))


def test_peaks_repeat_where_there_are_no_impacts() -> None:
    still = np.ptp(peaks(run(figures(110), 10), 110, 5)[2])
    assert still < 0.05 * np.ptp(peaks(run(figures(230), TURNS), 230, SETTLE)[2])


def test_without_sliding_friction_there_are_no_impacts() -> None:
    # the twin's are 4 to 8 and, now and then one of 1.0 to 1.3 cm/s, 0.3
    rig = figures(151)
    assert impacts(rig, 20, 8) > 2
    assert impacts(replace(rig, friction=Friction(0.0)), 20, 8) < 1


def test_half_a_nanometre_changes_the_times_of_impact() -> None:
    rig = figures(230)
    one, other = (run(each, 4).onsets[:, 0] for each in (rig, replace(rig, span=rig.span + 5e-10)))
    n = min(len(one), len(other))
    assert np.abs(one[:n] - other[:n]).max() > 1e-4


def test_figures_are_the_twins_within_their_scatter() -> None:
    ours, theirs = (
        np.array([of(start) for start in (0.0, 2.0, 4.0)]) for of in (truth_figures, twin_figures)
    )
    spread = np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / 3)
    apart = np.abs(ours.mean(axis=0) - theirs.mean(axis=0))
    # of 20 turns each: four standard errors of means of three, which three alone know badly, and 2 %
    bound = np.maximum(4 * spread, 0.02 * np.abs(theirs.mean(axis=0)))
    assert dict(zip(NAMES, apart / bound, strict=True)) == {name: pytest.approx(0, abs=1) for name in NAMES}


def summary(forces: Array, speed: Array, contacts: Array) -> Array:
    samples = turn(230)
    after = forces.reshape(9, -1, samples)[:, SETTLE:]
    tops, turns = after.max(axis=2), after.shape[1]
    flat = after.reshape(9, -1)
    return np.array(
        [
            tops[SOCKET].mean(),
            tops[:SOCKET].max(axis=0).mean(),
            flat[SOCKET].std(),
            flat[2].std(),
            flat[SOCKET].mean(),
            flat[2].mean(),
            RATE * np.diff(speed[SETTLE * samples :]).std(),
            np.sum(contacts == SOCKET) / turns,
            np.sum(contacts != SOCKET) / turns,
        ]
    )


def truth_figures(start: float) -> Array:
    motion = run(figures(230), TURNS, start)
    late = motion.onsets[:, 0] > SETTLE * 60 / 230
    return summary(motion.forces, motion.slider_speed, motion.onsets[late, 1])


def twin_figures(start: float) -> Array:
    drive, samples = SpeedDrive(230 * pi / 30), turn(230)
    trace = simulation(rig_of_the_figures(), drive, start, 60 / 230 / samples).advance(TURNS * samples)
    late = trace.episodes[:, ONSET] > SETTLE * 60 / 230
    return summary(trace.outputs[:9], trace.outputs[SLIDER_SPEED_ROW], trace.episodes[late, CONTACT])

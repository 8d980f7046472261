"""Which channel comes nearest to the end of its range."""

from __future__ import annotations

import numpy as np

from daq.block import Flag
from drivers.protocols.card import CardReading
from rig.bounds import Bounds, nearest
from rig.session.levels import Levels

NAMES = ("drive.force", "motor.angle", "contact.force")


def reading(*rows: list[float]) -> CardReading:
    return CardReading(0, np.array(rows), (Flag.GOOD,) * len(rows), 0.0)


def test_the_worst_is_told_by_its_share_since_the_record_began() -> None:
    levels = Levels(NAMES, {"drive.force": Bounds(20.0), "contact.force": Bounds(200.0)})
    levels.take(reading([5.0, -11.0], [900.0, 901.0], [20.0, 30.0]))
    assert levels.worst() == "drive.force at 55 % of its range"
    levels.take(reading([1.0, 1.0], [902.0, 903.0], [np.nan, -190.0]))
    assert (
        levels.worst() == "contact.force at 95 % of its range"
    )  # what is no number hides no level beside it
    levels.begin()
    levels.take(reading([1.0, 1.0], [902.0, 903.0], [np.nan, np.nan]))
    assert levels.worst() == "drive.force at 5 % of its range"


def test_what_ends_the_run_counts_rather_than_the_range() -> None:
    bounds = {"drive.force": Bounds(20.0), "contact.force": Bounds(200.0, warning=20.0, abort=40.0)}
    levels = Levels(NAMES, bounds)
    levels.take(reading([11.0, 0.0], [0.0, 0.0], [30.0, -10.0]))
    assert levels.worst() == "contact.force at 75 % of its limit"


def test_where_no_channel_has_a_range_nothing_is_said() -> None:
    levels = Levels(NAMES, {})
    levels.take(reading([1.0], [2.0], [3.0]))
    assert levels.worst() == ""


def test_a_marker_is_never_the_nearest_unless_it_has_a_limit() -> None:
    """It always reaches its level, and would hide what a person watches."""
    levels = {"crank.marker": 4.9, "slider.force_1": 3.0}
    bounds = {"crank.marker": Bounds(5.0), "slider.force_1": Bounds(100.0)}
    assert nearest(levels, bounds) == "slider.force_1"
    assert nearest(levels, {**bounds, "crank.marker": Bounds(5.0, None, 5.0)}) == "crank.marker"

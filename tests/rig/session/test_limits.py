"""A limit counts once it has been passed for its hold time, is told once, and rearms."""

from __future__ import annotations

import numpy as np
import pytest

from daq.block import Flag
from rig.files.scenario import Limit
from rig.session.interlock import LimitWatch

RATE = 1000.0
NAME = "contact.force_upper"


def watch(warning: float | None = 10.0, abort: float | None = 20.0, hold: float = 0.0) -> LimitWatch:
    return LimitWatch([Limit(NAME, "N", warning, abort, hold)], RATE)


def told(limits: LimitWatch, *values: float) -> list[tuple[float, bool]]:
    return [(each.level, each.abort) for each in limits.check({NAME: np.array(values)})]


def test_within_its_limits_nothing_is_told() -> None:
    assert told(watch(), 0, 9.99, -9.99) == []


def test_warning_and_abort_are_told_with_value_and_level() -> None:
    (warning, abort) = watch().check({NAME: np.array([1.0, -25.0, 2.0])})
    assert str(warning) == f"{NAME} = 25 N, warning at 10 N"
    assert (abort.abort, abort.value, abort.level) == (True, 25.0, 20.0)


def test_a_warning_is_told_once_until_the_channel_has_come_back() -> None:
    limits = watch(abort=None)
    assert told(limits, 11, 11) == [(10, False)]
    assert told(limits, 12, 0, 13) == []
    assert told(limits, 0, 0) == []
    assert told(limits, 0, 11) == [(10, False)]


def test_what_is_below_the_hold_time_counts_for_nothing() -> None:
    limits = watch(abort=None, hold=0.004)
    assert told(limits, 11, 11, 11, 0, 11, 11, 11) == []


def test_a_hold_time_runs_on_over_blocks() -> None:
    limits = watch(abort=None, hold=0.004)
    assert told(limits, 0, 11, 11) == []
    assert told(limits, 11) == []
    assert told(limits, 11, 0) == [(10, False)]


def test_what_the_last_block_told_of_is_not_told_again() -> None:
    limits = watch(abort=None, hold=0.004)
    assert told(limits, 11, 11, 11, 11) == [(10, False)]
    assert told(limits, 0, 0, 0, 0) == []


def test_an_abort_is_told_even_when_the_warning_was() -> None:
    limits = watch()
    assert told(limits, 11) == [(10, False)]
    assert told(limits, 21) == [(20, True)]


def test_an_abort_that_chatters_is_told_once_for_good() -> None:
    """So that a hysteresis would mean nothing: what stops a run is latched."""
    limits = watch(warning=None)
    assert [event for _ in range(50) for event in told(limits, 0, 21, 19, 21) + told(limits, 0, 0)] == [
        (20, True)
    ]


@pytest.mark.parametrize("beyond", [[11, np.nan, 11, 11], [np.nan] * 4])
def test_no_number_is_beyond_no_limit_and_breaks_a_hold(beyond: list[float]) -> None:
    assert told(watch(abort=None, hold=0.004), *beyond) == []


def test_a_level_passed_beside_missing_numbers_is_told() -> None:
    assert told(watch(), np.nan, 11, np.nan) == [(10, False)]


@pytest.mark.parametrize("flag", [Flag.OVERLOAD, Flag.OPEN_SENSOR, Flag.NOT_FINITE])
def test_a_channel_that_cannot_be_watched_counts_as_passed(flag: Flag) -> None:
    (passed,) = watch().check({NAME: np.zeros(10)}, {NAME: flag})
    assert passed.abort
    assert "cannot be watched" in str(passed)


def test_a_bad_sensor_with_a_warning_level_alone_does_not_stop_the_rig() -> None:
    assert watch(abort=None).check({NAME: np.zeros(10)}, {NAME: Flag.OVERLOAD}) == []

"""Who waits for a computation goes on looking."""

from __future__ import annotations

import threading

import pytest

from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import InterlockTripped
from rig.session.acquisition import Acquisition
from rig.session.interlock import LimitWatch
from rig.session.watch import Watch
from rig.stream import Stream
from tests.rig.session.fakes import RATE, SteppedCard


@pytest.fixture
def acquisition() -> Acquisition:
    """One that nobody starts: a computation is over before it is missed."""
    return Acquisition(SteppedCard((Channel("a", "N"),)), SystemClock(), Stream(), LimitWatch((), RATE))


def test_meanwhile_all_is_looked_at(acquisition: Acquisition) -> None:
    watch, looked = Watch(SystemClock()), threading.Event()
    watch.checks.append(looked.set)
    assert watch.meanwhile(acquisition, lambda: looked.wait(10.0)) is True


def test_what_a_computation_raises_is_raised_where_it_is_waited_for(acquisition: Acquisition) -> None:
    def failing() -> None:
        raise ValueError("no sine")

    with pytest.raises(ValueError, match="no sine"):
        Watch(SystemClock()).meanwhile(acquisition, failing)


def test_what_ends_the_run_meanwhile_is_not_kept_waiting(acquisition: Acquisition) -> None:
    watch, goes_on = Watch(SystemClock()), threading.Event()

    def trip() -> None:
        raise InterlockTripped("interlock: too much")

    watch.checks.append(trip)
    try:
        with pytest.raises(InterlockTripped, match="too much"):
            watch.meanwhile(acquisition, lambda: goes_on.wait(10.0))
    finally:
        goes_on.set()

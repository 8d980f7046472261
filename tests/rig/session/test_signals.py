"""A signal is a request that is looked at, and the handlers of before come back."""

from __future__ import annotations

import os
import signal
import time

import pytest

from rig.session.signals import Stopped, StopRequest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_only_asks_and_counts_once_where_it_comes_as_several(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with StopRequest() as stop:
        stop.check()
        for _ in range(10):
            os.kill(os.getpid(), number)
        assert stop.wanted
        assert stop.asked == 1
        time.sleep(0.35)  # as soon as a person may ask again
        os.kill(os.getpid(), number)
        assert stop.asked == 2
        with pytest.raises(Stopped, match="stopped by a person"):
            stop.check()
    assert signal.getsignal(number) is before


def test_who_keeps_asking_is_heard_again_however_fast() -> None:
    with StopRequest() as stop:
        for _ in range(5):  # as fast as a finger
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)
        assert stop.asked == 5


def test_two_signals_at_once_are_one_wish() -> None:
    with StopRequest() as stop:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)  # whoever started the run passes it on in its own words
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.asked == 1


def test_what_waits_where_nobody_looks_ends_at_once_and_its_end_is_left_alone() -> None:
    told: list[str] = []

    def wait(stop: StopRequest) -> None:
        with stop.at_once():
            try:
                os.kill(os.getpid(), signal.SIGTERM)
                raise AssertionError("went on")
            finally:
                time.sleep(0.35)  # as soon as a person may ask again
                os.kill(os.getpid(), signal.SIGTERM)
                told.append("ended")

    with StopRequest() as stop:
        with pytest.raises(Stopped, match="stopped by a person"):
            wait(stop)
        time.sleep(0.35)
        os.kill(os.getpid(), signal.SIGTERM)
    assert (told, stop.asked) == (["ended"], 3)

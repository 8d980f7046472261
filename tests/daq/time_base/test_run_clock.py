"""The run's time goes on evenly while the wall clock is set, stops or leaps."""

from __future__ import annotations

import pytest

from daq.time_base.run_clock import RunClock

START_NS = 1_800_000_000_000_000_000


class Host:
    """A host's two clocks, moved by hand."""

    def __init__(self) -> None:
        self.wall_ns, self.now_s = START_NS, 100.0

    def unix_ns(self) -> int:
        return self.wall_ns

    def monotonic_s(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.pass_(seconds)

    def pass_(self, seconds: float) -> None:
        self.now_s += seconds
        self.wall_ns += round(seconds * 1e9)


@pytest.mark.parametrize("step_s", [-3600, -1, 1, 3600])  # a leap second is -1
def test_a_step_of_the_wall_clock_is_reported_once_and_moves_nothing(step_s: int) -> None:
    host = Host()
    clock = RunClock(host)
    clock.sleep(1.0)
    assert clock.look() is None
    host.wall_ns += step_s * 10**9
    clock.sleep(0.75)
    event = clock.look()
    assert event is not None
    assert event.code == "clock.wall_step"
    assert f"{step_s:+.3f} s" in event.text
    assert event.time_ns == clock.unix_ns() == START_NS + 1_750_000_000
    clock.sleep(0.25)
    assert clock.look() is None
    assert clock.unix_ns() == START_NS + 2 * 10**9


def test_the_event_gives_both_times() -> None:
    host = Host()
    clock = RunClock(host)
    host.wall_ns += 3600 * 10**9
    event = clock.look()
    assert event is not None
    assert "it reads 2027-01-15T09:00:00.000Z, the run's time is 2027-01-15T08:00:00.000Z" in event.text


def test_a_wall_clock_that_stops_is_reported_once_and_again_when_it_is_set() -> None:
    host = Host()
    clock = RunClock(host)
    clock.look()
    codes = []
    for _ in range(5):
        host.now_s += 1.0
        event = clock.look()
        codes.append(event.code if event else None)
    assert codes == ["clock.wall_stopped", None, None, None, None]
    assert clock.unix_ns() == START_NS + 5 * 10**9
    host.pass_(1.0)
    event = clock.look()
    assert event is not None
    assert "stepped by -5.000 s" in event.text


def test_slewing_is_no_step() -> None:
    host = Host()
    clock = RunClock(host)
    for _ in range(20):
        host.pass_(1.0)
        host.wall_ns += 500_000  # 500 ppm, the most that a time service slews by
        assert clock.look() is None

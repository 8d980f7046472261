"""How the wall clock stands against the monotonic one, on a machine that may be held up between two looks."""

from __future__ import annotations

import pytest

from daq.clock import wall_less_monotonic_ns

AHEAD_NS = 1_800_000_000_000_000_000


class HeldUp:
    """Is away for 5 ms after each reading of the wall clock; after the third for a microsecond."""

    def __init__(self) -> None:
        self._now_ns, self._looks = 0, 0

    def unix_ns(self) -> int:
        told_ns = AHEAD_NS + self._now_ns
        self._looks += 1
        self._now_ns += 1_000 if self._looks == 3 else 5_000_000
        return told_ns

    def monotonic_s(self) -> float:
        return self._now_ns / 1e9

    def sleep(self, seconds: float) -> None:
        raise NotImplementedError


def test_the_quickest_look_counts() -> None:
    assert wall_less_monotonic_ns(HeldUp()) == pytest.approx(AHEAD_NS, abs=1_000)

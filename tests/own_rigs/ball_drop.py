"""A ball let go from a bridge and filmed: the twin falls freely; the drops of a ball are its blocks.

A fingerprint is the height over time less the free fall that fits it best, with an instant and a speed of its
own, since a video says neither when nor how a ball left the hand.

What healthy drops differ by, the same for every ball: the hand opens up to 0.2 s after the first frame (three
frames), at 0 +- 0.3 m/s; the scale of each video is known to 2 %, as the heights at which 22 videos of one
bridge begin (45.6 to 49.5 m) scatter by 2.2 %; a ball's place in the picture is right within 0.12 m that
change slowly (lens, camera's angle, depth) and 0.04 m from frame to frame (a pixel, a blurred ball).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.subject import Draw, Named, Observed
from tests.own_rigs.effects import cause, number, with_effects

Array = NDArray[np.float64]
_GRAVITY = 9.81
_TIMES = np.arange(41) / 15
"""s; the shortest record ends after 2.74 s."""
_PARTS = 8
_HOLD, _THROW, _SCALE = 0.2, 0.3, 0.02
_SLOW_ERROR, _QUICK_ERROR = 0.12, 0.04
_WAVES = 4
"""The slow error has up to so many half waves in a record."""


@dataclass(frozen=True, slots=True)
class Ball:
    """How a ball falls and is filmed; SI units.

    `gravity` is a factor: on it, on the height's scale, or on the clock's squared, which look alike. Drag
    grows with speed to the `power` and balances the weight at `terminal_speed`. `tilt` is by how much the
    picture's scale changes over 47 m; at `cut_at` the video misses `cut` seconds.
    """

    gravity: float = 1.0
    terminal_speed: float = np.inf
    power: float = 2.0
    tilt: float = 0.0
    cut: float = 0.0
    cut_at: float = 0.0


CAUSES = (
    cause("drag", "air", number("terminal_speed", "m/s", (8.0, 80.0)), number("power", "", (1.0, 2.0))),
    cause("scaled_gravity", "weight", number("gravity", "", (0.5, 0.94), (1.06, 1.5))),
    cause("tilted_camera", "height", number("tilt", "", (-0.3, -0.05), (0.05, 0.3))),
    cause("cut_video", "height", number("cut", "s", (0.06, 0.5)), number("cut_at", "s", (0.4, 2.4))),
)
"""What a sceptic may put in. Drag has the power 2 if its coefficient is the same at all speeds."""


@dataclass(frozen=True, slots=True)
class BallDrop:
    """The filmed fall of a ball as a subject of diagnosis."""

    @property
    def layout(self) -> Layout:
        """Height less free fall (m), in equal parts of the record."""
        ends = np.linspace(0, 1, _PARTS + 1).tolist()
        return Layout(tuple(Cell(0, "height", "bend", 1, phase=(a, b)) for a, b in pairwise(ends)))

    @property
    def causes(self) -> tuple[Cause, ...]:
        return CAUSES

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Let each ball fall as often as its draw has blocks."""
        return [tuple(_drops(draw, shown) for shown in draw.sensing) for draw in draws]


def fingerprint(times: Array, heights: Array) -> Array:
    """What is left of a drop (s, m) after the free fall that fits it best, mean of each part (m)."""
    bend = np.interp(_TIMES, times, heights) + 0.5 * _GRAVITY * _TIMES**2
    line = np.polynomial.polynomial.polyfit(_TIMES, bend, 1)
    left = bend - np.polynomial.polynomial.polyval(_TIMES, line)
    return np.array([part.mean() for part in np.array_split(left, _PARTS)])


def measured(path: Path) -> NDArray[np.float32]:
    """Fingerprints of a ball's drops: of columns drop, time (s), height (m), velocity."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    drops = [table[table[:, 0] == number] for number in np.unique(table[:, 0])]
    return np.array([fingerprint(drop[:, 1], drop[:, 2]) for drop in drops], np.float32)


def _drops(draw: Draw, shown: tuple[Named, ...]) -> NDArray[np.float32]:
    rng = np.random.default_rng(draw.seed)
    ball = with_effects(Ball(), (*draw.effects, *shown))
    return np.array([fingerprint(_TIMES, _filmed(ball, rng)) for _ in range(draw.blocks)], np.float32)


def _filmed(ball: Ball, rng: np.random.Generator) -> Array:
    times = _TIMES + ball.cut * (ball.cut_at < _TIMES)
    step = 0.01
    clock = np.arange(0, times[-1] + step, step)
    thrown = _THROW * rng.standard_normal()
    depth = fall(len(clock), step, thrown, ball.gravity * _GRAVITY, ball.terminal_speed, ball.power)
    seen = np.interp(times - _HOLD * rng.uniform(), clock, depth)
    seen *= (1 + _SCALE * rng.standard_normal()) * (1 + ball.tilt * seen / 47)
    return -seen + _slow_error(rng) + _QUICK_ERROR * rng.standard_normal(len(times))


def _slow_error(rng: np.random.Generator) -> Array:
    """Smooth over the record: half waves of equal size on average."""
    half_waves = np.arange(1, _WAVES + 1)[:, None]
    waves = np.cos(np.pi * half_waves * _TIMES / _TIMES[-1])
    return np.asarray(_SLOW_ERROR * np.sqrt(2 / _WAVES) * rng.standard_normal(_WAVES) @ waves)


@njit(cache=True)
def fall(count: int, step: float, speed: float, gravity: float, terminal: float, power: float) -> Array:
    """Depth (m) at each step, by the midpoint rule; drag acts upwards, as no ball is thrown far."""
    depth = np.zeros(count)
    for k in range(1, count):
        half = speed + 0.5 * step * gravity * (1 - (abs(speed) / terminal) ** power)
        speed += step * gravity * (1 - (abs(half) / terminal) ** power)
        depth[k] = depth[k - 1] + step * half
    return depth

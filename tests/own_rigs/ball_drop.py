"""A ball let go from a bridge and filmed: the twin falls freely; the drops of a ball are its blocks.

    rattle diagnose --subject ball_drop.py ball_drops_Tennis_Ball.csv --out answer

A fingerprint is the height over time less the free fall that fits it best, with an instant and a speed of its
own, since a video says neither when nor how a ball left the hand.

What healthy drops differ by, the same for every ball: the hand opens up to 0.2 s after the first frame (three
frames), at 0 +- 0.3 m/s; the scale of each video is known to 2 %, as the heights at which 22 videos of one
bridge begin (45.6 to 49.5 m) scatter by 2.2 %; a ball's place in the picture is right within 0.12 m that
change slowly (lens, camera's angle, depth) and 0.04 m from frame to frame (a pixel, a blurred ball).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_twin.own_rig import Simulator, cause, number, parts

Array = NDArray[np.float64]
HEIGHT, TIME = "Height (m)", "Time (s)"
_GRAVITY = 9.81
_TIMES = np.arange(41) / 15
"""s; the shortest record ends after 2.74 s."""
_PARTS, _BRIDGE, _STEP = 8, 47, 0.01
_SLOW_ERROR, _QUICK_ERROR = 0.12, 0.04
_WAVES = 4
"""The slow error has up to so many half waves of equal size in a record."""


def simulate(p: Any, given: Mapping[str, Array]) -> dict[str, Array]:
    """Filmed heights (m).

    `gravity` is a factor: on it, on the height's scale, or on the clock's squared, which look alike. Drag
    grows with speed to the `power` and balances the weight at `terminal_speed`. `tilt` is by how much the
    picture's scale changes over 47 m; at `cut_at` the video misses `cut` seconds.
    """
    shown = given[TIME] - given[TIME][0]
    times = shown + p.cut * (p.cut_at < shown)
    clock = np.arange(0, times[-1] + _STEP, _STEP)
    depth = fall(len(clock), _STEP, p.thrown, p.gravity * _GRAVITY, p.terminal_speed, p.power)
    seen = np.interp(times - np.clip(p.hold, 0.0, 0.2), clock, depth)
    seen *= p.scale * (1 + p.tilt * seen / _BRIDGE)
    waves = [getattr(p, f"wave_{k}") * np.cos(np.pi * k * shown / _TIMES[-1]) for k in range(1, _WAVES + 1)]
    return {HEIGHT: np.sum(waves, axis=0) - seen}


def fingerprint(record: Mapping[str, Array]) -> dict[str, Array]:
    """What is left of a drop after the free fall that fits it best, mean of each part (m)."""
    times = record[TIME] - record[TIME][0]
    bend = np.interp(_TIMES, times, record[HEIGHT]) + 0.5 * _GRAVITY * _TIMES**2
    line = np.polynomial.polynomial.polyfit(_TIMES, bend, 1)
    return {HEIGHT: parts(bend - np.polynomial.polynomial.polyval(_TIMES, line), _PARTS)}


@njit(cache=True)
def fall(count: int, step: float, speed: float, gravity: float, terminal: float, power: float) -> Array:
    """Depth (m) at each step, by the midpoint rule; drag acts upwards, as no ball is thrown far."""
    depth = np.zeros(count)
    for k in range(1, count):
        half = speed + 0.5 * step * gravity * (1 - (abs(speed) / terminal) ** power)
        speed += step * gravity * (1 - (abs(half) / terminal) ** power)
        depth[k] = depth[k - 1] + step * half
    return depth


SUBJECT = Simulator(
    simulate,
    channels={HEIGHT: "m"},
    rig={
        "gravity": (1.0, 0.0), "terminal_speed": (np.inf, 0.0), "power": (2.0, 0.0), "tilt": (0.0, 0.0),
        "cut": (0.0, 0.0), "cut_at": (0.0, 0.0),
    },
    start={
        "hold": (0.1, 0.06), "thrown": (0.0, 0.3), "scale": (1.0, 0.02),
        **{f"wave_{k}": (0.0, _SLOW_ERROR * np.sqrt(2 / _WAVES)) for k in range(1, _WAVES + 1)},
    },
    noise={HEIGHT: _QUICK_ERROR},
    causes=(
        # its coefficient is the same at all speeds if the power is 2
        cause("drag", "air", number("terminal_speed", "m/s", (8.0, 80.0)), number("power", "", (1.0, 2.0))),
        cause("scaled_gravity", "weight", number("gravity", "", (0.5, 0.94), (1.06, 1.5))),
        cause("tilted_camera", "height", number("tilt", "", (-0.3, -0.05), (0.05, 0.3))),
        cause("cut_video", "height", number("cut", "s", (0.06, 0.5)), number("cut_at", "s", (0.4, 2.4))),
    ),
    fingerprint=fingerprint,
    block="Drop #",
)  # fmt: skip
"""Whatever a sceptic may put in."""

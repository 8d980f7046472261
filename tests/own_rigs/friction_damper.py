"""A banded friction damper on an actuator: the twin has Coulomb's and viscous friction, and is rigid.

The recorded displacement moves the twin. A fingerprint is the force, in units of the sliding force, against
the way since the last reversal and against the share of the stroke; a block is one stroke out and the next
one back, in runs of three amplitudes. Where it slides, parts are as long as what the band sticks and slips by
(3 to 5 mm), as no two strokes do that alike.

What healthy dampers differ by: as one damper under one tension does in data sets 2 and 3, friction 10 % along
either stroke (lining, eccentric drum) and 15 % between the two sides (a band tightens itself to one);
friction 3 % between strokes, with 5 % of ripple as it sticks and slips; viscous friction by 10 % of the
sliding force at 0.1 m/s; elastic parts give way by 0.1 mm; the force's zero is known to 1 %; 1 ms between
the channels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sim_twin.own_rig import Cause, Cell, Draw, Layout, Named, Observed, cause, number, with_effects

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
RUNS = ("0.5Hz30lbtension0.5amplitude", "0.5Hz30lbtension1amplitude", "0.5Hz30lbtension1.5amplitude")
RATE = 256.0
_INCH = 0.0254
_WAY = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0]) * 1e-3
_SHARE = np.array([0.5, 0.65, 0.8, 0.95])
_FULL = 0.9
"""A stroke counts from this share of the longest on; the others belong to the start and the end of a run."""
_BAND, _STROKE, _RIPPLE, _UNEVEN, _VISCOUS, _GIVE = 0.1, 0.03, 0.05, 0.15, 0.1, 1e-4
_OFFSET, _SKEW = 0.01, 1e-3
_WAVELENGTHS = np.array([0.01, 0.02, 0.04])
"""m; a lining is worn unevenly over lengths like these."""

_SHORTEST = 1e-6
"""m; a rigid damper gives way by this before it slides, less than any record shows."""


@dataclass(frozen=True, slots=True)
class Damper:
    """Forces in units of the sliding force; what is 0 is missing in Coulomb's law.

    Before it slides, the damper gives way by `give` (m) on elastic parts and, after the ends have moved
    through a `play` (m), by `contact_give` on what touches there (Hertz: with the force to the power 2/3).
    Friction is larger by `rest` at rest than when faster than `slow` (m/s); by `viscous` at 0.1 m/s; by
    `uneven` to one side than to the other; by `outwards` 25 mm from the middle, with the square of that
    distance. `spring` (at 25 mm) and `mass` (at 1 m/s2) are carried along. The force is shown with an
    `offset` and comes late by `delay` (s).
    """

    give: float = 0.0
    contact_give: float = 0.0
    play: float = 0.0
    rest: float = 0.0
    slow: float = 1.0
    viscous: float = 0.0
    uneven: float = 0.0
    outwards: float = 0.0
    spring: float = 0.0
    mass: float = 0.0
    offset: float = 0.0
    delay: float = 0.0

    def force(self, x: Array, rate: float, bumps: Array) -> Array:
        """Force on moved ends, x (m) at `rate` (Hz); friction is larger by `bumps` wherever that is."""
        speed = np.gradient(x, 1 / rate)
        sliding = self._sliding(x, speed) * (1 + bumps)
        force = _creep(x, sliding, self.give + _SHORTEST, self.contact_give, 0.5 * self.play)
        force += self.spring * x / 0.025 + self.mass * np.gradient(speed, 1 / rate) + self.offset
        times = np.arange(len(x)) / rate
        return np.asarray(np.interp(times - self.delay, times, force))

    def _sliding(self, x: Array, speed: Array) -> Array:
        fast = np.abs(speed)
        friction = 1 + self.rest * np.exp(-fast / self.slow) + self.viscous * fast / 0.1
        return friction * (1 + 0.5 * self.uneven * np.sign(speed)) * (1 + self.outwards * (x / 0.025) ** 2)


@njit(cache=True)
def _creep(x: Array, sliding: Array, give: float, contact_give: float, half_play: float) -> Array:
    """A friction element behind a spring that has play; it slides by what the spring cannot bear."""
    force = np.zeros(len(x))
    slid = x[0]
    for k in range(len(x)):
        most = max(sliding[k], 0.0)
        reach = half_play + contact_give * most ** (2 / 3) + give * most
        stretch = x[k] - slid
        if abs(stretch) > reach:
            slid += np.sign(stretch) * (abs(stretch) - reach)
            stretch = np.sign(stretch) * reach
        force[k] = np.sign(stretch) * _borne(abs(stretch) - half_play, give, contact_give)
    return force


@njit(cache=True)
def _borne(bent: float, give: float, contact_give: float) -> float:
    """Force at which both springs together give way by so much: Newton's steps for its cubic root."""
    if bent <= 0.0:
        return 0.0
    root = (bent / give) ** (1 / 3)
    for _ in range(40):
        left = give * root**3 + contact_give * root**2 - bent
        if left < 1e-9 * bent:
            break
        root -= left / (3 * give * root**2 + 2 * contact_give * root)
    return float(root**3)


CAUSES = (
    cause("backlash", "joint", number("play", "m", (3e-4, 1e-2)), number("contact_give", "m", (2e-4, 8e-3))),
    cause("series_stiffness", "joint", number("give", "m", (5e-4, 2e-2))),
    cause("stribeck", "band", number("rest", "", (0.1, 1.0)), number("slow", "m/s", (3e-3, 0.1))),
    cause("excess_viscous_friction", "band", number("viscous", "", (0.3, 3.0))),
    cause("asymmetric_friction", "band", number("uneven", "", (-1.2, -0.3), (0.3, 1.2))),
    cause("friction_over_stroke", "band", number("outwards", "", (-0.4, -0.05), (0.05, 1.0))),
    cause("parallel_spring", "frame", number("spring", "", (0.1, 1.0))),
    cause("moved_mass", "frame", number("mass", "", (0.03, 1.0))),
    cause("force_offset", "sensor", number("offset", "", (-0.5, -0.05), (0.05, 0.5))),
    cause("force_delay", "sensor", number("delay", "s", (-0.05, -4e-3), (4e-3, 0.05))),
)
"""What may bend a friction loop; forces in units of the sliding force."""


@dataclass(frozen=True, slots=True)
class FrictionDamper:
    """The damper as a subject, with the displacements (m) of its runs."""

    displacements: tuple[Array, ...]
    width: float = 1.0

    @property
    def layout(self) -> Layout:
        """Force over sliding force, by way and by share of the stroke, for both directions of every run."""
        whats = ["after reversal"] * (len(_WAY) - 1) + ["along the stroke"] * (len(_SHARE) - 1)
        runs = range(len(self.displacements))
        return Layout(
            tuple(Cell(run, "force", what) for run in runs for _ in ("out", "back") for what in whats)
        )

    @property
    def causes(self) -> tuple[Cause, ...]:
        return CAUSES

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Move each damper as it was moved; blocks are the first pairs of full strokes."""
        return [tuple(self._observe(draw, effects) for effects in draw.sensing) for draw in draws]

    def wider(self, times: float) -> FrictionDamper:
        return replace(self, width=times)

    def _observe(self, draw: Draw, effects: tuple[Named, ...]) -> Blocks:
        rng = np.random.default_rng(draw.seed)
        damper = with_effects(_healthy(self.width, rng), (*draw.effects, *effects))
        forces = [damper.force(x, RATE, self.width * _bumps(x, rng)) for x in self.displacements]
        return self.fingerprints(forces)[: draw.blocks]

    def fingerprints(self, forces: Sequence[Array]) -> Blocks:
        """Of forces in any unit, one record for each run."""
        runs = [_pairs(x, f) for x, f in zip(self.displacements, forces, strict=True)]
        count = min(len(pairs) for pairs in runs)
        return np.concatenate([pairs[:count] for pairs in runs], axis=1, dtype=np.float32)


def measured(files: Sequence[Mapping[str, Array]]) -> tuple[FrictionDamper, Blocks]:
    """The subject and its measured fingerprints; columns of a run: displacement (in), force (kip)."""
    [table] = files
    runs = [table[name].astype(np.float64) for name in RUNS]
    subject = FrictionDamper(tuple(_INCH * gaussian_filter1d(run[:, 0], 1.0) for run in runs))
    return subject, subject.fingerprints([run[:, 1] for run in runs])


def _healthy(width: float, rng: np.random.Generator) -> Damper:
    uneven, viscous, give, offset, delay = width * rng.standard_normal(5)
    return Damper(
        give=_GIVE * abs(give), viscous=_VISCOUS * viscous, uneven=_UNEVEN * uneven, offset=_OFFSET * offset,
        delay=_SKEW * delay,
    )  # fmt: skip


def _bumps(x: Array, rng: np.random.Generator) -> Array:
    """Friction's share that depends on the place in either direction, on the stroke, and on nothing known."""
    direction = (np.gradient(x) > 0).astype(int)
    phases = rng.uniform(0, 2 * np.pi, (2, len(_WAVELENGTHS)))
    waves = np.sin(2 * np.pi * x[:, None] / _WAVELENGTHS + phases[direction]).sum(axis=1)
    strokes = np.cumsum(np.abs(np.diff(direction, prepend=direction[0])))
    each = rng.standard_normal(strokes[-1] + 1)[strokes]
    ripple = gaussian_filter1d(rng.standard_normal(len(x)), 1.5)
    worn = waves / np.sqrt(len(_WAVELENGTHS) / 2)
    return np.asarray(_BAND * worn + _STROKE * each + _RIPPLE * ripple / ripple.std())


def _pairs(x: Array, force: Array) -> Array:
    """Fingerprints of the full strokes out, each with the next one back, shape (pairs, numbers)."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
    strokes = [slice(a, b) for a, b in pairwise(turns.tolist())]
    longest = max(abs(x[s.stop] - x[s.start]) for s in strokes)
    full = [s for s in strokes if abs(x[s.stop] - x[s.start]) > _FULL * longest]
    full = full[int(x[full[0].stop] < x[full[0].start]) :]
    return np.array([_pair(x, force, out, back) for out, back in zip(full[::2], full[1::2], strict=False)])


def _pair(x: Array, force: Array, out: slice, back: slice) -> Array:
    parts = [sign * _stroke(x[s], sign * force[s]) for s, sign in ((out, 1.0), (back, -1.0))]
    late = np.abs([part[len(_WAY) - 1 :] for part in parts])
    return np.asarray(np.concatenate(parts) / late.mean())


def _stroke(x: Array, force: Array) -> Array:
    """Mean force in each part of the way and of the stroke."""
    way = np.abs(x - x[0])
    return np.concatenate([_means(force, way, _WAY), _means(force, way / way[-1], _SHARE)])


def _means(force: Array, at: Array, bounds: Array) -> Array:
    """Means between bounds, straight between them where there are hardly any samples."""
    steps = 0.5 * (force[1:] + force[:-1]) * np.diff(at)
    sums = np.interp(bounds, at, np.concatenate([[0.0], np.cumsum(steps)]))
    return np.asarray(np.diff(sums) / np.diff(bounds))

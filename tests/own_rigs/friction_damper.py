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

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.subject import Draw, Named, Observed
from tests.own_rigs.damper import Damper
from tests.own_rigs.effects import cause, number, with_effects

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

    @property
    def layout(self) -> Layout:
        """Force over sliding force, by way and by share of the stroke, for both directions of every run."""
        whats = ["after reversal"] * (len(_WAY) - 1) + ["along the stroke"] * (len(_SHARE) - 1)
        runs = range(len(self.displacements))
        return Layout(
            tuple(Cell(run, "force", what, 1) for run in runs for _ in ("out", "back") for what in whats)
        )

    @property
    def causes(self) -> tuple[Cause, ...]:
        return CAUSES

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Move each damper as it was moved; blocks are the first pairs of full strokes."""
        return [tuple(self._observe(draw, effects) for effects in draw.sensing) for draw in draws]

    def _observe(self, draw: Draw, effects: tuple[Named, ...]) -> Blocks:
        rng = np.random.default_rng(draw.seed)
        damper = with_effects(_healthy(rng), (*draw.effects, *effects))
        forces = [damper.force(x, RATE, _bumps(x, rng)) for x in self.displacements]
        return self.fingerprints(forces)[: draw.blocks]

    def fingerprints(self, forces: Sequence[Array]) -> Blocks:
        """Of forces in any unit, one record for each run."""
        runs = [_pairs(x, f) for x, f in zip(self.displacements, forces, strict=True)]
        count = min(len(pairs) for pairs in runs)
        return np.concatenate([pairs[:count] for pairs in runs], axis=1, dtype=np.float32)


def measured(path: Path, names: Sequence[str] = RUNS) -> tuple[FrictionDamper, Blocks]:
    """The subject and its measured fingerprints; columns of a run: displacement (in), force (kip)."""
    with np.load(path) as table:
        runs = [table[name].astype(np.float64) for name in names]
    subject = FrictionDamper(tuple(_INCH * gaussian_filter1d(run[:, 0], 1.0) for run in runs))
    return subject, subject.fingerprints([run[:, 1] for run in runs])


def _healthy(rng: np.random.Generator) -> Damper:
    uneven, viscous, give, offset, delay = rng.standard_normal(5)
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

"""Post, yoke, shaker and cover standing on the plate, as one component.

Its boundary: at the pivot deflection (z), slope (dz/dx) and motion along the beam (x), the contact point of
the yoke (z), the shaker's foot (z).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from sim_twin.parts.frame import DOFS, Member, frame
from sim_twin.parts.modal import Elastic, by_one_thread
from sim_twin.parts.plate import Plate, mesh_lines
from sim_twin.parts.synthesis import Component, Leading, craig_bampton, modal_damping
from sim_twin.rigs.impact_beam.base.cover import RIGID, box_of, rigid_rise
from sim_twin.rigs.impact_beam.base.model import FlexibleBase

Array = NDArray[np.float64]
PIVOT_Z, PIVOT_SLOPE, PIVOT_X, CONTACT, SHAKER = range(5)
_POST_ELEMENTS = 3
_U, _V, _W, _RX, _RY, _RZ = range(DOFS)


@dataclass(frozen=True, slots=True)
class Standing:
    """The reduced base: `component`, its damping matrix `C`, rows (n,) and (k, n) of its accelerometers."""

    component: Component
    C: Array
    accelerometer: Array
    cover: Array


@dataclass(frozen=True, slots=True)
class Unreduced:
    """The base with all its degrees of freedom, clamped; boundary (5, dofs) and accelerometers as rows."""

    elastic: Elastic
    boundary: Array
    accelerometer: Array
    cover: Array


@lru_cache(maxsize=16)
@by_one_thread
def standing_on(base: FlexibleBase) -> Standing:
    """Reduce the base to its boundary and modes; raises UnphysicalParameter for more than the mesh has."""
    whole = unreduced(base)
    lowest, leading = base.cover.modes if base.cover else 0, Leading(CONTACT, base.modes)
    component = craig_bampton(whole.elastic, whole.boundary, lowest, "FlexibleBase", leading)
    C = modal_damping(component.elastic, base.damping_ratio)
    return Standing(component, C, whole.accelerometer @ component.basis, whole.cover @ component.basis)


def unreduced(base: FlexibleBase) -> Unreduced:
    """Put the base together from its elements."""
    bare = _with_frame(base)
    if base.cover is None:
        return bare
    box, plate = box_of(base.cover), _clamped_plate(base)
    own, more = len(bare.elastic.M), box.component.size
    lid = box.component.elastic
    both = Elastic(block_diag(bare.elastic.M, lid.M), block_diag(bare.elastic.B, lid.B))
    a, b = base.length, base.width
    for x, y in ((0.0, b / 2), (a, b / 2), (a / 2, 0.0), (a / 2, b)):
        gap = np.zeros(own + more)
        gap[: len(plate.kept)] = plate.rows(x, y)[0]
        gap[own : own + RIGID] = -rigid_rise(x - base.length / 2, y - base.width / 2)
        both = both.with_spring(gap, base.cover.fixing_stiffness)
    return Unreduced(
        both,
        np.pad(bare.boundary, ((0, 0), (0, more))),
        np.append(bare.accelerometer, np.zeros(more)),
        np.pad(box.accelerometers, ((0, 0), (own, 0))),
    )


@dataclass(frozen=True, slots=True)
class _ClampedPlate:
    """The plate with its corners held: degrees of freedom `kept` of those of `plate`."""

    plate: Plate
    kept: NDArray[np.int64]

    def elastic(self) -> Elastic:
        free = self.plate.elastic()
        return Elastic(free.M[np.ix_(self.kept, self.kept)], free.B[:, self.kept])

    def rows(self, x: float, y: float) -> Array:
        return np.asarray(self.plate.rows(np.array([x]), np.array([y]))[:, 0, self.kept])

    def foot(self, x: float, y: float, width: float, depth: float) -> Array:
        return self.plate.foot_rows(x, y, width, depth)[:, self.kept]


def _clamped_plate(base: FlexibleBase) -> _ClampedPlate:
    a, b, e = base.length, base.width, base.clamp
    across = max(4, 2 * round(base.elements * b / a / 2))
    plate = Plate(base.sheet, mesh_lines(a, base.elements, e, a - e), mesh_lines(b, across, e, b - e))
    x, y = plate.nodes
    held = ((x <= e) | (x >= a - e)) & ((y <= e) | (y >= b - e))
    return _ClampedPlate(plate, np.setdiff1d(np.arange(4 * len(x)), plate.dofs(held)))


def _with_frame(base: FlexibleBase) -> Unreduced:
    plate = _clamped_plate(base)
    own = plate.elastic()
    side = base.shaker.diameter * np.sqrt(np.pi) / 2  # a square of the same area
    shaker = plate.foot(base.shaker_x, base.width / 2, side, side)
    # a cylinder's mass, and its moment of inertia about the foot, for rise and both slopes
    m, r, h = base.shaker.body_mass, base.shaker.diameter / 2, base.shaker.height
    turning = m * (r**2 / 4 + h**2 / 3)
    for row, inertia in zip(shaker, (m, turning, turning), strict=True):
        own = own.with_mass(row, inertia)
    nodes, members, feet = _frame(base)
    tie = _tie(base, plate, len(nodes), feet)
    more = tie.shape[1] - len(own.M)
    standing = frame(nodes, members).by(tie)
    contact = DOFS * (len(nodes) - 1)
    for translation in range(3):
        standing = standing.with_mass(tie[contact + translation], base.yoke.sensor_mass)
    head = np.append(plate.foot(*_yoke_foot(base))[0], np.zeros(more)) - tie[DOFS * feet[1] + _W]
    pivot = DOFS * _POST_ELEMENTS
    boundary = np.array([tie[pivot + _W], -tie[pivot + _RY], tie[pivot + _U], tie[contact + _W],
                         np.append(shaker[0], np.zeros(more))])  # fmt: skip
    accelerometer = np.append(plate.rows(base.accelerometer_x, base.accelerometer_y)[0], np.zeros(more))
    padded = Elastic(np.pad(own.M, (0, more)), np.pad(own.B, ((0, 0), (0, more))))
    return Unreduced(
        (padded + standing).with_spring(head, base.yoke.head_stiffness),
        boundary,
        accelerometer,
        np.zeros((0, len(accelerometer))),
    )


def _yoke_foot(base: FlexibleBase) -> tuple[float, float, float, float]:
    return base.yoke_x, base.width / 2, base.yoke.bar.width, base.yoke.bar.width


def _frame(base: FlexibleBase) -> tuple[Array, tuple[Member, ...], tuple[int, int]]:
    """Nodes (m, from the plate's mid-plane and centre line), members, the two nodes that stand on it."""
    post = [(base.post_x, 0.0, z) for z in np.linspace(0.0, base.beam_height, _POST_ELEMENTS + 1)]
    half, low, high, x = base.yoke.span / 2, base.yoke.foot_height, base.beam_height, base.yoke_x
    middle = (low + high) / 2
    yoke = [
        (x, 0.0, low),
        *((x, side * half, z) for side in (-1, 1) for z in (low, middle, high)),
        (x, 0.0, high),
    ]
    up_the_post = [Member(base.post, i, i + 1, (0.0, 1.0, 0.0)) for i in range(_POST_ELEMENTS)]
    foot = len(post)
    around = [(0, 1), (1, 2), (2, 3), (3, 7), (0, 4), (4, 5), (5, 6), (6, 7)]
    yoke_members = [Member(base.yoke.bar, foot + i, foot + j, (1.0, 0.0, 0.0)) for i, j in around]
    return np.array(post + yoke), (*up_the_post, *yoke_members), (0, foot)


def _tie(base: FlexibleBase, plate: _ClampedPlate, nodes: int, feet: tuple[int, int]) -> Array:
    """Frame's degrees of freedom by those of the plate and the frame's free ones.

    The plate does not stretch, so a foot moves by rise and slopes; the yoke's foot may rise by itself
    (impedance head), and its slope moves it sideways because it stands higher.
    """
    post_foot, yoke_foot = (DOFS * foot for foot in feet)
    slaves = np.concatenate([post_foot + np.arange(DOFS), np.delete(yoke_foot + np.arange(DOFS), _W)])
    free = np.setdiff1d(np.arange(DOFS * nodes), slaves)
    own = len(plate.kept)
    tie = np.zeros((DOFS * nodes, own + len(free)))
    tie[free, own + np.arange(len(free))] = 1.0
    w, w_x, w_y = plate.foot(base.post_x, base.width / 2, base.post.depth, base.post.width)
    tie[post_foot + _W, :own], tie[post_foot + _RX, :own], tie[post_foot + _RY, :own] = w, w_y, -w_x
    _, w_x, w_y = plate.foot(*_yoke_foot(base))
    tie[yoke_foot + _RX, :own], tie[yoke_foot + _RY, :own] = w_y, -w_x
    tie[yoke_foot + _U, :own], tie[yoke_foot + _V, :own] = (
        -base.yoke.foot_height * row for row in (w_x, w_y)
    )
    return tie

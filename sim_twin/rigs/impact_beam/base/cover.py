"""The cover: a box of five plates whose edges stay straight and turn together.

Origin in the middle of the base plate. Coordinates: rigid motion of the box (rise, rotations about x and y),
then the bending of its walls. A wall deflects along its normal axis n and lies along two others, s and t.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sim_twin.parts.modal import Elastic, by_one_thread
from sim_twin.parts.plate import Plate, mesh_lines
from sim_twin.parts.synthesis import Component, craig_bampton
from sim_twin.rigs.impact_beam.base.model import Cover

Array = NDArray[np.float64]
Key = tuple[object, ...]
RIGID = 3
"""Rise (m), rotation about x, rotation about y (rad)."""
_ELEMENTS = 8
_X, _Y, _Z = 0, 1, 2
_CORNER = 0.125
"""Where the accelerometer near a corner sits, fraction of length and width from that corner."""
_W, _WS, _WT, _WST = range(4)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(2)  # exact for the squares of a linear motion


@dataclass(frozen=True, slots=True)
class Wall:
    """A `plate` along axes `s`, `t`, deflecting along axis `n`, at `place` (m) on that."""

    plate: Plate
    s: int
    t: int
    n: int
    place: float

    def nodes(self) -> Array:
        """Positions in space, shape (3, nodes), m."""
        where = np.full((3, self.plate.nodes.shape[1]), self.place)
        where[[self.s, self.t]] = self.plate.nodes
        return where


@dataclass(frozen=True, slots=True)
class Box:
    """The cover reduced; its boundary is the rigid motion. Rows of the accelerometers, shape (2, n)."""

    component: Component
    accelerometers: Array


@lru_cache(maxsize=16)
@by_one_thread
def box_of(cover: Cover) -> Box:
    """Reduce the cover; its accelerometers sit in the middle of the top and near a corner of it."""
    walls = walls_of(cover)
    motions = wall_motions(walls)
    parts = [wall.plate.elastic().by(motion) for wall, motion in zip(walls, motions, strict=True)]
    rigid = np.eye(RIGID, motions[0].shape[1])
    frame = Elastic(_mass_in_planes(cover), np.zeros((0, RIGID))).by(rigid)
    component = craig_bampton(sum(parts, start=frame), rigid, cover.modes, "Cover")
    x, y = (size * np.array([0.0, 0.5 - _CORNER]) for size in (cover.length, cover.width))
    return Box(component, walls[0].plate.rows(x, y)[0] @ motions[0] @ component.basis)


def rigid_rise(x: float, y: float) -> Array:
    """Rise of the rigid box at (x, y), as a row over its rigid motion."""
    return np.array([1.0, y, -x])


def walls_of(cover: Cover) -> tuple[Wall, ...]:
    """The top, then the walls across x, then those across y."""
    x, y, z = (mesh_lines(size, _ELEMENTS) for size in (cover.length, cover.width, cover.height))
    x, y = (tuple(line - lines[-1] / 2 for line in lines) for lines in (x, y))
    ends, sides = (-x[-1], x[-1]), (-y[-1], y[-1])
    return (
        Wall(Plate(cover.sheet, x, y), _X, _Y, _Z, cover.height),
        *(Wall(Plate(cover.sheet, y, z), _Y, _Z, _X, place) for place in ends),
        *(Wall(Plate(cover.sheet, x, z), _X, _Z, _Y, place) for place in sides),
    )


def wall_motions(walls: tuple[Wall, ...]) -> list[Array]:
    """Degrees of freedom of every wall by the rigid motion and the bending of the box, shape (dofs, box)."""
    shares = [list(_free_dofs(wall)) for wall in walls]
    keys = {key: RIGID + i for i, key in enumerate(dict.fromkeys(k for each in shares for _, k, _ in each))}
    motions = []
    for wall, own in zip(walls, shares, strict=True):
        dofs = wall.plate.dofs(np.full(wall.plate.nodes.shape[1], True))
        X, Y, Z = wall.nodes()
        motion = np.zeros((dofs.size, RIGID + len(keys)))
        if wall.n == _Z:
            motion[dofs[_W], :RIGID] = np.column_stack([np.ones_like(X), Y, -X])
            motion[dofs[_WS], 2], motion[dofs[_WT], 1] = -1.0, 1.0
        elif wall.n == _X:
            motion[dofs[_W], 2], motion[dofs[_WT], 2] = Z, 1.0
        else:
            motion[dofs[_W], 1], motion[dofs[_WT], 1] = -Z, -1.0
        for dof, key, sign in own:
            motion[dof, keys[key]] = sign
        motions.append(motion)
    return motions


def _free_dofs(wall: Wall) -> Iterator[tuple[int, Key, float]]:
    """Degree of freedom, what it is called in the box, and sign, for all of a wall that can move.

    On an edge to another wall the turning about the edge (and its change along it) is what both have. The
    bottom edge turns freely. Where three walls meet nothing moves.
    """
    dofs = wall.plate.dofs(np.full(wall.plate.nodes.shape[1], True))
    low, high = wall.plate.nodes.min(axis=1), wall.plate.nodes.max(axis=1)
    about_s, about_t = _turning(wall.s, wall.t, wall.n), _turning(wall.t, wall.s, wall.n)
    for i, (node, place) in enumerate(zip(wall.plate.nodes.T, wall.nodes().T, strict=True)):
        where: Key = tuple(np.round(place, 9).tolist())
        s_edge, t_edge = ((node == low) | (node == high)).tolist()
        bottom = wall.t == _Z and node[1] == low[1]
        if not s_edge and not t_edge:
            yield from ((dofs[k, i], (*where, wall.n, k), 1.0) for k in (_W, _WS, _WT, _WST))
        elif s_edge and not t_edge:
            yield dofs[_WS, i], (*where, "turn", wall.t), about_t
            yield dofs[_WST, i], (*where, "change of turn", wall.t), about_t
        elif t_edge and not s_edge:
            name = ("own", wall.n) if bottom else ("turn", wall.s)
            yield dofs[_WT, i], (*where, *name), about_s
            yield dofs[_WST, i], (*where, "change", *name), about_s
        elif bottom:
            yield dofs[_WST, i], (*where, "change of turn", wall.t), about_t


def _turning(about: int, along: int, normal: int) -> float:
    """Slope of the deflection where the wall turns by one about an axis: the sign of the permutation."""
    return float(np.linalg.det(np.eye(3)[[about, along, normal]]))


def _mass_in_planes(cover: Cover) -> Array:
    """What the walls' motions in their own planes and the frame add to the rigid mass matrix (3, 3)."""
    M = np.zeros((RIGID, RIGID))
    for wall in walls_of(cover):
        low, high = wall.plate.nodes.min(axis=1), wall.plate.nodes.max(axis=1)
        middle, half = (low + high) / 2, (high - low) / 2
        S, T = np.meshgrid(middle[0] + half[0] * _NODES, middle[1] + half[1] * _NODES)
        points = np.full((3, S.size), wall.place)
        points[wall.s], points[wall.t] = S.ravel(), T.ravel()
        weights = np.outer(_WEIGHTS, _WEIGHTS).ravel() * half[0] * half[1]
        for motion in np.delete(_motion_at(points), wall.n, axis=0):
            M += np.einsum("p,pi,pj->ij", weights * cover.sheet.mass_per_area, motion, motion)
    # Gauss points on the twelve edges, and their lengths in m
    corner = np.array([-cover.length / 2, -cover.width / 2, 0.0])
    size = np.array([cover.length, cover.width, cover.height])
    on_edges, lengths = [], []
    for axis in range(3):
        for a, b in product((0.0, 1.0), repeat=2):
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                on_edges.append(corner + size * np.insert(np.array([a, b]), axis, (1 + node) / 2))
                lengths.append(weight * size[axis] / 2)
    motions = _motion_at(np.array(on_edges).T)
    frame = np.einsum("p,kpi,kpj->ij", np.array(lengths), motions, motions)
    return np.asarray(M + cover.frame_mass * frame)


def _motion_at(points: Array) -> Array:
    """Motion along x, y, z of `points` (3, p) by the rigid motion, shape (3, p, 3)."""
    X, Y, Z = points
    zero, one = np.zeros_like(X), np.ones_like(X)
    return np.array([
        np.column_stack([zero, zero, Z]), np.column_stack([zero, -Z, zero]), np.column_stack([one, Y, -X])
    ])  # fmt: skip

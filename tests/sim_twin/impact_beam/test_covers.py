"""The covers: a box of plates on the flexible base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from daq.errors import UnphysicalParameter
from sim_twin.rigs.impact_beam.base.cover import RIGID, box_of, wall_motions, walls_of
from sim_twin.rigs.impact_beam.base.model import COVERS, FlexibleBase, flexible_base
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive, nominal
from sim_twin.rigs.impact_beam.structure import structure_of
from sim_twin.rigs.impact_beam.truth import BeamTruth
from sim_twin.twin import Twin
from tests.sim_twin.solver import RATE, driven

_5_HZ = SineDrive(9.0, 5.0)
ALUMINIUM = COVERS["aluminium"]
assert ALUMINIUM is not None


def covered(kind: str, **changes: float) -> ImpactBeam:
    base = flexible_base(kind)
    cover = replace(base.cover, **changes) if base.cover else None
    return replace(nominal(), base=replace(base, cover=cover))


@pytest.mark.long
def test_the_box_rises_and_turns_with_its_whole_mass() -> None:
    M = box_of(ALUMINIUM).component.elastic.M[:RIGID, :RIGID]
    a, b, h = ALUMINIUM.length, ALUMINIUM.width, ALUMINIUM.height
    m, f = ALUMINIUM.sheet.mass_per_area, ALUMINIUM.frame_mass
    assert M[0, 0] == pytest.approx(m * (a * b + 2 * (a + b) * h) + 4 * f * (a + b + h), rel=1e-9)
    # About x: integral of y^2 + z^2 over top, the walls across y, the walls across x, and the twelve edges.
    top = m * a * b * (b**2 / 12 + h**2)
    sides = 2 * m * a * h * (b**2 / 4 + h**2 / 3)
    ends = 2 * m * b * h * (b**2 / 12 + h**2 / 3)
    edges = f * (2 * a * (b**2 / 2 + h**2) + 2 * b * (b**2 / 6 + h**2) + 4 * h * (b**2 / 4 + h**2 / 3))
    assert M[1, 1] == pytest.approx(top + sides + ends + edges, rel=1e-9)


def test_walls_ring_between_simply_supported_and_clamped() -> None:
    # Joined edges hold less than clamps and more than free turning, so by Rayleigh the lowest mode lies
    # between those of the largest wall: Navier's, and Warburton's one-term bound for clamped edges (1954).
    found = box_of(ALUMINIUM).component.omega[0]
    a, b, sheet = ALUMINIUM.length, ALUMINIUM.width, ALUMINIUM.sheet
    speed = np.sqrt(sheet.bending_stiffness / sheet.mass_per_area)
    assert found > np.pi**2 * (1 / a**2 + 1 / b**2) * speed
    assert found < np.sqrt(22.373**2 * (1 / a**4 + 1 / b**4) + 2 * (12.303 / (a * b)) ** 2) * speed


def test_no_wall_moves_where_three_meet_and_edges_turn_together() -> None:
    walls = walls_of(ALUMINIUM)
    motions = wall_motions(walls)
    rng = np.random.default_rng(1)
    z = rng.standard_normal(motions[0].shape[1])
    z[:RIGID] = 0.0
    top, end = motions[0] @ z, motions[2] @ z  # the end wall at +x
    middle = np.array([0.0])
    x, h = np.array([ALUMINIUM.length / 2]), np.array([ALUMINIUM.height])
    slope_of_top = walls[0].plate.rows(x, middle)[1, 0] @ top
    slope_of_end = walls[2].plate.rows(middle, h)[2, 0] @ end
    assert slope_of_top == pytest.approx(-slope_of_end, rel=1e-9)
    assert slope_of_top != 0.0
    corner = walls[0].plate.rows(x, np.array([ALUMINIUM.width / 2]))[:, 0] @ top
    assert corner == pytest.approx(np.zeros(3), abs=1e-9)


def test_rigid_motions_bend_no_wall() -> None:
    walls = walls_of(ALUMINIUM)
    for wall, motion in zip(walls, wall_motions(walls), strict=True):
        K = wall.plate.elastic().K
        assert np.abs(K @ motion[:, :RIGID]).max() < 1e-8 * np.abs(K).max()


def test_a_cover_that_is_not_fixed_changes_nothing() -> None:
    peaks = []
    for rig in (covered("none"), covered("aluminium", fixing_stiffness=1e-3)):
        trace = driven(rig, _5_HZ, orders=(1,)).advance(round(0.01 * RATE))
        begin, end = (trace.switch_times[:2] / trace.step).astype(int)
        peaks.append(trace.outputs[0, begin : end + 2].max())
    # The modes of a loose box count among those kept, so other modes of the base are left out: 0.2 % as
    # measured between ten and forty of them.
    assert peaks[0] == pytest.approx(peaks[1], rel=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["aluminium", "fibreglass"])
def test_its_accelerometers_are_channels(kind: str) -> None:
    rig = replace(covered(kind), stations=(50,))
    truth = BeamTruth(Twin(rig, _5_HZ, {}), RATE)
    truth.change_drive(_5_HZ, 0.0, 0.0)
    rows = dict(zip(rig.channels, truth.advance(round(0.02 * RATE)), strict=True))
    assert rig.channels[-2:] == ("cover.acceleration_center", "cover.acceleration_corner")
    for name in rig.channels[-2:]:
        assert rows[name].std() > 0.01
    assert "cover.acceleration_center" not in covered("none").channels


@pytest.mark.parametrize("kind", ["aluminium", "fibreglass"])
def test_a_cover_lowers_the_frequencies_of_the_base(kind: str) -> None:
    # It adds degrees of freedom (interlacing: the lowest can only fall) and 3 kg to a plate of 4 kg.
    bare, with_cover = (structure_of(covered(each)) for each in ("none", kind))
    pendulum = 1
    assert np.sqrt(with_cover.K[pendulum, pendulum]) < np.sqrt(bare.K[pendulum, pendulum])
    assert eigh(with_cover.K, eigvals_only=True).min() > 0


def test_a_cover_that_cannot_be() -> None:
    with pytest.raises(UnphysicalParameter, match=r"Cover: height = 0: above 0"):
        replace(ALUMINIUM, height=0.0)
    with pytest.raises(UnphysicalParameter, match=r"Cover: modes = 9000: at least 0, at most"):
        box_of(replace(ALUMINIUM, modes=9000))
    with pytest.raises(KeyError, match="'wood'"):
        flexible_base("wood")


def test_the_default_base_has_no_cover() -> None:
    assert FlexibleBase().cover is None

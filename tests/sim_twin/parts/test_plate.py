"""The plate's finite elements against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh, solve

from daq.errors import UnphysicalParameter
from sim_twin.parts.plate import Plate, Sheet, mesh_lines

SHEET = Sheet(70e9, 2700.0, 0.3, 0.01)
A, B = 0.4, 0.3


def plate(elements: int, a: float = A, b: float = B) -> Plate:
    return Plate(SHEET, mesh_lines(a, elements), mesh_lines(b, elements))


def held(part: Plate, clamped: bool) -> np.ndarray:
    """Degrees of freedom that a support on all edges leaves."""
    x, y = part.nodes
    on_x, on_y = (x == 0) | (x == x.max()), (y == 0) | (y == y.max())
    w, w_x, w_y, w_xy = (part.dofs(on_x | on_y)[k] for k in range(4))
    along_x, along_y = part.dofs(on_y)[1], part.dofs(on_x)[2]
    fixed = [w, w_x, w_y, w_xy] if clamped else [w, along_x, along_y]
    return np.setdiff1d(np.arange(4 * len(x)), np.concatenate(fixed))


def frequencies(part: Plate, clamped: bool, count: int) -> np.ndarray:
    """omega a^2 sqrt(rho h / D), Leissa's frequency parameter."""
    M, K = part.elastic().M, part.elastic().K
    kept = np.ix_(*2 * [held(part, clamped)])
    squared = eigh(K[kept], M[kept], eigvals_only=True, subset_by_index=(0, count - 1))
    return np.sqrt(squared) * part.x[-1] ** 2 * np.sqrt(SHEET.mass_per_area / SHEET.bending_stiffness)


def navier(count: int) -> np.ndarray:
    """The same for a simply supported plate (Leissa, NASA SP-160 (1969), eq. 4.20)."""
    m, n = np.meshgrid(np.arange(1, 9), np.arange(1, 9))
    return np.sort((np.pi**2 * (m**2 + (n * A / B) ** 2)).ravel())[:count]


def test_simply_supported_plate() -> None:
    # Cubics over le = beta L / 8 are too stiff by (beta le)^4 / 1440: 1.3e-3 for the three half waves of mode
    # 4.
    assert frequencies(plate(8), False, 4) == pytest.approx(navier(4), rel=1.3e-3)


def test_clamped_square_plate() -> None:
    found = frequencies(plate(10, A, A), True, 4)
    # Leissa, J. Sound Vib. 31 (1973) 257: upper bounds of five digits, up to 2e-4 high.
    assert found == pytest.approx([35.992, 73.413, 73.413, 108.27], rel=2e-4)


def test_frequencies_converge_with_the_fourth_power_of_the_element_length() -> None:
    counts = np.array([3, 4, 6, 8])
    errors = [frequencies(plate(n), False, 1)[0] / navier(1)[0] - 1 for n in counts]
    assert min(errors) > 0  # a conforming element converges from above
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.1)


def test_deflection_under_pressure() -> None:
    part = plate(8, A, A)
    M, K = part.elastic().M, part.elastic().K
    kept, lifted = held(part, clamped=False), np.zeros(len(M))
    lifted[part.dofs(np.full(part.nodes.shape[1], True))[0]] = 1.0
    load = M @ lifted / SHEET.mass_per_area  # 1 Pa
    w = np.zeros(len(M))
    w[kept] = solve(K[np.ix_(kept, kept)], load[kept])
    middle = part.rows(np.array([A / 2]), np.array([A / 2]))[0, 0] @ w
    # Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells, Table 8: 0.00406 (three digits).
    assert middle * SHEET.bending_stiffness / A**4 == pytest.approx(0.00406, abs=5e-6)


def test_rigid_motions_of_the_free_plate() -> None:
    part = plate(5)
    M, K = part.elastic().M, part.elastic().K
    x, y = part.nodes
    dofs = part.dofs(np.full(len(x), True))
    motions = np.zeros((len(M), 3))
    motions[dofs[0]] = np.column_stack([np.ones_like(x), x, y])
    motions[dofs[1], 1] = motions[dofs[2], 2] = 1.0
    mass = SHEET.mass_per_area * A * B
    assert np.diag(motions.T @ M @ motions) == pytest.approx(
        [mass, mass * A**2 / 3, mass * B**2 / 3], rel=1e-9
    )
    assert np.abs(K @ motions).max() < 1e-9 * np.abs(K).max()


def bicubic(part: Plate) -> np.ndarray:
    """Degrees of freedom of w = x^2 y^3."""
    x, y = part.nodes
    dofs = np.zeros(4 * len(x))
    dofs[part.dofs(np.full(len(x), True))] = x**2 * y**3, 2 * x * y**3, 3 * x**2 * y**2, 6 * x * y**2
    return dofs


def test_rows_are_exact_for_bicubics() -> None:
    part = plate(3)
    x, y = np.array([0.05, 0.4, 0.31]), np.array([0.0, 0.3, 0.07])
    expected = [x**2 * y**3, 2 * x * y**3, 3 * x**2 * y**2]
    assert part.rows(x, y) @ bicubic(part) == pytest.approx(np.array(expected), abs=1e-12)


def test_rows_of_a_foot_are_means_over_it() -> None:
    part, a, b = plate(1), 0.06, 0.04
    w, w_x, w_y = part.foot_rows(0.2, 0.1, a, b) @ bicubic(part)
    x2, x1 = 0.2**2 + a**2 / 12, 0.2
    y3, y2 = 0.1**3 + 0.1 * b**2 / 4, 0.1**2 + b**2 / 12
    assert [w, w_x, w_y] == pytest.approx([x2 * y3, 2 * x1 * y3, 3 * x2 * y2], rel=1e-12)


def turning_compliance(elements: int, size: float) -> float:
    part = plate(elements)
    K = part.elastic().K
    kept = held(part, clamped=True)
    row = part.foot_rows(A / 2, B / 2, size, size)[1, kept]
    return float(row @ solve(K[np.ix_(kept, kept)], row))


def test_a_foot_turns_the_plate_by_a_finite_angle() -> None:
    # Under a couple on a point the turning grows with every finer mesh, as log(1 / le); on a foot it
    # converges.
    growth = [turning_compliance(12, size) / turning_compliance(6, size) - 1 for size in (1e-6, 0.12)]
    assert growth[0] > 0.1
    assert growth[1] < 0.01


def test_mesh_lines_go_through_given_places() -> None:
    lines = mesh_lines(0.39, 14, 0.0254, 0.3646)
    assert {0.0, 0.0254, 0.3646, 0.39} <= set(lines)
    assert np.all(np.diff(lines) > 0)


@pytest.mark.parametrize(("name", "value"), [("E", -1.0), ("rho", 0.0), ("nu", 0.6), ("thickness", 0.0)])
def test_a_sheet_that_cannot_be(name: str, value: float) -> None:
    values = {"E": 70e9, "rho": 2700.0, "nu": 0.3, "thickness": 0.01} | {name: value}
    with pytest.raises(UnphysicalParameter, match=f"sheet: {name} = "):
        Sheet(**values)

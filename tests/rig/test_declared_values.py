"""Figures of the papers and of the reference page, each under its key: none is lost or changed unnoticed.

Transcribed by hand, in the source's units; what a source leaves open and the project chose stands in none.
"""

from __future__ import annotations

from typing import Any

import pytest

from rig.rigs import RIGS
from sim_twin.twin import Twin

BEAM, CRANK, SPATIAL = "impact_beam", "planar_slider_crank", "spatial_slider_crank"
CM, MM, DEG = 1e-2, 1e-3, 3.141592653589793 / 180
ALUMINIUM = {"beam": "aluminium"}
COVERED = {"base": "flexible", "cover": "aluminium"}
Table = tuple[str, str, dict[str, Any], dict[str, float]]

TABLES: list[Table] = [
    (
        "Deck and Dubowsky, table 1, steel beam",
        BEAM,
        {},
        {"beam_length": 28 * CM, "beam_width": 1.9 * CM, "beam_thickness": 0.635 * CM},
    ),
    (
        "Deck and Dubowsky, table 1, aluminium beam",
        BEAM,
        ALUMINIUM,
        {"beam_length": 28 * CM, "beam_width": 1.9 * CM, "beam_thickness": 0.318 * CM},
    ),
    (
        "Deck and Dubowsky, table 1, base plate and cover",
        BEAM,
        COVERED,
        {
            "base_length": 39 * CM,
            "base_width": 30.5 * CM,
            "base_plate_thickness": 1.27 * CM,
            "base_cover_length": 40.1 * CM,
            "base_cover_width": 32 * CM,
            "base_cover_height": 25.9 * CM,
        },
    ),
    (
        "Deck and Dubowsky, table 2, steel beam",
        BEAM,
        {},
        {"contact_stiffness": 1.5e7, "contact_damping": 20},
    ),
    (
        "Deck and Dubowsky, table 2, aluminium beam",
        BEAM,
        ALUMINIUM,
        {"contact_stiffness": 9.6e6, "contact_damping": 7.0},
    ),
    ("Deck and Dubowsky, section 3C", BEAM, {}, {"elements": 37}),
    (
        "Deck and Dubowsky, table 4",
        SPATIAL,
        {},
        {
            "crank_radius": 5 * CM,
            "rod_diameter": 0.64 * CM,
            "rod_length": 19 * CM,
            "guide_half_side": 1.3 * CM / 2,
            "axis_angle": 90 * DEG,
        },
    ),
    (
        "Deck and Dubowsky, table 5",
        SPATIAL,
        {},
        {"socket_stiffness": 2.8e7, "socket_damping": 44, "guide_stiffness": 1.4e7, "guide_damping": 51},
    ),
    ("Deck and Dubowsky, section 4C", SPATIAL, {}, {"rod_modes": 8}),
    (
        "Erkaya, table 1",
        CRANK,
        {},
        {
            "crank_length": 150 * MM,
            "rod_length": 564 * MM,
            "crank_mass": 0.4506,
            "rod_mass": 1.6403,
            "piston_mass": 2.0205,
            "crank_inertia": 1.8e-3,
            "rod_inertia": 9.45e-2,
        },
    ),
    ("Erkaya, section 3", CRANK, {}, {"clearance_1": 1 * MM, "clearance_2": 1 * MM}),
    (
        "reference page, section 1, steel",
        BEAM,
        {},
        {
            "beam_modulus": 207e9,
            "beam_density": 7800,
            "pivot_rotation_stiffness": 0.16,
            "clearance": 0.127 * MM,
            "rest_offset": 0,
            "drive_position": 0.69,
            "modal_damping": 0.01,
            "modes": 15,
            "yoke_frequency": 700,
            "yoke_damping": 0.03,
        },
    ),
    ("reference page, section 1, aluminium", BEAM, ALUMINIUM, {"beam_modulus": 70e9, "beam_density": 2700}),
    (
        "reference page, section 2",
        CRANK,
        {},
        {
            "crank_centre": 0.5,
            "rod_centre": 0.5,
            "gravity": 9.81,
            "restitution": 0.9,
            "approach_floor": 0.01,
            "journal_radius": 10 * MM,
            "joint_modulus": 207e9,
            "joint_poisson": 0.3,
            "friction": 0.01,
            "friction_v_0": 0.1 * MM,
            "friction_v_1": 1 * MM,
            "guide_friction": 0,
            "frame_crank_x_mass": 30,
            "frame_crank_y_mass": 30,
            "frame_piston_y_mass": 30,
            "frame_crank_x_frequency": 180,
            "frame_crank_y_frequency": 230,
            "frame_piston_y_frequency": 310,
            "frame_crank_x_damping": 0.03,
            "frame_crank_y_damping": 0.03,
            "frame_piston_y_damping": 0.03,
        },
    ),
    (
        "reference page, section 3",
        SPATIAL,
        {},
        {
            "socket_clearance": 0.25 * MM,
            "guide_clearance": 0.25 * MM,
            "slider_mass": 0.35,
            "contact_span": 25 * MM,
        },
    ),
]
ROWS = [
    pytest.param(rig, given, key, value, id=f"{source}: {key}")
    for source, rig, given, values in TABLES
    for key, value in values.items()
]


@pytest.mark.parametrize(("rig", "given", "key", "value"), ROWS)
def test_a_figure_of_a_source_is_what_the_rig_has_under_its_key(
    rig: str, given: dict[str, Any], key: str, value: float
) -> None:
    assert RIGS[rig].value(key, given) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize(
    ("rig", "key"),
    [(BEAM, "clearance"), (SPATIAL, "socket_clearance"), (SPATIAL, "guide_clearance")],
)
def test_a_joint_may_have_no_clearance(rig: str, key: str) -> None:
    meaning: Any = RIGS[rig].model[key].meaning
    assert meaning.low == 0
    assert RIGS[rig].value(key, {key: 0.0}) == 0


@pytest.mark.parametrize(
    ("rig", "given", "effect", "values"),
    [
        (
            CRANK,
            {"rod": "flexible", "rod_bending_frequency": 90.0, "rod_bending_damping": 0.02},
            "rod_flexibility",
            {"frequency_hz": 90.0, "damping_ratio": 0.02},
        ),
        (
            SPATIAL,
            {"base": "flexible", "base_frequency": 300.0, "base_mass": 1.5, "base_damping": 0.02},
            "base_flexibility",
            {"frequency_hz": 300.0, "mass_kg": 1.5, "damping_ratio": 0.02},
        ),
    ],
)
def test_what_an_effect_puts_in_may_be_declared_and_is_then_no_effect(
    rig: str, given: dict[str, Any], effect: str, values: dict[str, float]
) -> None:
    kind = RIGS[rig]
    plain, declared = kind.built({}), kind.built(given)
    assert plain == kind.parameters()
    found = plain.model.effects[effect]
    assert declared == found.apply(Twin(plain, None), values).rig
    with pytest.raises(ValueError, match=r"does not exist on this rig .* already"):
        found.apply(Twin(declared, None), values)

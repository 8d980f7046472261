"""What may be wrong that the catalogue does not hold, a little or a lot: in the rig or in its channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi

from benchmarks.blind.changes import Values
from benchmarks.blind.finite_elements import Array
from benchmarks.blind.outsiders import FAULTS, Outside
from benchmarks.blind.spatial.effects import Change, ripple
from benchmarks.blind.spatial.rig import FORCES, POINTS, Contact, Slider, Spatial

__all__ = ["CROSS_TALK", "FAULTS", "MECHANICAL", "MILD", "OUTSIDE", "STRONG"]
CROSS_TALK = "cross_talk"
PRESSED = tuple(f"slider.force_{point}" for point in (1, 3, 5, 7))
"""Where gravity keeps the slider: the other points are hardly ever touched."""
LIVELY = (*PRESSED, "socket.force")
_TYPICAL_DEPTH = 3e-6
"""m, at which a contact with another exponent is as strong as the nominal one: 42 N at a point."""

MILD = (
    Outside("slider_mass", {"scale": (1.1, 1.3)}),
    Outside("pin_above", {"height_m": (3e-4, 8e-4)}),
    Outside("crank_radius", {"scale": (1.02, 1.05)}),
    Outside("tilted_stand", {"flatter_rad": (0.05, 0.12)}),
    Outside("socket_friction", {"coefficient": (0.03, 0.08)}),
    Outside("oil_film", {"damping_ns_per_m": (3.0, 10.0)}),
    Outside("slider_drag", {"damping_ns_per_m": (1.0, 3.0)}),
    Outside("slider_spring", {"stiffness_n_per_m": (20.0, 60.0)}),
    Outside("worn_point", {"depth_m": (1e-5, 4e-5)}, PRESSED),
    Outside("sticking_guide", {"more": (0.5, 1.0), "fading_m_per_s": (0.02, 0.1)}),
    Outside("belt_ripple", {"amplitude": (0.005, 0.015), "order": (6.2, 11.8), "phase_rad": (0.1, 2 * pi)}),
    Outside("contact_exponent", {"exponent": (1.1, 1.2)}),
    Outside("rod_damping", {"scale": (2.0, 4.0)}),
    Outside(CROSS_TALK, {"share": (0.02, 0.06)}),
    Outside("mains_hum", {"amplitude": (0.1, 0.4)}, LIVELY),
    Outside("clipping", {"share_of_largest": (0.65, 0.85)}, LIVELY),
    Outside("dropouts", {"per_s": (0.5, 1.5), "seconds": (0.003, 0.008)}, LIVELY),
    Outside("loose_cable", {"per_s": (0.5, 2.0), "force_n": (5.0, 15.0)}, LIVELY),
    Outside("gain_drift", {"growth_per_s": (0.01, 0.03)}, LIVELY),
)
STRONG = (
    Outside("slider_mass", {"scale": (1.5, 3.0)}),
    Outside("pin_above", {"height_m": (1.5e-3, 4e-3)}),
    Outside("crank_radius", {"scale": (1.1, 1.25)}),
    Outside("tilted_stand", {"flatter_rad": (0.2, 0.45)}),
    Outside("socket_friction", {"coefficient": (0.15, 0.4)}),
    Outside("oil_film", {"damping_ns_per_m": (30.0, 150.0)}),
    Outside("slider_drag", {"damping_ns_per_m": (6.0, 20.0)}),
    Outside("slider_spring", {"stiffness_n_per_m": (150.0, 500.0)}),
    Outside("worn_point", {"depth_m": (8e-5, 2e-4)}, PRESSED),
    Outside("sticking_guide", {"more": (2.0, 5.0), "fading_m_per_s": (0.02, 0.1)}),
    Outside("belt_ripple", {"amplitude": (0.03, 0.06), "order": (6.2, 11.8), "phase_rad": (0.1, 2 * pi)}),
    Outside("contact_exponent", {"exponent": (1.4, 1.6)}),
    Outside("rod_damping", {"scale": (8.0, 20.0)}),
    Outside(CROSS_TALK, {"share": (0.15, 0.4)}),
    Outside("mains_hum", {"amplitude": (1.0, 4.0)}, LIVELY),
    Outside("clipping", {"share_of_largest": (0.25, 0.5)}, LIVELY),
    Outside("dropouts", {"per_s": (2.0, 8.0), "seconds": (0.01, 0.04)}, LIVELY),
    Outside("loose_cable", {"per_s": (3.0, 15.0), "force_n": (10.0, 60.0)}, LIVELY),
    Outside("gain_drift", {"growth_per_s": (0.05, 0.15)}, LIVELY),
)
OUTSIDE = (*MILD, *STRONG)


def _mass(rig: Spatial, values: Values) -> Spatial:
    first, second, third = (values["scale"] * moment for moment in rig.slider.inertia)
    slider = Slider(values["scale"] * rig.slider.mass, (first, second, third), rig.slider.pin)
    return replace(rig, slider=slider)


def _pin(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, slider=replace(rig.slider, pin=(0.0, 0.0, values["height_m"])))


def _worn(rig: Spatial, values: Values) -> Spatial:
    depths = [0.0] * POINTS
    depths[FORCES.index(values["channel"])] = values["depth_m"]
    return replace(rig, worn=tuple(depths))


def _sticking(rig: Spatial, values: Values) -> Spatial:
    friction = replace(rig.friction, more=values["more"], fading=values["fading_m_per_s"])
    return replace(rig, friction=friction)


def _exponent(rig: Spatial, values: Values) -> Spatial:
    power = values["exponent"]

    def bent(contact: Contact) -> Contact:
        return Contact(contact.stiffness * _TYPICAL_DEPTH ** (1 - power), contact.damping, power)

    return replace(rig, socket=bent(rig.socket), guide=bent(rig.guide))


def _rod_damping(rig: Spatial, values: Values) -> Spatial:
    damping = tuple(ratio * values["scale"] for ratio in rig.rod.damping)
    return replace(rig, rod=replace(rig.rod, damping=damping))


MECHANICAL: Mapping[str, Change] = {
    "slider_mass": _mass,
    "pin_above": _pin,
    "crank_radius": lambda rig, v: replace(rig, crank_radius=rig.crank_radius * v["scale"]),
    "tilted_stand": lambda rig, v: replace(rig, incline=rig.incline - v["flatter_rad"]),
    "socket_friction": lambda rig, v: replace(rig, socket_friction=v["coefficient"]),
    "oil_film": lambda rig, v: replace(rig, film=v["damping_ns_per_m"]),
    "slider_drag": lambda rig, v: replace(rig, drag=v["damping_ns_per_m"]),
    "slider_spring": lambda rig, v: replace(rig, spring=v["stiffness_n_per_m"]),
    "worn_point": _worn,
    "sticking_guide": _sticking,
    "belt_ripple": ripple,
    "contact_exponent": _exponent,
    "rod_damping": _rod_damping,
}


def crossed(forces: dict[str, Array], share: float) -> dict[str, Array]:
    """Each channel with a share of the one that its cable lies beside."""
    names = list(forces)
    return {name: forces[name] + share * forces[names[i - 1]] for i, name in enumerate(names)}

"""What may be wrong that the catalogue does not hold, a little or a lot: in the rig or in its channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from benchmarks.blind.changes import Values
from benchmarks.blind.finite_elements import Array
from benchmarks.blind.outsiders import ANY_PHASE, FAULTS, Outside, of_channels, outside
from benchmarks.blind.pages import (
    EXPONENT,
    MODES_OFF,
    STRIBECK,
    detuned,
    exponent_of,
    wrong_values,
)
from benchmarks.blind.spatial.effects import Change, ripple
from benchmarks.blind.spatial.rig import FORCES, POINTS, Contact, Slider, Spatial

__all__ = ["CROSS_TALK", "FAULTS", "MECHANICAL", "MILD", "PAGES", "STRONG"]
CROSS_TALK = "cross_talk"
PRESSED = tuple(f"slider.force_{point}" for point in (1, 3, 5, 7))
"""Where gravity keeps the slider: the other points are hardly ever touched."""
LIVELY = (*PRESSED, "socket.force")
_TYPICAL_DEPTH = 3e-6
"""m, at which a contact with another exponent is as strong as the nominal one: 42 N at a point."""

STRONG = (
    outside("slider_mass", "guide", also=("joints", "model"), scale=(1.5, 3.0)),
    outside("pin_above", "guide", also=("rod", "joints"), height_m=(1.5e-3, 4e-3)),
    outside("crank_radius", "drive", also=("socket", "model"), scale=(1.1, 1.25)),
    outside("tilted_stand", "base", also=("guide",), flatter_rad=(0.2, 0.45)),
    outside("socket_friction", "socket", also=("joints",), coefficient=(0.15, 0.4)),
    outside("oil_film", "socket", also=("joints",), damping_ns_per_m=(30.0, 150.0)),
    outside("slider_drag", "guide", damping_ns_per_m=(6.0, 20.0)),
    outside("slider_spring", "guide", stiffness_n_per_m=(150.0, 500.0)),
    outside("worn_point", "guide", PRESSED, depth_m=(8e-5, 2e-4)),
    outside("sticking_guide", "guide", more=(2.0, 5.0), fading_m_per_s=(0.02, 0.1)),
    outside("belt_ripple", "drive", amplitude=(0.03, 0.06), order=(6.2, 11.8), phase_rad=ANY_PHASE),
    outside("contact_exponent", "joints", also=("socket", "guide"), exponent=(1.4, 1.6)),
    outside("rod_damping", "rod", scale=(8.0, 20.0)),
    outside(CROSS_TALK, "sensor", share=(0.15, 0.4)),
    *of_channels(LIVELY, True, (1.0, 4.0), (10.0, 60.0)),
)
MILD = (
    outside("slider_mass", "guide", also=("joints", "model"), scale=(1.1, 1.3)),
    outside("pin_above", "guide", also=("rod", "joints"), height_m=(3e-4, 8e-4)),
    outside("crank_radius", "drive", also=("socket", "model"), scale=(1.02, 1.05)),
    outside("tilted_stand", "base", also=("guide",), flatter_rad=(0.05, 0.12)),
    outside("socket_friction", "socket", also=("joints",), coefficient=(0.03, 0.08)),
    outside("oil_film", "socket", also=("joints",), damping_ns_per_m=(3.0, 10.0)),
    outside("slider_drag", "guide", damping_ns_per_m=(1.0, 3.0)),
    outside("slider_spring", "guide", stiffness_n_per_m=(20.0, 60.0)),
    outside("worn_point", "guide", PRESSED, depth_m=(1e-5, 4e-5)),
    outside("sticking_guide", "guide", more=(0.5, 1.0), fading_m_per_s=(0.02, 0.1)),
    outside("belt_ripple", "drive", amplitude=(0.005, 0.015), order=(6.2, 11.8), phase_rad=ANY_PHASE),
    outside("contact_exponent", "joints", also=("socket", "guide"), exponent=(1.1, 1.2)),
    outside("rod_damping", "rod", scale=(2.0, 4.0)),
    outside(CROSS_TALK, "sensor", share=(0.02, 0.06)),
    *of_channels(LIVELY, False, (0.1, 0.4), (5.0, 15.0)),
)


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
        stiffness = exponent_of(contact.stiffness, contact.exponent, power, _TYPICAL_DEPTH)
        return Contact(stiffness, contact.damping, power)

    return replace(rig, socket=bent(rig.socket), guide=bent(rig.guide))


def _scaled(field: str) -> Change:
    return lambda rig, values: replace(rig, **{field: getattr(rig, field) * values["scale"]})


def _thicker(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, rod=replace(rig.rod, diameter=rig.rod.diameter * values["scale"]))


def _detuned(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, rod=replace(rig.rod, detuned=detuned(values, len(rig.rod.damping))))


def _rod_damping(rig: Spatial, values: Values) -> Spatial:
    damping = tuple(ratio * values["scale"] for ratio in rig.rod.damping)
    return replace(rig, rod=replace(rig.rod, damping=damping))


_VALUES: Mapping[str, tuple[float, float, Change]] = {
    "crank_radius": (0.015, 0.04, _scaled("crank_radius")),
    "rod_diameter": (0.02, 0.06, _thicker),
    "contact_span": (0.04, 0.12, _scaled("span")),
    "slider_mass": (0.04, 0.12, _mass),
}
"""Keys of [model]: by how much somebody may have them wrong, of one, and what that is in the rig."""

PAGES: Mapping[str, Sequence[Outside]] = {
    "exponent": (EXPONENT,),
    "modes": (MODES_OFF,),
    "friction": (STRIBECK,),
    "value": wrong_values(_VALUES),
}

MECHANICAL: Mapping[str, Change] = {
    "slider_mass": _mass,
    "pin_above": _pin,
    "crank_radius": _scaled("crank_radius"),
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
    EXPONENT.name: _exponent,
    MODES_OFF.name: _detuned,
    STRIBECK.name: _sticking,
    **{f"wrong_{key}": change for key, (_, _, change) in _VALUES.items()},
}


def crossed(forces: dict[str, Array], share: float) -> dict[str, Array]:
    """Each channel with a share of the one that its cable lies beside."""
    names = list(forces)
    return {name: forces[name] + share * forces[names[i - 1]] for i, name in enumerate(names)}

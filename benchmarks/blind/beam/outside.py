"""Effects that the catalogue does not hold, in the rig and in a channel's electronics; wrong pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind.beam.effects import Change, Values, both
from benchmarks.blind.beam.rig import Rig, Stop, Tone
from benchmarks.blind.beam.structure import MODES
from benchmarks.blind.outsiders import FAULTS, Outside, either_way, of_channels, outside
from benchmarks.blind.pages import EXPONENT, MODES_OFF, detuned, exponent_of, wrong_values

__all__ = ["CHANGES", "FAULTS", "MILD", "PAGES", "STRONG"]

FORCES = ("contact.force_upper", "contact.force_lower", "yoke.force")
_TYPICAL_DEPTH = 2e-6
"""m, at which a contact with another exponent is as strong as the nominal one: 30 N."""

STRONG = (
    outside("uneven_stops", "contact joint", lower_stiffness_scale=(0.02, 0.1), lower_gap_scale=(1.3, 1.8)),
    outside("hardening_spring", "beam", also=("contact joint",), force_at_stop_n=(1.5, 5.0)),
    outside("sticky_contact", "contact joint", pull_n=(1.5, 6.0)),
    outside("padded_stops", "contact joint", share=(0.01, 0.05), depth_m=(5e-6, 25e-6)),
    outside("tip_mass", "beam", also=("contact joint",), mass_kg=(0.02, 0.1)),
    outside("tip_drag", "beam", also=("contact joint",), damping_ns_per_m=(4.0, 15.0)),
    outside("drive_position", "drive", also=("beam",), scale=either_way(0.1, 0.2)),
    outside("drive_modulation", "drive", depth=(0.25, 0.6), frequency_hz=(0.6, 2.5)),
    outside("foreign_vibration", "drive", also=("beam",), force_n=(1.5, 5.0), frequency_hz=(47.0, 170.0)),
    outside("warming_gap", "contact joint", growth_per_s=(0.07, 0.2)),
    outside("second_head_mode", "sensor", also=("base",), frequency_hz=(180.0, 500.0), share=(0.4, 0.8)),
    outside("cross_talk", "sensor", share=(0.1, 0.4)),
    *of_channels(FORCES, True, (1.0, 4.0), (10.0, 60.0)),
)
MILD = (
    outside("uneven_stops", "contact joint", lower_stiffness_scale=(0.4, 0.7), lower_gap_scale=(1.05, 1.15)),
    outside("hardening_spring", "beam", also=("contact joint",), force_at_stop_n=(0.3, 1.0)),
    outside("sticky_contact", "contact joint", pull_n=(0.3, 1.0)),
    outside("padded_stops", "contact joint", share=(0.2, 0.5), depth_m=(2e-6, 6e-6)),
    outside("tip_mass", "beam", also=("contact joint",), mass_kg=(0.004, 0.012)),
    outside("tip_drag", "beam", also=("contact joint",), damping_ns_per_m=(0.8, 2.5)),
    outside("drive_position", "drive", also=("beam",), scale=either_way(0.03, 0.07)),
    outside("drive_modulation", "drive", depth=(0.05, 0.12), frequency_hz=(0.6, 2.5)),
    outside("foreign_vibration", "drive", also=("beam",), force_n=(0.3, 1.0), frequency_hz=(47.0, 170.0)),
    outside("warming_gap", "contact joint", growth_per_s=(0.015, 0.04)),
    outside("second_head_mode", "sensor", also=("base",), frequency_hz=(180.0, 500.0), share=(0.08, 0.2)),
    outside("cross_talk", "sensor", share=(0.02, 0.06)),
    *of_channels(FORCES, False, (0.1, 0.4), (5.0, 15.0)),
)


def _uneven(rig: Rig, values: Values) -> Rig:
    stop = rig.lower
    gap, stiffness = stop.gap * values["lower_gap_scale"], stop.stiffness * values["lower_stiffness_scale"]
    return replace(rig, lower=replace(stop, gap=gap, stiffness=stiffness))


def _hardening(rig: Rig, values: Values) -> Rig:
    return replace(rig, cubic=values["force_at_stop_n"] / rig.upper.gap**3)


def _sticky(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, pull=values["pull_n"]))


def _padded(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, pad=(values["share"], values["depth_m"])))


def _tip_mass(rig: Rig, values: Values) -> Rig:
    return replace(rig, beam=replace(rig.beam, tip_mass=values["mass_kg"]))


def _tip_drag(rig: Rig, values: Values) -> Rig:
    return replace(rig, drag=values["damping_ns_per_m"])


def _modulation(rig: Rig, values: Values) -> Rig:
    """A (1 + depth sin q) sin p, as three tones."""
    half, f = values["depth"] / 2, values["frequency_hz"]
    sides = (
        Tone(sign * half * tone.amplitude, tone.frequency + side * f, tone.phase + np.pi / 2)
        for tone in rig.tones
        for sign, side in ((1, -1), (-1, 1))
    )
    return replace(rig, tones=(*rig.tones, *sides))


def _vibration(rig: Rig, values: Values) -> Rig:
    """A force beside the coil's: it shakes the beam and is not in `drive.force`."""
    return replace(rig, foreign=(Tone(values["force_n"], values["frequency_hz"], 1.0),))


def _warming(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, drift=values["growth_per_s"]))


def _head(rig: Rig, values: Values) -> Rig:
    return replace(rig, second_head=(values["frequency_hz"], values["share"]))


def _cross_talk(rig: Rig, values: Values) -> Rig:
    return replace(rig, cross_talk=values["share"])


def _exponent(rig: Rig, values: Values) -> Rig:
    def bent(stop: Stop) -> Stop:
        stiffness = exponent_of(stop.stiffness, stop.exponent, values["exponent"], _TYPICAL_DEPTH)
        return replace(stop, stiffness=stiffness, exponent=values["exponent"])

    return both(rig, bent)


def _scaled(field: str) -> Change:
    def change(rig: Rig, values: Values) -> Rig:
        value = getattr(rig.beam, field) * values["scale"]
        return replace(rig, beam=replace(rig.beam, **{field: value}))

    return change


_VALUES: Mapping[str, tuple[float, float, Change]] = {
    "beam_length": (0.015, 0.04, _scaled("length")),
    "beam_thickness": (0.02, 0.05, _scaled("thickness")),
    "beam_modulus": (0.05, 0.15, _scaled("modulus")),
    "drive_position": (0.03, 0.08, _scaled("drive_at")),
    "yoke_frequency": (0.06, 0.2, lambda rig, values: replace(rig, head=rig.head * values["scale"])),
}
"""Keys of [model]: by how much somebody may have them wrong, of one, and what that is in the rig."""

PAGES: Mapping[str, Sequence[Outside]] = {
    "exponent": (EXPONENT,),
    "modes": (MODES_OFF,),
    "value": wrong_values(_VALUES),
}

CHANGES: Mapping[str, Change] = {
    "uneven_stops": _uneven,
    "hardening_spring": _hardening,
    "sticky_contact": _sticky,
    "padded_stops": _padded,
    "tip_mass": _tip_mass,
    "tip_drag": _tip_drag,
    "drive_position": _scaled("drive_at"),
    "drive_modulation": _modulation,
    "foreign_vibration": _vibration,
    "warming_gap": _warming,
    "second_head_mode": _head,
    "cross_talk": _cross_talk,
    EXPONENT.name: _exponent,
    MODES_OFF.name: lambda rig, values: replace(rig, beam=replace(rig.beam, detuned=detuned(values, MODES))),
    **{f"wrong_{key}": change for key, (_, _, change) in _VALUES.items()},
}

"""Effects that the catalogue does not hold, in the rig and in a channel's electronics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from benchmarks.blind.beam.effects import Change, Values, both
from benchmarks.blind.beam.rig import Rig, Tone
from benchmarks.blind.outsiders import FAULTS, Outside

__all__ = ["FAULTS", "Outside"]

FORCES = ("contact.force_upper", "contact.force_lower", "yoke.force")


OUTSIDE = (
    Outside("uneven_stops", {"lower_stiffness_scale": (0.02, 0.1), "lower_gap_scale": (1.3, 1.8)}),
    Outside("hardening_spring", {"force_at_stop_n": (1.5, 5.0)}),
    Outside("sticky_contact", {"pull_n": (1.5, 6.0)}),
    Outside("padded_stops", {"share": (0.01, 0.05), "depth_m": (5e-6, 25e-6)}),
    Outside("tip_mass", {"mass_kg": (0.02, 0.1)}),
    Outside("drive_modulation", {"depth": (0.25, 0.6), "frequency_hz": (0.6, 2.5)}),
    Outside("foreign_vibration", {"force_n": (1.5, 5.0), "frequency_hz": (47.0, 170.0)}),
    Outside("warming_gap", {"growth_per_s": (0.07, 0.2)}),
    Outside("second_head_mode", {"frequency_hz": (180.0, 500.0), "share": (0.4, 0.8)}),
    Outside("cross_talk", {"share": (0.1, 0.4)}),
    Outside("mains_hum", {"amplitude": (1.0, 4.0)}, FORCES),
    Outside("clipping", {"share_of_largest": (0.25, 0.6)}, FORCES),
    Outside("dropouts", {"per_s": (2.0, 8.0), "seconds": (0.01, 0.04)}, FORCES),
    Outside("loose_cable", {"per_s": (3.0, 15.0), "force_n": (10.0, 60.0)}, FORCES),
    Outside("gain_drift", {"growth_per_s": (0.05, 0.15)}, FORCES),
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


CHANGES: Mapping[str, Change] = {
    "uneven_stops": _uneven,
    "hardening_spring": _hardening,
    "sticky_contact": _sticky,
    "padded_stops": _padded,
    "tip_mass": _tip_mass,
    "drive_modulation": _modulation,
    "foreign_vibration": _vibration,
    "warming_gap": _warming,
    "second_head_mode": _head,
    "cross_talk": _cross_talk,
}

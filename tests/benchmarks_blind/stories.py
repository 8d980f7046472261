"""Campaigns and answers made up so that every figure is known by hand."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.cases import Answer, Case, Estimate, Gaps, Ranked
from benchmarks.blind.catalogue import BEAM, CATALOGUE, EffectEntry
from benchmarks.blind.sets import Kind

CLEARANCE: EffectEntry = {"name": "clearance", "parameters": {"scale": 1.5}}
DAMPING: EffectEntry = {"name": "contact_damping", "parameters": {"scale": 10.0}}
GAIN: EffectEntry = {"name": "sensor_gain", "parameters": {"channel": "yoke.force", "gain": 1.2}}
OUTSIDER: EffectEntry = {"name": "loose_cable", "parameters": {"rate": 3.0}}


def campaign(
    kind: Kind, *effects: EffectEntry, name: str = "c000", runs: int = 1, of_set: str = "singles"
) -> Campaign:
    """A campaign on the beam."""
    point: dict[str, float | str] = {"beam": "steel", "frequency": 20.0, "duration": 5.0}
    return Campaign(name, BEAM, kind, (point,) * runs, effects, 1, tuple(range(runs)), of_set)


def answer(
    probabilities: Mapping[str, float],
    alike: tuple[str, ...] = (),
    parameters: Mapping[str, Estimate] | None = None,
    selected: tuple[str, ...] = (),
    shrinks: Mapping[str, float] | None = None,
) -> Answer:
    """An answer; `alike` and `parameters` belong to its most probable effect."""
    catalogue = CATALOGUE[BEAM]
    order = sorted(catalogue, key=lambda name: -probabilities.get(name, 0.0))
    effects = tuple(
        Ranked(
            name,
            catalogue[name].location,
            probabilities.get(name, 0.0),
            (shrinks or {}).get(name),
            (parameters or {}) if name == order[0] else {},
            alike if name == order[0] else (),
        )
        for name in order
    )
    return Answer(probabilities.get("none", 0.0), probabilities.get("unknown", 0.0), effects, selected)


def case(kind: Kind, said: Answer | None, *effects: EffectEntry, gaps: Gaps | None = None) -> Case:
    """A case of one run."""
    return Case(campaign(kind, *effects), said, gaps, 50.0)

"""The twin that a scenario describes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from daq.channel import Channel
from daq.errors import ConfigurationError, Problem
from rig.files.effects_file import Catalogue, ParameterRange, load_effects
from rig.files.scenario import Scenario
from sim_twin.effects import IMPACT_BEAM, apply_effects
from sim_twin.healthy import nominal_sensors
from sim_twin.rigs.impact_beam.channels import channel_unit, stations_of
from sim_twin.rigs.impact_beam.model import FLEXURE_TRANSLATION, ImpactBeam, SineDrive, nominal
from sim_twin.rigs.impact_beam.twin import BeamTwin

_TAKEN_AS_THEY_ARE = (
    "clearance",
    "rest_offset",
    "contact_stiffness",
    "contact_damping",
    "drive_position",
    "shaker_mass",
    "shaker_stiffness",
    "shaker_damping",
)


def twin_of(scenario: Scenario, channels: Iterable[str] = ()) -> BeamTwin:
    """Return the nominal twin of `scenario`, with an accelerometer for each station among `channels`."""
    section = scenario.model
    given = {name: getattr(section, name) for name in _TAKEN_AS_THEY_ARE}
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if section.flexure_translation:
        changes["pivot_stiffness"] = FLEXURE_TRANSLATION
    rig: ImpactBeam = dataclasses.replace(_beam(scenario), stations=stations_of(tuple(channels)), **changes)
    drive = SineDrive(scenario.drive.amplitude, scenario.drive.frequency, scenario.drive.offset)
    return BeamTwin(rig, drive, nominal_sensors(rig))


def _beam(scenario: Scenario) -> ImpactBeam:
    section = scenario.model
    choices: dict[str, Any] = {
        "beam": section.beam,
        "modes": section.modes,
        "elements": section.elements,
        "damping": section.modal_damping,
    }
    return nominal(**{name: value for name, value in choices.items() if value is not None})


def predicted_channels(twin: BeamTwin) -> tuple[Channel, ...]:
    """What the twin's rows are, as a log describes them."""
    return tuple(describe(name) for name in twin.channels)


def describe(name: str) -> Channel:
    """A channel of the impact beam with its unit, quantity and location."""
    location, _, quantity = name.partition(".")
    return Channel(name, channel_unit(name), quantity.split("_")[0], location)


def catalogue() -> Catalogue:
    """The effects that a file may name, with the ranges of their parameters."""
    table: dict[str, Mapping[str, ParameterRange]] = {}
    for effect in IMPACT_BEAM.values():
        ranges = {p.name: ParameterRange(p.intervals, p.unit) for p in effect.parameters}
        if effect.channels:
            ranges["channel"] = ParameterRange((), words=effect.channels)
        table[effect.name] = ranges
    return table


def with_effects(twin: BeamTwin, path: Path) -> BeamTwin:
    """Return `twin` with the effects of a file in; raises ConfigurationError with every fault of the file."""
    effects = load_effects(path, catalogue())
    try:
        return apply_effects(twin, effects)
    except ValueError as error:
        raise ConfigurationError(str(path), [Problem("effects", path.name, str(error))]) from error

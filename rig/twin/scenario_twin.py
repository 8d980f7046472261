"""The twin that a scenario describes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from daq.channel import Channel
from daq.errors import ConfigurationError, Problem, UnphysicalParameter
from rig.files.effects_file import Catalogue, ParameterRange, parse_effects
from rig.files.faults import read_text
from rig.files.scenario import Scenario
from rig.twin.rigs import KINDS
from sim_twin.rigs.catalogue import model_of
from sim_twin.rigs.rig_model import RigModel
from sim_twin.sensors import oversampling
from sim_twin.twin import AnyTwin


def twin_of(scenario: Scenario, channels: Iterable[str] = ()) -> AnyTwin:
    """Return the nominal twin of `scenario`; `channels` are those that a bench measures.

    Raises ConfigurationError for parameters that no rig can have.
    """
    try:
        return KINDS[scenario.rig].build(scenario.model, scenario.drive, tuple(channels))
    except UnphysicalParameter as error:
        raise _as_fault(error, scenario) from error


def check_twin(scenario: Scenario) -> None:
    """Raise ConfigurationError for a scenario that no twin can be set up for."""
    twin = twin_of(scenario)
    try:
        rate = scenario.acquisition.sample_rate
        model_of(twin).truth(twin, rate * oversampling(rate), False)
    except UnphysicalParameter as error:
        raise _as_fault(error, scenario) from error


def _as_fault(error: UnphysicalParameter, scenario: Scenario) -> ConfigurationError:
    fault = Problem(f"model.{error.name}", f"{error.value:g}", error.allowed)
    return ConfigurationError(scenario.name, [fault])


def predicted_channels(twin: AnyTwin) -> tuple[Channel, ...]:
    """What the twin's rows are, as a log describes them."""
    unit = model_of(twin).channel_unit
    return tuple(_described(name, unit(name)) for name in twin.channels)


def _described(name: str, unit: str) -> Channel:
    location, _, quantity = name.partition(".")
    return Channel(name, unit, quantity.split("_")[0], location)


def catalogue_of(model: RigModel) -> Catalogue:
    """The effects that a file may name for a rig, with the ranges of their parameters."""
    table: dict[str, Mapping[str, ParameterRange]] = {}
    for effect in model.effects.values():
        ranges = {p.name: ParameterRange(p.intervals, p.unit) for p in effect.parameters}
        if effect.channels:
            ranges["channel"] = ParameterRange((), words=effect.channels)
        table[effect.name] = ranges
    return table


def with_effects(twin: AnyTwin, path: Path) -> AnyTwin:
    """Return `twin` with the effects of a file in; raises ConfigurationError with every fault of the file."""
    return with_effects_of(twin, read_text(path), str(path))


def with_effects_of(twin: AnyTwin, text: str, source: str) -> AnyTwin:
    """Return `twin` with the effects of an effects file's `text` in; raises like `with_effects`."""
    model = model_of(twin)
    effects = parse_effects(text, source, catalogue_of(model))
    try:
        return model.with_effects(twin, effects)
    except ValueError as error:
        raise ConfigurationError(source, [Problem("effects", "(together)", str(error))]) from error

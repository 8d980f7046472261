"""The twin that a scenario describes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from daq.channel import Channel
from daq.errors import ConfigurationError, Problem, UnphysicalParameter
from rig.files.effects_file import parse_effects
from rig.files.faults import read_text
from rig.files.scenario import Scenario
from rig.files.table import NOTHING
from rig.rigs import RIGS
from rig.twin.chains import with_chains
from sim_twin.rigs.channel_table import ENCODER_ANGLE
from sim_twin.sensors import oversampling
from sim_twin.twin import AnyTwin


def twin_of(scenario: Scenario, channels: Iterable[str] = (), chains: Mapping[str, str] = NOTHING) -> AnyTwin:
    """Return the nominal twin of `scenario`; `channels` are those that a bench measures.

    `chains` is a `run` record, or as much of one as `rig.twin.chains` makes of a bench. Raises
    ConfigurationError for parameters that no rig can have, LogError for a record that cannot be read.
    """
    try:
        twin = RIGS[scenario.rig].twin(scenario.model, scenario.drive, tuple(channels))
        twin = replace(twin, widths=scenario.widths, besides=scenario.besides)
    except UnphysicalParameter as error:
        raise _as_fault(error, scenario) from error
    return with_chains(twin, chains)


def check_twin(scenario: Scenario) -> None:
    """Raise ConfigurationError for a scenario that no twin can be set up for."""
    twin = twin_of(scenario)
    try:
        rate = scenario.acquisition.sample_rate
        twin.model.truth(twin, rate * oversampling(rate), False)
    except UnphysicalParameter as error:
        raise _as_fault(error, scenario) from error


def _as_fault(error: UnphysicalParameter, scenario: Scenario) -> ConfigurationError:
    fault = Problem(f"model.{error.name}", f"{error.value:g}", error.allowed)
    return ConfigurationError(scenario.name, [fault])


def predicted_channels(twin: AnyTwin) -> tuple[Channel, ...]:
    """What the twin's rows are, as a log describes them, and an encoder beside them that it knows."""
    declared = twin.model.channels
    beside = (ENCODER_ANGLE,) if ENCODER_ANGLE.name in twin.sensors else ()
    return tuple(each.described for each in (*(declared[name] for name in twin.channels), *beside))


def with_effects(twin: AnyTwin, source: str | Path, text: str | None = None) -> AnyTwin:
    """Return `twin` with the effects of an effects file in, or of a `text` that is in `source`.

    Raises ConfigurationError with every fault of it.
    """
    catalogue = twin.model.effects
    effects = parse_effects(read_text(source) if text is None else text, str(source), catalogue)
    try:
        for name, values in effects:
            twin = catalogue[name].apply(twin, values)
    except ValueError as error:
        raise ConfigurationError(str(source), [Problem("effects", "(together)", str(error))]) from error
    return twin

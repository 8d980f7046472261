"""The twin of a recorded run: the scenario, effects and model that its log names, in step with it."""

from __future__ import annotations

from daq.errors import LogError
from daq.log.reader import LogReader
from rig.files.model_file import parse_model
from rig.files.scenario import Scenario, parse_scenario
from rig.twin.alignment import Alignment
from rig.twin.matched_twin import with_model
from rig.twin.rigs import kind_of
from rig.twin.scenario_twin import twin_of, with_effects_of
from sim_twin.twin import AnyTwin

DWELLS = "dwells"
"""Key of the `run` record under which a log says that it has several speeds, and which."""


def scenario_of(log: LogReader) -> Scenario:
    """The scenario that a log holds; raises LogError where there is none."""
    if not log.scenario:
        raise LogError(f"{log.path}: no scenario in it; rattle cannot know what was run")
    return parse_scenario(log.scenario, f"scenario in {log.path}")


def followed_scenario(log: LogReader) -> Scenario:
    """The scenario that a twin can follow; raises LogError also where the log has several speeds."""
    dwells = log.metadata.get("run", {}).get(DWELLS)
    if dwells:
        raise LogError(
            f"{log.path}: recorded at several speeds ({dwells}), which no twin follows; see rattle skew"
        )
    return scenario_of(log)


def predicting_twin(log: LogReader, scenario: Scenario) -> AnyTwin:
    """The twin that made the log's predictions: with the effects and the model that its record names."""
    twin, record = twin_of(scenario, log.channels("measured")), log.metadata.get("twin", {})
    if "model" in record:
        fitted = parse_model(record["model"], f"model in {log.path}", scenario.rig)
        twin = with_model(twin, fitted, lambda _: None)  # it was told when the prediction was made
    return with_effects_of(twin, record.get("effects", "[]"), f"effects in {log.path}")


def align_to(log: LogReader, twin: AnyTwin, until_s: float | None = None) -> Alignment:
    """Phase and mean frequency that the log's reference channel shows (within its first `until_s`)."""
    measured = log.channels("measured")
    reference = kind_of(twin).reference(measured)
    if reference.channel not in measured:
        return kind_of(twin).untouched(twin.drive)
    if until_s is not None:
        until_s = max(until_s, reference.cycles / kind_of(twin).untouched(twin.drive).frequency)
    seen = log.series("measured", reference.channel, end_s=until_s)
    return reference.align(seen.values, seen.sample_rate, seen.first_sample, twin.drive)

"""The twin of a recorded run, in step with it, and a twin as a calibration found its rig."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isclose

from daq.errors import ConfigurationError, LogError, Problem, UnphysicalParameter
from daq.log.reader import LogReader
from rig.files.faults import Faults
from rig.files.lab_tolerances import in_words, lab_tolerances
from rig.files.model_file import Identified, ModelFile, as_identified, model_text, parse_model
from rig.files.scenario import Scenario, parse_scenario
from rig.files.table import NOTHING
from rig.rigs import RIGS
from rig.twin.alignment import Alignment, reference_among, untouched
from rig.twin.scenario_twin import twin_of, with_effects
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.discrepancy import Discrepancy
from sim_twin.diagnosis.matching import matched_campaign
from sim_twin.healthy import Matched, Tolerance
from sim_twin.twin import AnyTwin

_ALIKE = 1e-6


def with_model(twin: AnyTwin, model: ModelFile, scenario: Scenario, warn: Callable[[str], None]) -> AnyTwin:
    """Return the `twin` of a scenario as `model` says that its rig is.

    `warn` is told what of it does not hold here. Raises ConfigurationError for what cannot hold at all.
    """
    twin = with_values(twin, model, scenario, warn)
    return twin.model.matched(twin, carried(model, [twin], warn))


def campaign_with_model(
    campaign: Campaign, model: ModelFile, scenarios: Sequence[Scenario], warn: Callable[[str], None]
) -> Campaign:
    """The same runs, each of its scenario, of a rig that `model` was fitted to."""
    told: dict[str, None] = {}
    twins = [
        with_values(run.twin, model, scenario, lambda text: told.update({text: None}))
        for run, scenario in zip(campaign.runs, scenarios, strict=True)
    ]
    for text in told:
        warn(text)
    runs = [replace(run, twin=twin) for run, twin in zip(campaign.runs, twins, strict=True)]
    known = replace(campaign, runs=tuple(runs), discrepancies=model.discrepancies)
    return matched_campaign(known, carried(model, twins, warn))


def with_values(twin: AnyTwin, model: ModelFile, scenario: Scenario, warn: Callable[[str], None]) -> AnyTwin:
    """Return the `twin` of a scenario with the values of a model in, and as wide as its lab's rigs are.

    A value of which the scenario says something else than those of the model's runs did is another by now.
    """
    kind, given = RIGS[scenario.rig], scenario.model
    # not refused here: a spread is of several rigs about one's values, a log keeps what made its prediction
    if model.of_another(scenario.specimen):
        warn(f"the model is of another specimen, {model.specimen}; this is {scenario.specimen}")
    held = held_values(model, scenario)
    if other := [key for key in model.model if key not in held]:
        warn(f"not as the runs of the model had it, so the scenario's value holds: {', '.join(other)}")
    try:
        rig = kind.changed(twin.rig, given, held)
    except UnphysicalParameter as error:
        fault = Problem(f"model.{error.name}", f"{error.value:g}", error.allowed)
        raise ConfigurationError(f"model in {scenario.name}", [fault]) from error
    faults = Faults("model")
    widths, besides = lab_tolerances(kind, given, {**model.besides, **model.lab}, faults)
    faults.raise_if_any()
    own = {each.name: each for each in (*twin.besides, *besides)}
    widths = {**twin.widths, **model.widths, **widths}
    return replace(twin, rig=rig, widths=widths, besides=tuple(own[name] for name in sorted(own)))


def held_values(model: ModelFile, scenario: Scenario) -> dict[str, float]:
    """The values of a model that hold for a scenario: which says of them what those of its runs did."""
    kind, found = RIGS[scenario.rig], model.identified
    values = ((key, kind.value(key, scenario.model)) for key in model.model)
    return {key: model.model[key] for key, value in values if _same(value, found[key])}


def _same(value: float | None, found: Identified) -> bool:
    if value is None or found.was is None:
        return value is found.was
    return isclose(value, found.was, rel_tol=_ALIKE)


def carried(model: ModelFile, twins: Sequence[AnyTwin], warn: Callable[[str], None]) -> Matched:
    """What `model` says of a rig with these nominal twins: a part that was changed since is another part."""
    tables = [{each.name: each.value(twin) for each in twin.model.lasting_tolerances(twin)} for twin in twins]
    there = [name for name in model.matched.names if all(name in values for values in tables)]
    other = [
        name
        for name in there
        if not all(isclose(values[name], model.nominals[name], rel_tol=_ALIKE) for values in tables)
    ]
    if other:
        warn(f"not as it was calibrated, so its tolerance is open again: {', '.join(other)}")
    return model.matched.only([name for name in there if name not in other])


def as_model_text(
    twin: AnyTwin,
    matched: Matched,
    runs: Sequence[str],
    scenarios: Sequence[str],
    before: ModelFile | None = None,
    discrepancies: Sequence[Discrepancy] = (),
    specimen: str | None = None,
) -> str:
    """The model file that says how the rig of the nominal `twin` was found, and what was known `before`."""
    known = [each for each in twin.model.lasting_tolerances(twin) if each.name in matched.names]
    nominals = {each.name: each.value(twin) for each in known}
    remarks = {each.name: found(each, twin, matched) for each in known}
    lines = [] if before is None else as_identified(before)
    widths = {each.name: twin.widths[each.name] for each in known if each.name in twin.widths}
    besides = {each.name: in_words(each, each.deviation, digits=6) for each in twin.besides}
    return model_text(
        twin.model.name,
        runs,
        scenarios,
        nominals,
        matched,
        remarks,
        widths,
        besides,
        lines,
        discrepancies,
        specimen,
    )


def found(tolerance: Tolerance, twin: AnyTwin, matched: Matched) -> str:
    """In physical terms: the value, and how far it is still open."""
    at = matched.names.index(tolerance.name)
    mean, open_by = matched.mean[at], matched.deviation[at]
    value = tolerance.value(tolerance.off(twin, float(mean)))
    scale = abs(tolerance.value(twin)) if tolerance.relative else 1.0
    return f"{value:.5g} +- {tolerance.deviation * open_by * scale:.2g} {tolerance.unit}".rstrip()


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


def logged_twin(log: LogReader, scenario: Scenario) -> AnyTwin:
    """The nominal twin of a log, seen by what it says of its chains."""
    return twin_of(scenario, log.channels("measured"), log.metadata.get("run", NOTHING))


def predicting_twin(log: LogReader, scenario: Scenario) -> AnyTwin:
    """The twin that made the log's predictions: with the effects and the model that its record names."""
    twin, record = logged_twin(log, scenario), log.metadata.get("twin", {})
    if "model" in record:
        fitted = parse_model(record["model"], f"model in {log.path}", scenario.rig)
        twin = with_model(
            twin, fitted, scenario_of(log), lambda _: None
        )  # it was told when the prediction was made
    return with_effects(twin, f"effects in {log.path}", record.get("effects", "[]"))


def align_to(log: LogReader, twin: AnyTwin, until_s: float | None = None) -> Alignment:
    """Phase and mean frequency that the log's reference channel shows (within its first `until_s`).

    What came after a stop before its time shows neither.
    """
    measured = log.channels("measured")
    reference = reference_among(twin.model.channels, measured, twin)
    if reference.channel not in measured:
        return untouched(twin.drive)
    if until_s is not None:
        until_s = max(until_s, reference.cycles / twin.drive.cycle_hz)
    ends = [end_s for end_s in (until_s, log.until_stop_s) if end_s is not None]
    seen = log.series("measured", reference.channel, end_s=min(ends, default=None))
    return reference.align(seen.values, seen.sample_rate, seen.first_sample, twin.drive)

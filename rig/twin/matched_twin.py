"""The twin of a scenario as a calibration found its rig, and what a model file says of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isclose

from rig.files.model_file import ModelFile, model_text
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.matching import matched_campaign
from sim_twin.healthy import Tolerance
from sim_twin.matched import Matched
from sim_twin.twin import AnyTwin

_ALIKE = 1e-6


def with_model(twin: AnyTwin, model: ModelFile, warn: Callable[[str], None]) -> AnyTwin:
    """Return `twin` as `model` says that its rig is; `warn` is told what of it does not hold here."""
    return twin.model.matched(twin, carried(model, [twin], warn))


def campaign_with_model(campaign: Campaign, model: ModelFile, warn: Callable[[str], None]) -> Campaign:
    """The same runs of a rig that `model` was fitted to."""
    return matched_campaign(campaign, carried(model, [run.twin for run in campaign.runs], warn))


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


def as_model_text(twin: AnyTwin, matched: Matched, runs: Sequence[str], scenarios: Sequence[str]) -> str:
    """The model file that says how the rig of the nominal `twin` was found."""
    known = [each for each in twin.model.lasting_tolerances(twin) if each.name in matched.names]
    nominals = {each.name: each.value(twin) for each in known}
    remarks = {each.name: found(each, twin, matched) for each in known}
    return model_text(twin.model.name, runs, scenarios, nominals, matched, remarks)


def found(tolerance: Tolerance, twin: AnyTwin, matched: Matched) -> str:
    """In physical terms: the value, and how far it is still open."""
    at = matched.names.index(tolerance.name)
    mean, open_by = matched.mean[at], matched.deviation[at]
    value = tolerance.value(tolerance.off(twin, float(mean)))
    scale = abs(tolerance.value(twin)) if tolerance.relative else 1.0
    return f"{value:.5g} +- {tolerance.deviation * open_by * scale:.2g} {tolerance.unit}".rstrip()

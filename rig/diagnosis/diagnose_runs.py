"""`rattle diagnose`: from recorded runs to diagnosis.json, effects.json and report.html."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import TypeAlias

import numpy as np
from threadpoolctl import threadpool_limits

from daq.errors import RattleError
from rig.diagnosis.document import Request, document, effects_file, write_json
from rig.diagnosis.experiments import Experiment, Option, options
from rig.diagnosis.recordings import RecordedCampaign, recorded
from rig.diagnosis.report.case import RunFacts
from rig.diagnosis.report.page import write_report
from rig.diagnosis.workers import Simulated
from rig.ensembles.executors import cores, worker_processes
from rig.files.model_file import ModelFile, load_model
from rig.files.scenario import parse_scenario
from rig.session.progress import Screen
from rig.twin.matched_twin import campaign_with_model
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.diagnose import diagnose
from sim_twin.diagnosis.effort import effort_for
from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.horizon import horizon_s
from sim_twin.diagnosis.latent_force import latent_forces
from sim_twin.diagnosis.next_experiment import rivals_of, told_apart
from sim_twin.diagnosis.subject import Execute
from sim_twin.rigs.catalogue import model_of

_OVERTIME = 1.6
"""Of the budget: when a loaded machine has to stop simulating, and the answer says so."""
_LAST = 1.9
_UNKNOWN_ENOUGH = 0.2
"""Probability from which on the report shows what the joints' forces lack."""
_OfCampaign: TypeAlias = Callable[[Campaign], Execute]


@dataclass(frozen=True, slots=True)
class DiagnosisFiles:
    """The files of a diagnosis, and what it found."""

    findings: Findings
    diagnosis: Path
    effects: Path
    report: Path
    next_experiment: Path | None


def diagnose_runs(
    runs: Sequence[Path], model: Path | None, out: Path, seed: int, budget_s: float, screen: Screen
) -> DiagnosisFiles:
    """Diagnose a campaign, with a calibration's `model` of its rig where there is one.

    Raises ConfigurationError or LogError for runs that cannot be used.
    """
    began = time.monotonic()
    with screen.busy("reading"):
        data = recorded_of(runs, model, screen)
    remarks = list(data.remarks)
    for remark in remarks:
        screen.warn(remark)
    _make(out)
    effort = effort_for(data.campaign, budget_s)
    with worker_processes(cores()) as workers, screen.bar("simulating", effort.motions, "rigs") as bar:
        simulated = Simulated(data.campaign, workers.executor, began + _OVERTIME * budget_s, bar.at)
        with threadpool_limits(1, user_api="blas"):  # the order of its sums changes last bits
            findings = diagnose(data.campaign, data.measured, effort, simulated, seed)

        def simulate(campaign: Campaign) -> Simulated:
            return Simulated(campaign, workers.executor, began + _LAST * budget_s, lambda _: None)

        experiment = _next_experiment(data, _model_of(model, data), rivals_of(findings), simulate, seed)
    if simulated.cut_short:
        remarks.append(
            "time ran out: fewer rigs were simulated than planned, so another machine may answer differently"
        )
    if not findings.held_out:
        remarks.append("one block of cycles only: the gap was judged on the cycles that were fitted")
    columns, twin = data.campaign.runs[0].columns, data.campaign.runs[0].twin
    response = twin.channels.index(columns.coupled[0])
    reaches = [horizon_s(setting, response) for setting in data.campaign.runs]
    reach = min((each for each in reaches if each is not None), default=None)
    forces = []
    if findings.unknown >= _UNKNOWN_ENOUGH:
        forces = latent_forces(data.campaign, data.records, data.sound, seed)
    catalogue = model_of(twin).effects
    request = Request(runs, model, seed, budget_s)
    content = document(
        findings, catalogue, request, reach, experiment, time.monotonic() - began, remarks, forces
    )
    write_json(out / "diagnosis.json", content)
    write_json(out / "effects.json", effects_file(findings))
    following = None if experiment is None else out / "next_experiment.toml"
    if experiment is not None and following is not None:
        following.write_text(experiment.scenario, encoding="utf-8")
    report = out / "report.html"
    write_report(report, findings, content, _facts(data, runs), remarks, forces)
    return DiagnosisFiles(findings, out / "diagnosis.json", out / "effects.json", report, following)


def _make(folder: Path) -> None:
    """Before anything is simulated, so that nothing is found out that cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise RattleError(f"cannot write to {folder}: {error.strerror}") from error


def recorded_of(runs: Sequence[Path], model: Path | None, screen: Screen) -> RecordedCampaign:
    """The runs, their twins as the `model` says that their rig is."""
    data = recorded(runs)
    known = _model_of(model, data)
    if known is None:
        return data
    return replace(data, campaign=campaign_with_model(data.campaign, known, screen.warn))


def _model_of(path: Path | None, data: RecordedCampaign) -> ModelFile | None:
    return None if path is None else load_model(path, model_of(data.campaign.runs[0].twin).name)


def _facts(data: RecordedCampaign, runs: Sequence[Path]) -> list[RunFacts]:
    model = model_of(data.campaign.runs[0].twin)
    units = {name: model.channel_unit(name) for name in data.campaign.runs[0].columns.channels}
    pairs = zip(runs, data.scenarios, strict=True)
    return [RunFacts(run.name, parse_scenario(text).name, units) for run, text in pairs]


def _next_experiment(
    data: RecordedCampaign,
    known: ModelFile | None,
    rivals: tuple[Judged, Judged] | None,
    simulate: _OfCampaign,
    seed: int,
) -> Experiment | None:
    """The run that best tells two rivals apart; None where there are none, or no run could be tried."""
    if rivals is None:
        return None
    first, second = rivals
    effects = ((first.best,), (second.best,))
    columns = data.campaign.runs[0].columns
    found: list[tuple[float, Option]] = []
    for option in options(data.scenarios[0], columns.channels, columns.rate, data.campaign.runs[0].quiet):
        campaign = option.campaign
        if known is not None:
            campaign = campaign_with_model(campaign, known, lambda _: None)
        share = told_apart(campaign, effects, simulate(campaign), np.random.default_rng([seed, 0]))
        if share is not None:
            found.append((share, Option(option.scenario, campaign)))
    if not found:
        return None
    _, best = max(found, key=lambda each: each[0])
    # the best of several is the luckiest too: other rigs say how good it is
    share = told_apart(best.campaign, effects, simulate(best.campaign), np.random.default_rng([seed, 1]))
    names = (first.cause.name, second.cause.name)
    # one more run takes nothing away from what these have shown
    return None if share is None else Experiment(best.scenario, names, max(share, first.probability))

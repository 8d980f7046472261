"""`rattle diagnose`: from recorded runs to diagnosis.json, effects.json and report.html."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from rig.diagnosis.document import document, effects_file, write_json
from rig.diagnosis.experiments import Experiment, options
from rig.diagnosis.recordings import Recorded, recorded
from rig.diagnosis.report import RunFacts, write_report
from rig.diagnosis.workers import Simulated
from rig.ensembles.executors import Workers, cores, worker_processes
from rig.files.model_file import load_model
from rig.files.scenario import parse_scenario
from rig.session.progress import Screen
from rig.twin.matched_twin import campaign_with_model
from sim_twin.diagnosis.diagnose import diagnose
from sim_twin.diagnosis.draw import Named
from sim_twin.diagnosis.effort import effort_for
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.horizon import horizon_s
from sim_twin.diagnosis.latent_force import LatentForce, latent_forces
from sim_twin.diagnosis.next_experiment import told_apart
from sim_twin.rigs.catalogue import model_of

_OVERTIME = 1.6
"""Of the budget: when a loaded machine has to stop simulating, and the answer says so."""
_LAST = 1.9
_UNKNOWN_ENOUGH = 0.2
"""Probability from which on the report shows what the joints' forces lack."""


@dataclass(frozen=True, slots=True)
class Written:
    """The files of a diagnosis, and what it found."""

    findings: Findings
    diagnosis: Path
    effects: Path
    report: Path


def diagnose_runs(
    runs: Sequence[Path], model: Path | None, out: Path, seed: int, budget_s: float, screen: Screen
) -> Written:
    """Diagnose a campaign, with a calibration's `model` of its rig where there is one.

    Raises ConfigurationError or LogError for runs that cannot be used.
    """
    began = time.monotonic()
    with screen.busy("reading"):
        data = recorded_of(runs, model, screen)
    remarks = list(data.remarks)
    for remark in remarks:
        screen.warn(remark)
    out.mkdir(parents=True, exist_ok=True)
    effort = effort_for(data.campaign, budget_s)
    with worker_processes(cores()) as workers, screen.bar("simulating", effort.motions, "rigs") as bar:
        simulated = Simulated(data.campaign, workers.executor, began + _OVERTIME * budget_s, bar.at)
        with threadpool_limits(1, user_api="blas"):  # the order of its sums changes last bits
            findings = diagnose(data.campaign, data.measured, effort, simulated, seed)
        experiment = _next_experiment(data, findings, workers, began + _LAST * budget_s, seed)
    if simulated.cut_short:
        remarks.append(
            "time ran out: fewer rigs were simulated than planned, so another machine may answer differently"
        )
    if not findings.held_out:
        remarks.append("one block of cycles only: the gap was judged on the cycles that were fitted")
    reach = min(horizon_s(setting, _response_row(data)) for setting in data.campaign.runs)
    forces = _latent_forces(data, findings, seed)
    catalogue = model_of(data.campaign.runs[0].twin).effects
    content = document(
        findings, catalogue, runs, reach, experiment, time.monotonic() - began, remarks, forces
    )
    write_json(out / "diagnosis.json", content)
    write_json(out / "effects.json", effects_file(findings))
    report = out / "report.html"
    write_report(report, findings, content, _facts(data, runs), remarks, forces)
    return Written(findings, out / "diagnosis.json", out / "effects.json", report)


def _latent_forces(data: Recorded, findings: Findings, seed: int) -> list[LatentForce]:
    if findings.unknown < _UNKNOWN_ENOUGH:
        return []
    return latent_forces(data.campaign, data.records, data.sound, seed)


def recorded_of(runs: Sequence[Path], model: Path | None, screen: Screen) -> Recorded:
    """The runs, their twins as the `model` says that their rig is."""
    data = recorded(runs)
    if model is None:
        return data
    known = load_model(model, model_of(data.campaign.runs[0].twin).name)
    return replace(data, campaign=campaign_with_model(data.campaign, known, screen.warn))


def _facts(data: Recorded, runs: Sequence[Path]) -> list[RunFacts]:
    model = model_of(data.campaign.runs[0].twin)
    units = {name: model.channel_unit(name) for name in data.campaign.runs[0].columns.channels}
    pairs = zip(runs, data.scenarios, strict=True)
    return [RunFacts(run.name, parse_scenario(text).name, units) for run, text in pairs]


def _response_row(data: Recorded) -> int:
    columns, twin = data.campaign.runs[0].columns, data.campaign.runs[0].twin
    return twin.channels.index(columns.coupled[0])


def _next_experiment(
    data: Recorded, findings: Findings, workers: Workers, deadline: float, seed: int
) -> Experiment | None:
    """For the two most probable effects; none where there are not two."""
    rivals = [each for each in findings.judged if each.parameters][:2]
    if len(rivals) < 2 or findings.verdict == "none":
        return None
    effects: list[tuple[Named, ...]] = []
    for each in rivals:
        values = np.array([estimate.value for estimate in each.parameters.values()])
        effects.append((each.cause.named(values),))
    names = (rivals[0].cause.name, rivals[1].cause.name)
    columns = data.campaign.runs[0].columns
    found = []
    quiet = data.campaign.runs[0].quiet
    for option in options(data.scenarios[0], columns.channels, columns.rate, quiet):
        simulated = Simulated(option.campaign, workers.executor, deadline, lambda _: None)
        share = told_apart(option.campaign, (effects[0], effects[1]), simulated, np.random.default_rng(seed))
        found.append(Experiment(option.scenario, names, share))
    return max(found, key=lambda each: each.expected_probability) if found else None

"""From recorded runs to what they lack (`rattle diagnose`), and how far off they are (`rattle gap`)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from daq.disk import write_whole
from daq.errors import RattleError, RecorderFailed
from rig.diagnosis.argument import of_cut_short
from rig.diagnosis.document import document, effects_file, gap_block, provenance, write_json
from rig.diagnosis.experiments import Experiment, Option, options
from rig.diagnosis.kept import Kept, kept_runs
from rig.diagnosis.model_values import with_doubts
from rig.diagnosis.recordings import RecordedCampaign, recorded, work_of
from rig.diagnosis.report import arguments, before_and_after, causes, gap_map, verdict
from rig.diagnosis.report.case import Case, RunFacts
from rig.ensembles import Simulated, cores, workers_when_needed
from rig.files.effects_file import load_effects
from rig.files.model_file import ModelFile, load_model
from rig.files.out_folder import check_out
from rig.files.scenario import parse_scenario
from rig.pages.content import Section, page
from rig.session.pace import reading
from rig.session.progress import Screen
from rig.twin.logged import campaign_with_model, held_values
from sim_twin.diagnosis.campaign import Campaign, horizon_s
from sim_twin.diagnosis.diagnose import diagnose, effort_for
from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.gap import gap_measure
from sim_twin.diagnosis.healthy_band import healthy_band
from sim_twin.diagnosis.judging import gap_between
from sim_twin.diagnosis.latent_force import latent_forces
from sim_twin.diagnosis.separability import rivals_of, told_apart
from sim_twin.diagnosis.subject import Draw, Execute, Named
from sim_twin.diagnosis.typical_cycle import typical_cycles

BUDGET_S: Final = 120.0
"""What a diagnosis takes two free cores, where nothing else is asked."""
_OVERTIME = 1.6
"""Of the budget: when a loaded machine has to stop simulating, and the answer says so."""
_LAST = 1.9
_OfCampaign: TypeAlias = Callable[[Campaign], Execute]


def diagnose_runs(
    runs: Sequence[Path],
    model: Path | None,
    out: Path,
    seed: int,
    budget_s: float,
    screen: Screen,
    effort: float = 1.0,
) -> tuple[Findings, dict[str, Path]]:
    """Diagnose a campaign, with a calibration's `model` of its rig where there is one.

    `effort` times as much is simulated as fits into the budget of two cores, and it may take as long.

    Returns what it found and the files that say so, by what they are. Raises ConfigurationError or LogError
    for runs that cannot be used.
    """
    began = time.monotonic()
    check_out(out)
    with screen.busy("reading", reading("read for a diagnosis", *runs)):
        data = _doubted(recorded_of(runs, model, screen), model)
    remarks = [*data.remarks, *not_looked_for(data)]
    for remark in remarks:
        screen.warn(remark)
    planned = effort_for(data.campaign, effort * budget_s)
    latest_s = max(1.0, effort) * budget_s
    told = _text_of(model)
    kept = kept_runs(data.campaign, told, screen.warn)
    work = work_of("diagnose again" if kept.some else "diagnose", data.campaign, [1] * planned.most)
    with (
        screen.bar("simulating", planned.most, "rigs", work, longest_s=_OVERTIME * latest_s) as bar,
        workers_when_needed(cores()) as workers,
    ):
        simulated = Simulated(data.campaign, workers, began + _OVERTIME * latest_s, bar)
        with threadpool_limits(1, user_api="blas"):  # the order of its sums changes last bits
            findings = diagnose(data.campaign, data.measured, planned, kept.by(simulated), seed, data.told)

        def simulate(campaign: Campaign) -> Execute:
            later = Simulated(campaign, workers, began + _LAST * latest_s, lambda _: None)
            return kept_runs(campaign, told, screen.warn).by(later)

        experiment = _next_experiment(data, _model_of(model, data), rivals_of(findings), simulate, seed)
    if simulated.cut_short:
        remarks.append(of_cut_short(findings.searched, findings.judging))
    if not findings.held_out:
        remarks.append("one block of cycles only: the gap was judged on the cycles that were fitted")
    twin = data.campaign.runs[0].twin
    reaches = [
        horizon_s(setting, setting.twin.channels.index(setting.columns.coupled[0]))
        for setting in data.campaign.runs
    ]
    reach = min((each for each in reaches if each is not None), default=None)
    forces = []
    if findings.unknown >= arguments.UNKNOWN_ENOUGH:
        forces = latent_forces(data.campaign, data.records, data.sound, seed)
    catalogue = twin.model.effects
    asked = {"budget_s": budget_s, "effort": effort, "model": None if model is None else str(model)}
    said = {**provenance(seed), **asked}
    units = {
        name: twin.model.channel_unit(name) for run in data.campaign.runs for name in run.columns.channels
    }
    pairs = zip(data.paths, data.scenarios, strict=True)
    facts = [RunFacts(run.name, parse_scenario(text).name, units) for run, text in pairs]
    case = Case(findings, {}, facts, remarks, forces, out)
    drawn = [(number, name) for name, number in case.drawn_channels()]
    cycles = typical_cycles(data.campaign, data.records, data.sound, drawn, findings.put_in, seed)
    seconds = time.monotonic() - began
    content = document(
        findings, catalogue, data.paths, said, reach, experiment, seconds, remarks, forces, units, cycles
    )
    names = {"diagnosis": "diagnosis.json", "effects": "effects.json", "report": "report.html"}
    following = _without_an_older_next_run(out)
    files = {what: out / name for what, name in names.items()}
    content["sentences"] = verdict.sentences(case)
    write_json(files["diagnosis"], content)
    write_json(files["effects"], effects_file(findings))
    if experiment is not None:
        files["next run"] = following
        write_whole(following, experiment.scenario.encode())
    write_report(files["report"], replace(case, diagnosis=content))
    return findings, files


def _without_an_older_next_run(out: Path) -> Path:
    """Make the folder; where the next run is to stand, and none of an answer that was here before does."""
    out.mkdir(parents=True, exist_ok=True)
    following = out / "next_experiment.toml"
    try:
        following.unlink(missing_ok=True)
    except OSError as error:
        raise RecorderFailed(f"cannot remove {following}: {error.strerror}") from error
    return following


SECTIONS: Sequence[Section[Case]] = (
    Section("Verdict", verdict.parts),
    Section("A typical cycle", arguments.typical_cycle),
    Section("Causes", causes.ranking),
    Section("What does not fit", arguments.what_does_not_fit),
    Section("Why not the next best", arguments.why_not),
    Section("Run by run", arguments.run_by_run),
    Section("Gap map", gap_map.parts),
    Section("Latent force", before_and_after.latent_force),
    Section("Before and after", before_and_after.parts),
    Section("Parameters", causes.parameters),
    Section("Not told apart", causes.not_told_apart),
    Section("Next experiment", causes.next_experiment),
    Section("Basis", causes.basis),
)
"""Heading and content of each section of the report; one without content is left out."""


def write_report(path: Path, case: Case, sections: Sequence[Section[Case]] = SECTIONS) -> None:
    """Write the report as one HTML file; raises RecorderFailed where `path` cannot be written."""
    parts = [(section.heading, section.parts(case)) for section in sections]
    write_whole(path, page("Diagnosis", [run.name for run in case.runs], parts).encode())


def recorded_of(runs: Sequence[Path], model: Path | None, screen: Screen) -> RecordedCampaign:
    """The runs, their twins as the `model` says that their rig is."""
    data = recorded(runs)
    known = _model_of(model, data)
    if known is None:
        return data
    scenarios = [parse_scenario(text) for text in data.scenarios]
    campaign = campaign_with_model(data.campaign, known, scenarios, screen.warn)
    remarks = (*data.remarks, *_of_whom(model, known, data.specimen))
    return replace(data, campaign=campaign, remarks=remarks)


def _of_whom(model: Path | None, known: ModelFile, specimen: str | None) -> Iterator[str]:
    """Say that nobody knows whether a model of one rig is of this one."""
    whose = {str(model): known.specimen, "these runs": specimen}
    if lacking := [name for name, said in whose.items() if said is None and not known.lab]:
        yield (
            f"no specimen is named by {' and '.join(lacking)}: whether the model is of this rig nobody can "
            'tell, and one of another rig misleads. Say it in the scenarios: [notes] specimen = "..."'
        )


def not_looked_for(data: RecordedCampaign) -> list[str]:
    """Effects that a rig of these runs cannot have, and why."""
    return [
        f"{path.name}: {effect.name} was not looked for ({why})"
        for path, run in zip(data.paths, data.campaign.runs, strict=True)
        for effect in run.twin.model.effects.values()
        if (why := effect.refusal(run.twin))
    ]


def _doubted(data: RecordedCampaign, model: Path | None) -> RecordedCampaign:
    """The same runs, of which values of [model] may have been entered wrongly."""
    known, scenarios = _model_of(model, data), [parse_scenario(text) for text in data.scenarios]
    held = [{} if known is None else held_values(known, each) for each in scenarios]
    given = [{**each.model, **values} for each, values in zip(scenarios, held, strict=True)]
    return replace(data, campaign=with_doubts(scenarios[0].rig, data.campaign, given))


def _text_of(model: Path | None) -> str:
    return "" if model is None else model.read_text(encoding="utf-8")


def _model_of(path: Path | None, data: RecordedCampaign) -> ModelFile | None:
    return None if path is None else load_model(path, data.campaign.runs[0].twin.model.name, data.specimen)


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
    columns, quiet = data.campaign.runs[0].columns, data.campaign.runs[0].quiet
    found: list[tuple[float, Option]] = []
    recorded_s = len(data.sound[0]) / columns.rate
    for option in options(data.scenarios[0], columns.channels, columns.rate, quiet, data.chains, recorded_s):
        campaign = option.campaign
        if known is not None:
            scenario = parse_scenario(option.scenario)
            campaign = campaign_with_model(campaign, known, [scenario], lambda _: None)
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


_HEALTHY, _REPAIRED, _ALONE = 64, 32, 12
_FEWEST = 8
_LONGEST_S = 600.0
Fingerprints: TypeAlias = NDArray[np.float64]


def measured_gap(
    runs: Sequence[Path], model: Path | None, effects: Path | None, seed: int, screen: Screen
) -> dict[str, Any]:
    """The gap block of a diagnosis over all cycles of the runs; with `effects` in the twin too.

    Of one run also how far healthy rigs lie.
    """
    data = recorded_of(runs, model, screen)
    for remark in data.remarks:
        screen.warn(remark)
    rig = data.campaign.runs[0].twin.model
    given = () if effects is None else tuple(load_effects(effects, rig.effects))
    alone = given if len(given) > 1 else ()
    wanted = [((), _HEALTHY), *([(given, _REPAIRED)] if given else []), *(((one,), _ALONE) for one in alone)]
    kept = kept_runs(data.campaign, _text_of(model), screen.warn)
    healthy, *others = _simulated(data, wanted, seed, screen, kept)
    measure = gap_measure(healthy, data.campaign.layout)
    repaired = [np.array([blocks[0] for blocks in each], dtype=np.float64) for each in others]
    rng = np.random.default_rng([seed, 1])
    found = gap_between(measure, data.measured, data.measured, repaired[0] if given else None, rng)
    places = [rig.effects[name].location for name, _ in given]
    # shares of the places in how far each effect moves a twin, by squares; one effect has all of it
    moved = [float(np.mean(measure.cells(rigs.mean(axis=0)[None]) ** 2)) for rigs in repaired[1:]] or [1.0]
    shares: dict[str, float] = {}
    for place, size in zip(places, moved, strict=False):
        shares[place] = shares.get(place, 0.0) + size / sum(moved)
    block = gap_block(data.campaign.layout, found, shares)
    if len(data.paths) == 1:
        block["healthy_up_to"] = healthy_band(healthy, data.campaign.layout).gap_up_to
    return block


def _simulated(
    data: RecordedCampaign,
    wanted: Sequence[tuple[tuple[Named, ...], int]],
    seed: int,
    screen: Screen,
    kept: Kept,
) -> list[list[NDArray[np.float32]]]:
    """Fingerprints (blocks, numbers) of so many rigs with each set of effects."""
    rng = np.random.default_rng(seed)
    draws = [
        Draw(effects, int(rng.integers(2**62)), blocks=1 if effects else 2)
        for effects, count in wanted
        for _ in range(count)
    ]
    work = work_of("simulate", data.campaign, [draw.blocks for draw in kept.lacking(draws)])
    with screen.bar("simulating", len(draws), "rigs", work) as bar, workers_when_needed(cores()) as workers:
        simulated = Simulated(data.campaign, workers, time.monotonic() + _LONGEST_S, bar)
        shown = iter(kept.by(simulated)(draws))
    sets = [[each[0] for each in islice(shown, count) if each and each[0] is not None] for _, count in wanted]
    if any(len(each) < _FEWEST for each in sets):
        raise RattleError("too few rigs could be simulated for a gap")
    return sets

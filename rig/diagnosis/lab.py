"""The tolerances of a lab's own healthy rigs, from runs of several of them (`rattle calibrate --spread`)."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from daq.errors import ConfigurationError, Problem, RattleError
from rig.diagnosis.recordings import AloneRun, recorded_alone, work_of
from rig.ensembles import Simulated, cores, worker_processes
from rig.files.faults import toml_key
from rig.files.lab_tolerances import LARGEST_SHARE, in_words
from rig.files.model_file import ModelFile, as_identified, head_text, load_model, parse_model
from rig.rigs import RIGS
from rig.session.pace import reading
from rig.session.progress import Screen
from rig.twin.logged import campaign_with_model
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.matching import Rigs, healthy_draws, simulated_rigs
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.spread import Spread, spread_among
from sim_twin.healthy import Tolerance
from sim_twin.twin import AnyTwin

_LONGEST_S = 20.0
_FEWEST = 3
_WIDE = 2.5
"""Times as wide as usual are the rigs that a lab's are compared with."""
_ODD = 4.0
"""Times farther off than the others is a run that may be none of a healthy rig."""


def spread_of(
    paths: Sequence[Path], rigs: int, seed: int, budget_s: float, screen: Screen, model: Path | None = None
) -> tuple[list[AloneRun], Spread, ModelFile | None]:
    """Runs, each of another rig or another day, and how far their rigs differ about what a `model` says.

    Raises ConfigurationError or LogError for what cannot be used.
    """
    distinct = {path.resolve() for path in paths}
    if len(distinct) < max(_FEWEST, len(paths)):
        told = f"{len(paths)} runs, {len(distinct)} of them different"
        raise ConfigurationError("runs", [Problem("runs", told, f"{_FEWEST} different ones at least")])
    with screen.busy("reading", reading("read one by one", *paths)):
        runs = [recorded_alone(path, _LONGEST_S) for path in paths]
    kinds = {run.scenario.rig: path.name for run, path in zip(runs, paths, strict=True)}
    if len(kinds) > 1:
        told = ", ".join(f"{path} is of the {rig}" for rig, path in kinds.items())
        raise ConfigurationError("runs", [Problem("runs", told, "runs of one kind of rig")])
    known = None if model is None else _identified(model, runs[0].scenario.rig)
    if known is not None:
        runs = [
            replace(run, campaign=campaign_with_model(run.campaign, known, [run.scenario], screen.warn))
            for run in runs
        ]
    _refuse_other_tolerances(paths, runs)
    for run, path in zip(runs, paths, strict=True):
        for remark in run.remarks:
            screen.warn(f"{path.name}: {remark}")
    # one scenario, one campaign: nothing of it hangs on what was measured
    kept: dict[str, Campaign] = {repr(run.campaign): _wider(run.campaign) for run in runs}
    simulated: dict[str, Rigs] = {}
    rng = np.random.default_rng(seed)
    work = work_of("calibrate", runs[0].campaign, [1] * rigs * len(kept))
    total = rigs * len(kept)
    with screen.bar("simulating", total, "healthy rigs", work) as bar, worker_processes(cores()) as workers:
        for number, (name, campaign) in enumerate(kept.items()):
            report = partial(_further, bar, rigs * number)
            deadline = time.monotonic() + budget_s / len(kept)
            simulate = Simulated(campaign, workers.executor, deadline, report)
            draws = healthy_draws(rigs, rng)
            simulated[name] = simulated_rigs(campaign, draws, simulate(draws))
            if simulate.cut_short:
                screen.warn("time ran out: fewer healthy rigs were simulated than planned")
    seen = [(simulated[repr(run.campaign)], Moments(run.campaign.layout), run.measured) for run in runs]
    spread = spread_among(seen, 1 / _WIDE)
    spread = replace(spread, widths=_WIDE * spread.widths, common=_WIDE * spread.common)
    for path, off in zip(paths, spread.off, strict=True):
        others = np.median(spread.off[spread.off != off]) if len(spread.off) > 1 else off
        if off > _ODD * others:
            screen.warn(
                f"{path.name} lies {off / others:.2g} times farther off than the others: is it healthy?"
            )
    return runs, spread, known


def _identified(path: Path, rig: str) -> ModelFile:
    known = load_model(path, rig)
    if known.matched.names or known.lab:
        raise RattleError(
            f"{path} says already what rigs differ by; rattle identify writes what may be given"
        )
    return known


def _refuse_other_tolerances(paths: Sequence[Path], runs: Sequence[AloneRun]) -> None:
    """What healthy rigs differ by has to be the same, or their widths are none of one another."""
    twins = [run.campaign.runs[0].twin for run in runs]
    known = [{each.name for each in twin.model.lasting_tolerances(twin)} for twin in twins]
    for path, names in zip(paths, known, strict=True):
        if other := sorted(names ^ known[0]):
            told = f"{path.name} and {paths[0].name} differ in {', '.join(other)}"
            alike = "runs with the same channels and [model]"
            raise ConfigurationError("runs", [Problem("runs", told, alike)])


def _further(bar: Callable[[float], None], before: int, done: float) -> None:
    bar(before + done)


def _wider(campaign: Campaign) -> Campaign:
    return replace(
        campaign,
        runs=tuple(replace(run, twin=replace(run.twin, widths=_all_wide(run.twin))) for run in campaign.runs),
    )


def _all_wide(twin: AnyTwin) -> dict[str, float]:
    usual = dict.fromkeys((each.name for each in twin.model.lasting_tolerances(twin)), 1.0)
    return {name: _WIDE * twin.widths.get(name, width) for name, width in usual.items()}


def not_learnt(run: AloneRun) -> str:
    """What is set anew for each run, and how far it differs: its spread is no rig's, and none is learnt."""
    widths = run.scenario.widths
    return ", ".join(
        f"{each.name} {in_words(each, widths.get(each.name, 1.0) * each.deviation)}"
        for each in _tolerances(run).values()
        if each.each_run
    )


def _tolerances(run: AloneRun) -> dict[str, Tolerance]:
    """What the rigs of a run differ by, as wide as elsewhere; what they do not there as its scenario says."""
    known = RIGS[run.scenario.rig].tolerances(run.scenario.model)
    return {**known, **{each.name: each for each in run.scenario.besides}}


def lab_text(
    runs: Sequence[AloneRun], spread: Spread, names: Sequence[str], known: ModelFile | None = None
) -> str:
    """The model file that holds them as [tolerances], and what was `known` of values; it can be read."""
    rig = runs[0].scenario.rig
    before = runs[0].scenario.widths
    tolerances, besides = _tolerances(runs[0]), {each.name for each in runs[0].scenario.besides}
    lines = [
        "# How far healthy rigs of this lab differ, as rattle calibrate --spread learnt it: standard",
        "# deviations; for --model, or for [tolerances] of a scenario. What the runs do not tell is as wide",
        f"# as all together, {spread.common:.2f} times as wide as usual.",
        "# What is set anew for each run is not learnt and stays as wide as the scenario says:",
        f"# {not_learnt(runs[0])}.",
        *head_text(rig, names, list(dict.fromkeys(run.scenario.name for run in runs))),
        "",
        "[tolerances]",
    ]
    for name, width in zip(spread.names, spread.widths, strict=True):
        usual = tolerances[name]
        deviation, said = width * before.get(name, 1.0) * usual.deviation, "usual"
        if name in besides:
            deviation, said = min(deviation, LARGEST_SHARE) if usual.relative else deviation, "was"
        text = in_words(usual, deviation)
        given = json.dumps(text) if usual.relative or usual.unit else text
        lines.append(f"{toml_key(name)} = {given}  # {said} {in_words(usual, usual.deviation)}")
    lines += [] if known is None else as_identified(known)
    text = "\n".join([*lines, ""])
    parse_model(text, "model", rig)
    return text

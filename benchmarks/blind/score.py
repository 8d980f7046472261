"""Opens the answers and scores the diagnoses against them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.blind.baselines import BASELINES
from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.cases import Answer, Case, Gaps, answer_of
from benchmarks.blind.gap.campaign import answer_gap, truth_gaps
from benchmarks.blind.make import each_done, workers
from benchmarks.blind.metrics import first_answer
from benchmarks.blind.page import page
from benchmarks.blind.result import Confusion, as_json
from benchmarks.blind.runner import Cost, cost_of, diagnosis_file
from benchmarks.blind.seal import unseal
from benchmarks.blind.table import BESIDE, JUDGED

FAILED = "(failed)"


def measure_truths(folder: Path) -> None:
    """Work out how far the true effects close each gap, on two processes; needs no diagnosis."""
    _all_gaps(folder, [campaign for campaign in unseal(folder) if in_catalogue(campaign)], truth_gaps)


def score(folder: Path) -> bool:
    """Print the figures and write score.json and score.txt; returns whether one program met every bar.

    Campaigns that were not diagnosed yet are left out, and their number is said. Raises SealBroken if the
    answers have changed.
    """
    campaigns = unseal(folder)
    costs = {each.name: cost for each in campaigns if (cost := cost_of(folder, each.name))}
    done = [campaign for campaign in campaigns if campaign.name in costs]
    gaps = _all_gaps(folder, [campaign for campaign in done if in_catalogue(campaign)], _gaps_of)
    cases = [_case(folder, campaign, gaps.get(campaign.name), costs[campaign.name]) for campaign in done]
    judged, beside = ([figure.measure(cases) for figure in part] for part in (JUDGED, BESIDE))
    notes = _notes(cases, campaigns, list(costs.values()))
    table = confusion(cases)
    baselines = baseline_values(cases)
    text = page(judged, beside, baselines, table, notes)
    print(text)
    (folder / "score.txt").write_text(text)
    result = as_json(judged, beside, baselines, table, notes, cases)
    (folder / "score.json").write_text(json.dumps(result, indent=1, allow_nan=False))
    return all(figure.met for figure in judged) and len(_programs(list(costs.values()))) == 1


def in_catalogue(campaign: Campaign) -> bool:
    """Whether the twin can have what is hidden."""
    return campaign.kind in ("single", "pair")


def read_answer(folder: Path, name: str, cost: Cost) -> Answer | None:
    """The answer of a campaign; None where the diagnosis failed or wrote something else."""
    if cost.exit_code != 0:
        return None
    try:
        return answer_of(json.loads(diagnosis_file(folder, name).read_text()))
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return None


def confusion(cases: Sequence[Case]) -> Confusion:
    """How often each truth (of one name) was given each first answer."""
    table: dict[str, Counter[str]] = {}
    for case in cases:
        if case.campaign.kind != "pair":
            said = FAILED if case.answer is None else first_answer(case.answer)
            table.setdefault(_label(case), Counter())[said] += 1
    return {truth: dict(table[truth].most_common()) for truth in sorted(table)}


def baseline_values(cases: Sequence[Case]) -> dict[str, list[float]]:
    """The judged figures of each baseline."""
    played = {name: play(cases) for name, play in BASELINES.items()}
    return {name: [figure.value_of(own) for figure in JUDGED] for name, own in played.items()}


def _label(case: Case) -> str:
    (truth,) = case.truth
    return truth if case.visible else f"{truth} (not shown)"


def _all_gaps(folder: Path, campaigns: Sequence[Campaign], work: Any) -> dict[str, Gaps]:
    with workers() as pool:
        return dict(each_done(pool, partial(_named, work, folder), campaigns))


def _named(work: Any, folder: Path, campaign: Campaign) -> tuple[str, Gaps]:
    return campaign.name, work(folder, campaign)


def _gaps_of(folder: Path, campaign: Campaign) -> Gaps:
    known = truth_gaps(folder, campaign)
    after = answer_gap(folder, campaign)
    return Gaps(known.before, known.oracle, known.before if after is None else after)


def _case(folder: Path, campaign: Campaign, gaps: Gaps | None, cost: Cost) -> Case:
    return Case(campaign, read_answer(folder, campaign.name, cost), gaps, cost.wall_s)


def _notes(cases: Sequence[Case], campaigns: Sequence[Campaign], costs: Sequence[Cost]) -> list[str]:
    failed = [case.campaign.name for case in cases if case.answer is None]
    kinds = Counter(case.campaign.kind for case in cases)
    programs = len(_programs(costs))
    hidden = [case for case in cases if in_catalogue(case.campaign) and not case.visible]
    return [
        f"{len(cases)} of {len(campaigns)} campaigns diagnosed ({_listed(kinds)}), {len(failed)} failed"
        + (f": {', '.join(failed)}" if failed else ""),
        f"{len(hidden)} whose settings cannot show what is hidden",
        f"diagnosed by {programs} version{'s' if programs != 1 else ''} of the program",
    ]


def _programs(costs: Sequence[Cost]) -> set[str]:
    return {cost.program_sha256 for cost in costs}


def _listed(numbers: Counter[Any]) -> str:
    return ", ".join(f"{number} {kind}" for kind, number in sorted(numbers.items()))

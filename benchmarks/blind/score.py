"""Opens the answers and scores the diagnoses against them."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.blind.baselines import BASELINES
from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.cases import Answer, Case, Gaps, answer_of
from benchmarks.blind.gap.campaign import answer_gap, answer_is_measured, known_gaps, truth_gaps
from benchmarks.blind.held_out import with_classes_held_out
from benchmarks.blind.make import each_done, workers
from benchmarks.blind.metrics import first_answer
from benchmarks.blind.page import page
from benchmarks.blind.result import Confusion, as_json
from benchmarks.blind.runner import CALIBRATED, Cost, cost_of, diagnosis_file
from benchmarks.blind.seal import Frozen, frozen_of
from benchmarks.blind.sets import OUTSIDE
from benchmarks.blind.table import BESIDE, JUDGED, UNKNOWN

FAILED = "(failed)"


def measure_truths(folder: Path, campaigns: Sequence[Campaign]) -> None:
    """Work out how far the true effects close each gap, on two processes; needs no diagnosis."""
    _all_gaps(folder, [campaign for campaign in campaigns if hides(campaign)], truth_gaps)


def measure_gaps(folder: Path, campaigns: Sequence[Campaign]) -> None:
    """Work out all that a score needs of campaigns that were diagnosed, on two processes."""
    _all_gaps(folder, [campaign for campaign in campaigns if hides(campaign)], _gaps_of)


def is_measured(folder: Path, campaign: Campaign) -> bool:
    """Whether all gaps are known that a score needs of a campaign that was diagnosed."""
    if not hides(campaign):
        return True
    return known_gaps(folder, campaign) is not None and (
        _only_truth(campaign) or answer_is_measured(folder, campaign)
    )


def score(folder: Path, campaigns: Sequence[Campaign], quick: bool = False) -> bool:
    """Print the figures, write score.json and score.txt; returns whether the frozen program met every bar.

    Campaigns that were not diagnosed yet are left out, and their number is said. Gaps are kept as they are
    measured, so that a score that was stopped goes on; `quick` measures none: effects whose gaps are not
    known yet count as shown and have no shrink. Raises SealBroken if the answers have changed.
    """
    frozen = frozen_of(folder)
    costs = {
        (each.name, look): cost
        for each in campaigns
        for look in ("", CALIBRATED)
        if (cost := cost_of(folder, each.name + look))
    }
    asked = [each for each in campaigns if hides(each) and (each.name, "") in costs]
    gaps = _known_gaps(folder, asked) if quick else _all_gaps(folder, asked, _gaps_of)
    if unknown := [each.name for each in asked if each.name not in gaps]:
        print(
            f"no gap is known of {', '.join(unknown)}: they count as shown, and in no shrink", file=sys.stderr
        )
    cases = _judged_held_out(
        [
            _case(folder, each, look, gaps.get(each.name), costs[each.name, look])
            for each in campaigns
            for look in ("", CALIBRATED)
            if (each.name, look) in costs
        ]
    )
    judged, beside = ([figure.measure(cases) for figure in part] for part in (JUDGED, BESIDE))
    notes = _notes(cases, campaigns, list(costs.values()), frozen)
    table = confusion(cases)
    baselines = baseline_values(cases)
    text = page(judged, beside, baselines, table, notes)
    print(text)
    (folder / "score.txt").write_text(text)
    result = as_json(judged, beside, baselines, table, notes, cases)
    (folder / "score.json").write_text(json.dumps(result, indent=1, allow_nan=False))
    return all(figure.met for figure in judged) and _programs(list(costs.values())) == {frozen.program_sha256}


def hides(campaign: Campaign) -> bool:
    """Whether something is hidden."""
    return campaign.kind != "none"


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
        one = case.campaign.kind not in ("pair", "triple")
        if one and case.campaign.right_page and not case.calibrated:
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
    if _only_truth(campaign):
        return known
    after = answer_gap(folder, campaign)
    return Gaps(known.before, known.oracle, known.before if after is None else after)


def _only_truth(campaign: Campaign) -> bool:
    """Whether what an answer closes is another question, or judged by no figure."""
    return not campaign.right_page or campaign.kind in (*OUTSIDE, "wired")


def _known_gaps(folder: Path, campaigns: Sequence[Campaign]) -> dict[str, Gaps]:
    return {each.name: _gaps_of(folder, each) for each in campaigns if is_measured(folder, each)}


def _judged_held_out(cases: Sequence[Case]) -> list[Case]:
    """With thresholds for "unknown" that were set without a case's class, where there are enough."""
    main = {id(case) for case in UNKNOWN(cases)}
    rest = [case for case in cases if id(case) not in main]
    return [*with_classes_held_out(UNKNOWN(cases)), *rest]


def _case(folder: Path, campaign: Campaign, look: str, gaps: Gaps | None, cost: Cost) -> Case:
    answer = read_answer(folder, campaign.name + look, cost)
    case = Case(campaign, answer, gaps, cost.wall_s, cost.cpu_s, cost.memory_mb, calibrated=bool(look))
    return replace(case, gaps=None if gaps is None else replace(gaps, after=None)) if look else case


def _notes(
    cases: Sequence[Case], campaigns: Sequence[Campaign], costs: Sequence[Cost], frozen: Frozen
) -> list[str]:
    failed = [case.campaign.name for case in cases if case.answer is None]
    done = [case for case in cases if not case.calibrated]
    kinds = Counter(case.campaign.kind for case in done)
    programs = _programs(costs)
    hidden = [case for case in cases if hides(case.campaign) and not case.visible]
    return [
        f"{len(done)} of {len(campaigns)} campaigns diagnosed ({_listed(kinds)}), "
        f"{sum(case.calibrated for case in cases)} of them once more by a model of healthy rigs, "
        f"{len(failed)} failed" + (f": {', '.join(failed)}" if failed else ""),
        f"{len(hidden)} whose settings cannot show what is hidden",
        f"diagnosed by {len(programs)} version{'s' if len(programs) != 1 else ''} of the program",
        f"drawn with seed {frozen.seed} for commit {frozen.commit}, which "
        + ("diagnosed all" if programs <= {frozen.program_sha256} else "is NOT what diagnosed"),
    ]


def _programs(costs: Sequence[Cost]) -> set[str]:
    return {cost.program_sha256 for cost in costs}


def _listed(numbers: Counter[Any]) -> str:
    return ", ".join(f"{number} {kind}" for kind, number in sorted(numbers.items()))

"""The figures of the check, those with a bar first."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from benchmarks.blind import metrics
from benchmarks.blind.campaigns import RIGS, Kind
from benchmarks.blind.cases import Case
from benchmarks.blind.figure import Bar, Figure, OfCase, Selection, largest_of, mean_of, median_of


def _of(cases: Sequence[Case], kinds: tuple[Kind, ...]) -> list[Case]:
    return [case for case in cases if case.campaign.kind in kinds]


def _of_visible(cases: Sequence[Case], kinds: tuple[Kind, ...]) -> list[Case]:
    return [case for case in _of(cases, kinds) if case.visible]


def _one_truth(cases: Sequence[Case]) -> list[Case]:
    return [*_of_visible(cases, ("single",)), *_of(cases, ("none", "outside"))]


def _measured(cases: Sequence[Case], kinds: tuple[Kind, ...]) -> list[Case]:
    """Those whose answer's effects were put into the twin; a failed diagnosis closes nothing and counts."""
    visible = [case for case in _of_visible(cases, kinds) if case.gaps is not None]
    return [case for case in visible if case.answer is None or metrics.gap_after(case) is not None]


def _having(cases: Sequence[Case], metric: OfCase) -> list[Case]:
    return [case for case in SHOWN(cases) if metric(case) is not None]


def _between(cases: Sequence[Case], low: float, high: float) -> list[Case]:
    return [case for case in SHOWN(cases) if case.gaps is not None and low <= case.gaps.before < high]


def _timed(cases: Sequence[Case], least_runs: int) -> list[Case]:
    return [case for case in cases if case.wall_s is not None and len(case.campaign.runs) >= least_runs]


def _on_rig(cases: Sequence[Case], rig: str, select: Selection) -> list[Case]:
    return [case for case in select(cases) if case.campaign.rig == rig]


def _of_rig(rig: str) -> tuple[Figure, ...]:
    """What a reader asks of each rig alone."""
    shown, nothing, pairs = (partial(_on_rig, rig=rig, select=select) for select in (SHOWN, _NOTHING, _PAIRS))
    return (
        _share(f"{rig}: first answer right", shown, metrics.first_right),
        _share(f"{rig}: among the first three", shown, metrics.three_right),
        _share(f"{rig}: location right", shown, metrics.location_right),
        _share(f"{rig}: false alarms", nothing, metrics.false_alarm),
        Figure(f"{rig}: F1 of pairs", pairs, metrics.pairs_f1),
    )


def _kind(*kinds: Kind) -> Selection:
    return partial(_of, kinds=kinds)


def _share(what: str, select: Selection, metric: OfCase, bar: Bar | None = None) -> Figure:
    return Figure(what, select, mean_of(metric), "wilson", bar)


def _mean(what: str, select: Selection, metric: OfCase, bar: Bar | None = None) -> Figure:
    return Figure(what, select, mean_of(metric), "bootstrap", bar)


SHOWN: Selection = partial(_of_visible, kinds=("single",))
"""Single effects that the settings can show."""
_EVERY = _kind("single", "none", "pair", "outside")
_PAIRS, _NOTHING, _OUTSIDE = _kind("pair"), _kind("none"), _kind("outside")
_REPAIRED: Selection = partial(_measured, kinds=("single", "pair"))
_ESTIMATED: Selection = partial(_having, metric=metrics.parameter_error)
_ON_A_CHANNEL: Selection = partial(_having, metric=metrics.channel_right)
_THREE_RUNS_S = 180.0

JUDGED = (
    _share("single effects shown: first answer right", SHOWN, metrics.first_right, Bar(low=0.85)),
    _share("single effects shown: among the first three", SHOWN, metrics.three_right, Bar(low=0.97)),
    _mean(
        "probability on the truth (singles shown, none, outside)",
        _one_truth,
        metrics.truth_probability,
        Bar(low=0.75),
    ),
    Figure("calibration error, ten bins", _EVERY, metrics.calibration_error, bar=Bar(high=0.08)),
    _share("false alarms when nothing is missing", _NOTHING, metrics.false_alarm, Bar(high=0.05)),
    _share("location right", SHOWN, metrics.location_right, Bar(low=0.90)),
    _mean(
        "shrink relative to the true effects' (singles, pairs)",
        _REPAIRED,
        metrics.relative_shrink,
        Bar(low=0.85),
    ),
    Figure(
        "main parameter: median relative error",
        _ESTIMATED,
        median_of(metrics.parameter_error),
        bar=Bar(high=0.15),
    ),
    _share(
        "main parameter: coverage of the 95 % interval",
        _ESTIMATED,
        metrics.parameter_covered,
        Bar(0.85, 0.99),
    ),
    Figure("pairs: F1 of selected", _PAIRS, metrics.pairs_f1, bar=Bar(low=0.70)),
    Figure("unknown: AUROC", _EVERY, metrics.auroc, bar=Bar(low=0.85)),
    Figure(
        "three runs: longest wall time, s",
        partial(_timed, least_runs=3),
        largest_of(metrics.wall),
        "none",
        Bar(high=_THREE_RUNS_S),
    ),
)

BESIDE = (
    _share("first three, a set counts 1/n wherever it is named", SHOWN, metrics.three_right_by_set),
    _share("most probable effect right, none and unknown aside", SHOWN, metrics.first_effect_right),
    _share("first answer right, all single effects", _kind("single"), metrics.first_right),
    _share("first answer right, gap below 2", partial(_between, low=0.0, high=2.0), metrics.first_right),
    _share("first answer right, gap 2 to 4", partial(_between, low=2.0, high=4.0), metrics.first_right),
    _share("first answer right, gap above 4", partial(_between, low=4.0, high=1e9), metrics.first_right),
    _mean("probability on the truth, singles shown", SHOWN, metrics.truth_probability),
    _mean("probability on the truth, nothing missing", _NOTHING, metrics.truth_probability),
    _mean("probability on the truth, outside", _OUTSIDE, metrics.truth_probability),
    _mean("probability on either of a pair", _PAIRS, metrics.truth_probability),
    _mean("Brier score (singles shown, none, outside)", _one_truth, metrics.brier),
    Figure("calibration error of the perfectly calibrated", _EVERY, metrics.calibrated_error, "none"),
    _share("nothing missing, first answer not none", _NOTHING, metrics.not_none),
    _share("outside: first answer right", _OUTSIDE, metrics.first_right),
    _share("outside: effects given p > 0.5", _OUTSIDE, metrics.false_alarm),
    _share("channel right where the effect is", _ON_A_CHANNEL, metrics.channel_right),
    _mean("relative shrink, singles", partial(_measured, kinds=("single",)), metrics.relative_shrink),
    _mean("relative shrink, pairs", partial(_measured, kinds=("pair",)), metrics.relative_shrink),
    Figure("relative shrink, median", _REPAIRED, median_of(metrics.relative_shrink)),
    _share("pairs: selected just what is hidden", _PAIRS, metrics.exact_set),
    Figure("wall time, median, s", partial(_timed, least_runs=1), median_of(metrics.wall), "none"),
    Figure("wall time, longest, s", partial(_timed, least_runs=1), largest_of(metrics.wall), "none"),
    *(figure for rig in RIGS for figure in _of_rig(rig)),
)

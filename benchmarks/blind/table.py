"""The figures of the check, those with a bar first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from benchmarks.blind import metrics
from benchmarks.blind.campaigns import MOST_RUNS
from benchmarks.blind.cases import Case
from benchmarks.blind.catalogue import BEAM, CRANK, SPATIAL
from benchmarks.blind.figure import Bar, Figure, OfCase, OfCases, Selection, largest_of, mean_of, median_of
from benchmarks.blind.operating_points import whole_cycles
from benchmarks.blind.sets import OUTSIDE, RIGS, SETS, WRONG_PAGES, Kind

_LABS = ("lab", *WRONG_PAGES)
_BY_THEMSELVES = (*_LABS, "wired")
_MAIN = tuple(name for name in SETS if name not in _BY_THEMSELVES)
_LEAST_CYCLES = 3


@dataclass(frozen=True, slots=True)
class Where:
    """Which cases a figure is of: kinds (empty: all), sets, rigs, and whether calibrated by healthy rigs.

    `shown`: only effects that the settings can show. `runs`: just so many. `having`: where this has a value.
    """

    kinds: tuple[Kind, ...] = ()
    sets: tuple[str, ...] = _MAIN
    rigs: tuple[str, ...] = RIGS
    calibrated: bool = False
    shown: bool = False
    runs: int | None = None
    having: OfCase | None = None

    def __call__(self, cases: Sequence[Case]) -> list[Case]:
        return [case for case in cases if self._holds(case)]

    def _holds(self, case: Case) -> bool:
        campaign = case.campaign
        return (
            (not self.kinds or campaign.kind in self.kinds)
            and campaign.of_set in self.sets
            and campaign.rig in self.rigs
            and case.calibrated is self.calibrated
            and (case.visible or not self.shown or not case.hidden)
            and self.runs in (None, len(campaign.runs))
            and (self.having is None or self.having(case) is not None)
        )


def _share(what: str, select: Selection, metric: OfCase, bar: Bar | None = None) -> Figure:
    return Figure(what, select, mean_of(metric), "wilson", bar)


def _mean(what: str, select: Selection, metric: OfCase, bar: Bar | None = None) -> Figure:
    return Figure(what, select, mean_of(metric), "bootstrap", bar)


def _enough(cases: Sequence[Case]) -> list[Case]:
    """Of which one run at least has three whole cycles, calibrated or not."""
    return [
        case for case in cases if any(whole_cycles(point) >= _LEAST_CYCLES for point in case.campaign.runs)
    ]


def _wrong(cases: Sequence[Case]) -> list[Case]:
    """Wrong answers on wrong pages, without a calibration."""
    asked = Where(("none", "single"), WRONG_PAGES, shown=True)(cases)
    return [case for case in asked if metrics.first_right(case) == 0]


def _named_wrongly(cases: Sequence[Case]) -> list[Case]:
    """Those of them that say that something is there."""
    return [case for case in _wrong(cases) if metrics.not_none(case)]


def _right(cases: Sequence[Case]) -> list[Case]:
    return [case for case in SHOWN(cases) if math.isfinite(metrics.parameter_error(case))]


def _between(low: float, high: float) -> Selection:
    return lambda cases: [
        case for case in SHOWN(cases) if case.gaps is not None and low <= case.gaps.before < high
    ]


def _seen(cases: Sequence[Case]) -> list[Case]:
    return [case for case in UNKNOWN(cases) if not case.outside or not case.campaign.novel]


def _novel(cases: Sequence[Case]) -> list[Case]:
    return [case for case in UNKNOWN(cases) if not case.outside or case.campaign.novel]


def _strength(kind: Kind) -> Where:
    return Where(("none", "single", "pair", "triple", kind))


def _novel_of(kind: Kind) -> Selection:
    return lambda cases: [case for case in _novel(cases) if not case.outside or case.campaign.kind == kind]


def _mild_shown(cases: Sequence[Case]) -> list[Case]:
    return [case for case in _strength("mild")(cases) if case.visible or not case.outside]


SHOWN = Where(("single",), shown=True)
"""Single effects that the settings can show."""
UNKNOWN = Where()
_NOTHING, _PAIRS, _TRIPLES, _OUTSIDE = (
    Where(kinds) for kinds in (("none",), ("pair",), ("triple",), OUTSIDE)
)
_WIRED = Where(("wired",), ("wired",), shown=True)
_ONE_TRUTH = Where(("single", "none", *OUTSIDE), shown=True)
_REPAIRED = Where(("single", "pair", "triple"), shown=True, having=metrics.gap_after)
_TWO_RIGS = (BEAM, CRANK)
_THREE_RUNS, _LONGEST = Where(runs=3, rigs=_TWO_RIGS, having=metrics.wall), largest_of(metrics.wall)
_SPATIAL_S, _MEMORY_MB = 180.0, 3000.0


def _rightness(rigs: tuple[str, ...], name: str, first: float, three: float) -> tuple[Figure, ...]:
    shown = replace(SHOWN, rigs=rigs)
    return (
        _share(f"{name}, single effects shown: first right", shown, metrics.first_right, Bar(low=first)),
        _share(f"{name}, single effects shown: among three", shown, metrics.three_right, Bar(low=three)),
    )


def _unknown(what: str, select: Selection, value: OfCases, bar: Bar | None = None) -> Figure:
    return Figure(f"unknown, {what}: AUROC", select, value, bar=bar)


JUDGED = (
    _share("refused or failed, of all with three whole cycles", _enough, metrics.failed, Bar(high=0.0)),
    *_rightness((BEAM,), "beam", 0.95, 0.99),
    *_rightness((CRANK,), "planar crank", 0.95, 0.99),
    *_rightness((SPATIAL,), "spatial crank", 0.85, 0.95),
    _mean(
        "p on the truth (singles shown, none, outside)", _ONE_TRUTH, metrics.truth_probability, Bar(low=0.92)
    ),
    Figure(
        "calibration error above the perfectly calibrated",
        UNKNOWN,
        metrics.calibration_error,
        bar=Bar(high=0.015),
        less=metrics.calibrated_error,
    ),
    _share("false alarms when nothing is missing", _NOTHING, metrics.false_alarm, Bar(high=0.02)),
    _share("location of singles right", SHOWN, metrics.location_right, Bar(low=0.96)),
    _share("location of unknowns right", _OUTSIDE, metrics.place_right, Bar(low=0.75)),
    _mean("shrink relative to the truth's, mean", _REPAIRED, metrics.relative_shrink, Bar(low=0.95)),
    Figure(
        "shrink relative to the truth's, median",
        _REPAIRED,
        median_of(metrics.relative_shrink),
        bar=Bar(low=0.95),
    ),
    Figure(
        "main parameter: median relative error",
        SHOWN,
        median_of(metrics.parameter_error),
        bar=Bar(high=0.02),
    ),
    _share("main parameter: coverage of 95 %", SHOWN, metrics.parameter_covered, Bar(0.90, 0.98)),
    Figure("pairs: F1 of selected", _PAIRS, metrics.selected_f1, bar=Bar(low=0.88)),
    Figure("triples: F1 of selected", _TRIPLES, metrics.selected_f1, bar=Bar(low=0.75)),
    _unknown("classes no threshold was set with", _novel, metrics.auroc, Bar(low=0.93)),
    _unknown("mild", _strength("mild"), metrics.auroc, Bar(low=0.93)),
    _unknown("strong", _strength("strong"), metrics.auroc, Bar(low=0.93)),
    _share(
        "wrong page, calibrated: healthy called healthy",
        Where(("none",), WRONG_PAGES, calibrated=True),
        metrics.first_right,
        Bar(low=0.90),
    ),
    _share(
        "wrong page, calibrated: singles shown, first right",
        Where(("single",), WRONG_PAGES, calibrated=True, shown=True),
        metrics.first_right,
        Bar(low=0.80),
    ),
    _share("wrong page, as it is: unknown, of wrong answers", _wrong, metrics.unknown_first, Bar(low=0.8)),
    Figure(
        "spatial crank: longest wall time, s",
        Where(rigs=(SPATIAL,), having=metrics.wall),
        largest_of(metrics.wall),
        "none",
        Bar(high=_SPATIAL_S),
    ),
    Figure(
        "memory of all processes, largest, MB",
        Where(having=metrics.memory),
        largest_of(metrics.memory),
        "none",
        Bar(high=_MEMORY_MB),
    ),
)


def _of_rig(rig: str) -> Iterator[Figure]:
    """What a reader asks of each rig alone."""
    yield _share(f"{rig}: location right", replace(SHOWN, rigs=(rig,)), metrics.location_right)
    yield _share(f"{rig}: false alarms", replace(_NOTHING, rigs=(rig,)), metrics.false_alarm)
    yield Figure(f"{rig}: F1 of pairs", replace(_PAIRS, rigs=(rig,)), metrics.selected_f1)
    yield Figure(f"{rig}: unknown, AUROC", replace(UNKNOWN, rigs=(rig,)), metrics.auroc)
    timed = Where(rigs=(rig,), having=metrics.processor)
    yield Figure(f"{rig}: processor time, median, s", timed, median_of(metrics.processor))


def _of_page(page: str) -> Iterator[Figure]:
    """A lab by itself, as it comes and once calibrated."""
    for calibrated, name in ((False, "as it is"), (True, "calibrated")):
        healthy, single = (
            Where(("none",), (page,), RIGS, calibrated),
            Where(("single",), (page,), RIGS, calibrated),
        )
        yield _share(f"{page}, {name}: healthy called healthy", healthy, metrics.first_right)
        yield _share(f"{page}, {name}: false alarms", healthy, metrics.false_alarm)
        yield _share(
            f"{page}, {name}: singles shown, first right", replace(single, shown=True), metrics.first_right
        )


def _of_runs(runs: int) -> Iterator[Figure]:
    several = f"{runs} run{'s' if runs > 1 else ''}"
    yield Figure(f"pairs, {several}: F1 of selected", replace(_PAIRS, runs=runs), metrics.selected_f1)
    yield _share(f"singles shown, {several}: first right", replace(SHOWN, runs=runs), metrics.first_right)


BESIDE = (
    _share("first three, a set counts 1/n wherever it is named", SHOWN, metrics.three_right_by_set),
    _share("most probable effect right, none and unknown aside", SHOWN, metrics.first_effect_right),
    _share("first answer right, all single effects", Where(("single",)), metrics.first_right),
    _share("wired wrongly, shown: first right", _WIRED, metrics.first_right),
    _share("wired wrongly, shown: among three", _WIRED, metrics.three_right),
    _share("first answer right, gap below 2", _between(0.0, 2.0), metrics.first_right),
    _share("first answer right, gap 2 to 4", _between(2.0, 4.0), metrics.first_right),
    _share("first answer right, gap above 4", _between(4.0, 1e9), metrics.first_right),
    _mean("p on the truth, singles shown", SHOWN, metrics.truth_probability),
    _mean("p on the truth, nothing missing", _NOTHING, metrics.truth_probability),
    _mean("p on the truth, outside", _OUTSIDE, metrics.truth_probability),
    _mean("p on any of a pair", _PAIRS, metrics.truth_probability),
    _mean("Brier score (singles shown, none, outside)", _ONE_TRUTH, metrics.brier),
    Figure("calibration error, ten bins", UNKNOWN, metrics.calibration_error),
    Figure("calibration error of the perfectly calibrated", UNKNOWN, metrics.calibrated_error, "none"),
    _share("nothing missing, first answer not none", _NOTHING, metrics.not_none),
    _share("outside: first answer right", _OUTSIDE, metrics.first_right),
    _share("outside: effects given p > 0.5", _OUTSIDE, metrics.false_alarm),
    _share("outside: a place is told", _OUTSIDE, metrics.place_told),
    _share(
        "channel right where the effect is",
        replace(SHOWN, having=metrics.channel_right),
        metrics.channel_right,
    ),
    _share("coverage of the main parameter, effect and channel right", _right, metrics.parameter_covered),
    _mean("relative shrink, singles", replace(_REPAIRED, kinds=("single",)), metrics.relative_shrink),
    _mean("relative shrink, pairs", replace(_REPAIRED, kinds=("pair",)), metrics.relative_shrink),
    _mean("relative shrink, triples", replace(_REPAIRED, kinds=("triple",)), metrics.relative_shrink),
    _share("pairs: selected just what is hidden", _PAIRS, metrics.exact_set),
    _share("triples: selected just what is hidden", _TRIPLES, metrics.exact_set),
    # 94 is the last check's, 0d78d42's; `benchmarks.versions` holds versions against each other in one run
    Figure("beam, planar crank, 3 runs: median, s", _THREE_RUNS, median_of(metrics.wall)),
    Figure("beam, planar crank, 3 runs: longest, s (baseline: 94)", _THREE_RUNS, _LONGEST, "none"),
    *(figure for runs in range(1, MOST_RUNS + 1) for figure in _of_runs(runs)),
    _unknown("all", UNKNOWN, metrics.auroc),
    _unknown("classes that thresholds were set with", _seen, metrics.auroc),
    _unknown("mild, those that the settings show", _mild_shown, metrics.auroc),
    _unknown("mild, classes no threshold was set with", _novel_of("mild"), metrics.auroc),
    _unknown("strong, classes no threshold was set with", _novel_of("strong"), metrics.auroc),
    _share("wrong page, as it is: unknown, of wrong answers but none", _named_wrongly, metrics.unknown_first),
    _mean(
        "unknown, score refitted with classes held out: AUROC",
        replace(_OUTSIDE, having=metrics.outranks),
        metrics.outranks,
    ),
    _share(
        "unknown, threshold of other classes: found", replace(_OUTSIDE, having=metrics.above), metrics.above
    ),
    _share(
        "unknown, threshold of other classes: mistaken",
        Where(("none", "single", "pair", "triple"), having=metrics.above),
        metrics.above,
    ),
    *(figure for rig in RIGS for figure in _of_rig(rig)),
    *(figure for page in _LABS for figure in _of_page(page)),
)

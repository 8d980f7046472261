"""From recordings of a healthy rig to values of its [model] (`rattle identify`)."""

from __future__ import annotations

import hashlib
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from threadpoolctl import threadpool_limits

from daq.disk import write_whole
from daq.errors import LogError, RattleError, SimulationFailed
from daq.quantity import Quantity, Setting
from rig.diagnosis.experiments import options
from rig.diagnosis.kept import kept_arrays, version_of
from rig.diagnosis.model_values import WithValues, closed_by, tolerance_of
from rig.diagnosis.one_rig import NOT_THIS_RIG, Refused, of_one_rig, require_alike, require_one_rig
from rig.diagnosis.recordings import RecordedCampaign, recorded, work_of
from rig.ensembles import Simulated, cores, worker_processes
from rig.files.faults import Faults
from rig.files.model_file import Identified, head_text, identified_text, parse_model
from rig.files.quantity import si_factor
from rig.files.scenario import Scenario, parse_scenario
from rig.files.table import FieldError, field_of
from rig.pages.words import listed
from rig.rigs import RIGS
from rig.rigs.kind import RigKind, at
from rig.session.pace import reading
from rig.session.progress import Screen
from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.fingerprint import Cell, NarrowColumns
from sim_twin.diagnosis.gap import gap_measure
from sim_twin.diagnosis.identification import (
    BLOCKS,
    Known,
    Round,
    Rounds,
    Wide,
    after_one_more,
    draws_of,
    fitted_rounds,
    nothing_known,
    rounds_of,
)
from sim_twin.diagnosis.subject import Draw, Execute, Observed
from sim_twin.healthy import Matched, MatchedTwin
from sim_twin.twin import AnyTwin

_TIMES = 10.0
"""A value that healthy rigs differ by may lie that many of their deviations off."""
_HALF = 0.5
"""Deviation, as a share, of a value in which healthy rigs do not differ."""
_ENDS = 2.0
"""Deviations from the middle of a range that was asked for to its ends."""
_WIDE_RANGE = 3.0
"""Ratio of a range's ends from which on it is one of ratios."""


def identifying(runs: Sequence[RunSetting], scenarios: Sequence[Scenario], free: Sequence[str]) -> WithValues:
    """Runs of their scenarios, in which the values of `free` keys are those of a draw, exactly."""
    kind, opened = RIGS[scenarios[0].rig], list[RunSetting]()
    for run in runs:
        closed = tuple(sorted({name for key in free for name in closed_by(kind, key, run.twin)}))
        known = Matched(closed, np.zeros(len(closed)), np.zeros((len(closed), len(closed))))
        own = run.twin
        twin = MatchedTwin(own.rig, own.drive, own.sensors, own.widths, own.besides, known)
        opened.append(replace(run, twin=twin))
    return WithValues(tuple(opened), rig=kind.name, given=tuple(each.model for each in scenarios))


def wide_of(kind: RigKind, key: str, given: Mapping[str, Any], twin: AnyTwin, between: str = "") -> Wide:
    """A key's value as it is looked for, `between` LOW..HIGH where that is asked for.

    Raises FieldError, which says what may be asked for.
    """
    setting = kind.numbers.get(key)
    if setting is None or not isinstance(meaning := setting.meaning, Quantity):
        several = [name for name in kind.numbers if name.startswith(f"{key}[")]
        raise FieldError(listed(several, "or") if several else "a key of one number that is no count")
    *of_part, step = setting.place
    if at(twin.rig, setting.place if step.isdigit() else tuple(of_part)) is None:
        raise FieldError("a key of a part that the rig has")
    low, high = (end * si_factor(meaning.unit) for end in (meaning.low, meaning.high))
    if between:
        return _asked(setting, between)
    centre = kind.value(key, given)
    if centre is None:
        raise FieldError(f"what the rig has, or a range, such as {key}=LOW..HIGH: it has none as it stands")
    tolerance = tolerance_of(kind, key, twin)
    if tolerance is not None and not tolerance.relative:
        return Wide(key, centre, _TIMES * tolerance.deviation, low, high, by_ratio=False)
    if not centre > 0:
        raise FieldError(f"a range, such as {key}=LOW..HIGH: it is {centre:g}, of which there is no share")
    return Wide(key, centre, _HALF if tolerance is None else _TIMES * tolerance.deviation, low, high)


def _asked(setting: Setting, between: str) -> Wide:
    first, mark, last = between.partition("..")
    if not mark:
        raise FieldError(f"a range, such as {setting.key}=LOW..HIGH")
    low, high = (float(field_of(setting).read(_plain(end))) for end in (first, last))
    if not low < high:
        raise FieldError("a range from its lower end to its higher")
    if low > 0 and high / low > _WIDE_RANGE:
        return Wide(setting.key, (low * high) ** 0.5, float(np.log(high / low)) / 2 / _ENDS, low, high)
    return Wide(setting.key, (low + high) / 2, (high - low) / 2 / _ENDS, low, high, by_ratio=False)


def _plain(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text.strip()


def wides_of(data: RecordedCampaign, free: Mapping[str, str]) -> tuple[Wide, ...]:
    """The values of `free` keys (each with its range, or nothing); ConfigurationError with every fault."""
    faults = Faults("--free")
    scenarios, twin = [parse_scenario(text) for text in data.scenarios], data.campaign.runs[0].twin
    kind, found = RIGS[scenarios[0].rig], list[Wide]()
    for key, between in free.items():
        if key not in kind.model:
            faults.unknown(key, between, key, kind.model)
            continue
        values = {kind.value(key, each.model) for each in scenarios}
        try:
            if len(values) > 1:
                raise FieldError("the same in all runs: what a lab sets between runs is no value of the rig")
            found.append(wide_of(kind, key, scenarios[0].model, twin, between))
        except FieldError as error:
            faults.add(key, between, str(error))
    if not found and not faults:
        faults.add("KEYS", "", "keys of [model], such as contact_stiffness; rattle scenario RIG lists them")
    faults.raise_if_any()
    return tuple(found)


STILL_MOVED = "The values still moved in the last round"
TOGETHER = "{} are told together only: fix those of them that you know"
AT_END = "{0} lies at the end of where it was looked for: --free {0}=LOW..HIGH with a wider range"


@dataclass(frozen=True, slots=True)
class Identification:
    """What was found: `gap` of the rig from its twin with the values, as a healthy rig's is 1.

    `known` is as wide as the gap and what still moved make it. `was` are the values that the scenarios have,
    SI; `next_run` a scenario that would tell more. Not `converged`: the values still moved in the last round.
    `gaps` are those of the runs by themselves, each with its name.
    """

    known: Known
    was: Mapping[str, float | None]
    gap: float
    converged: bool
    next_run: str | None = None
    gaps: tuple[tuple[str, float], ...] = ()


class OutOfTime(RattleError):
    """What has been simulated by then is kept."""


_GROUP = 8
"""Draws that are kept in one file, on however many cores."""


class Kept:
    """Has draws simulated and keeps what they showed in `folder`, so that an interrupted search goes on.

    Simulates `at_once` groups of them. Raises OutOfTime where there is no time for them.
    """

    def __init__(self, folder: Path, about: str, simulate: Execute, at_once: int) -> None:
        self._folder, self._about, self._simulate, self._at_once = folder, about, simulate, at_once
        self.found = 0

    def __call__(self, draws: Sequence[Draw]) -> list[Observed]:
        groups = [draws[first : first + _GROUP] for first in range(0, len(draws), _GROUP)]
        shown = {number: kept for number, each in enumerate(groups) if (kept := self._kept(each)) is not None}
        missing = [number for number in range(len(groups)) if number not in shown]
        for first in range(0, len(missing), self._at_once):
            now = missing[first : first + self._at_once]
            observed = iter(self._simulate([draw for number in now for draw in groups[number]]))
            for number in now:
                shown[number] = list(islice(observed, len(groups[number])))
                self._keep(groups[number], shown[number])
            if not all(each for number in now for each in shown[number]):
                raise OutOfTime(
                    f"time ran out: nothing was written. What was simulated is kept in {self._folder}; the "
                    "same command with a larger --budget goes on there"
                )
        return [each for number in range(len(groups)) for each in shown[number]]

    def _file(self, draws: Sequence[Draw]) -> Path:
        told = hashlib.sha256(f"{self._about}\n{draws!r}".encode()).hexdigest()[:32]
        return self._folder / f"{told}.npz"

    def _kept(self, draws: Sequence[Draw]) -> list[Observed] | None:
        kept = kept_arrays(self._file(draws))
        if kept is None or not kept.keys() >= {"there", "shown"}:
            return None
        shown = iter(kept["shown"])
        self.found += len(draws)
        return [(next(shown) if each else None,) for each in kept["there"]]

    def _keep(self, draws: Sequence[Draw], observed: Sequence[Observed]) -> None:
        if not all(observed):
            return
        simulated = [each[0] for each in observed if each[0] is not None]
        content = BytesIO()
        np.savez(content, there=[each[0] is not None for each in observed], shown=np.array(simulated))
        self._folder.mkdir(exist_ok=True)
        write_whole(self._file(draws), content.getvalue())


_SEARCH_S, _CORES = 240.0, 2
"""Rated seconds of so many cores for the rounds, of the five minutes that all of it is to take."""
_HEALTHY = 48
_FEWEST = 8
_CHATTERS_FROM = 25.0
"""Multiples of a cycle's frequency, beyond which only impacts reach."""
_OVER_NOISE, _MOST_CYCLES = 5.0, 0.5


def read_for(
    runs: Sequence[Path], responses: Sequence[Path], free: Mapping[str, str], screen: Screen
) -> tuple[RecordedCampaign, tuple[Wide, ...], WithValues]:
    """Runs, and others that are looked at by their frequency responses alone, and the values to be found.

    Raises ConfigurationError or LogError for what cannot be used.
    """
    with screen.busy("reading", reading("read for a diagnosis", *runs, *responses)):
        data = recorded([*runs, *responses], partial(_narrow, responses))
    for remark in data.remarks:
        screen.warn(remark)
    if not any(path in runs for path in data.paths):
        raise LogError("no run is left but those of --frf, which tell too little by themselves")
    scenarios = [parse_scenario(text) for text in data.scenarios]
    wides = wides_of(data, free)
    for path, run, records in zip(data.paths, data.campaign.runs, data.records, strict=True):
        _require_chatter(path, run, records, alone=path in responses)
    return data, wides, identifying(data.campaign.runs, scenarios, list(free))


def _narrow(responses: Sequence[Path], path: Path, setting: RunSetting) -> RunSetting:
    columns = setting.columns
    named = {each.name: getattr(columns, each.name) for each in fields(columns)}
    return replace(setting, columns=NarrowColumns(**named, alone=path in responses))


def _require_chatter(path: Path, run: RunSetting, records: Mapping[str, Any], alone: bool) -> None:
    """A rig that hardly strikes tells nothing of what it strikes; a sine `alone` shakes no resonance."""
    rate, corner = run.columns.rate, _CHATTERS_FROM * run.columns.frequency
    passed = signal.butter(4, min(corner, 0.2 * rate), "highpass", fs=rate, output="sos")
    cycles = run.cycles_in(records)
    at = cycles.starts(len(records[run.twin.model.reference]))[:, None] + np.arange(cycles.length)
    struck = np.zeros(len(at), dtype=bool)
    for name in run.columns.coupled:
        noise = max(getattr(run.twin.sensors.get(name), "noise", 0.0), 1e-9)
        over = np.sqrt(np.mean(signal.sosfiltfilt(passed, records[name])[at] ** 2, axis=1))
        struck |= over > _OVER_NOISE * noise
    if alone and not struck.any():
        raise LogError(
            f"{path}: nothing strikes in it, so that its frequency responses hold nothing but the drive; "
            "record one that strikes now and then"
        )
    if not alone and struck.mean() < _MOST_CYCLES:
        raise LogError(
            f"{path}: it chatters in {struck.mean():.0%} of its cycles only, which tells too little; "
            "drive it harder (or name it by --frf, if its frequency responses are meant)"
        )


def require_moves(wides: Sequence[Wide], campaign: WithValues, simulate: Execute) -> None:
    """Refuse values of which nothing that the runs show depends; before any long work."""
    known = nothing_known(wides)
    places = np.concatenate([np.zeros((1, len(wides))), np.eye(len(wides))])
    draws = [replace(each, seed=1) for each in draws_of(known, places, np.random.default_rng(0), blocks=1)]
    base, *moved = (each[0] if each else None for each in simulate(draws))
    faults = Faults("--free")
    for wide, shown in zip(wides, moved, strict=True):
        if base is not None and shown is not None and np.array_equal(base, shown):
            faults.add(wide.name, f"{wide.centre:g}", "left out: nothing that these runs show depends on it")
    faults.raise_if_any()


def last_of(rounds: Iterable[Round], names: Sequence[str], screen: Screen) -> Round:
    """The last of at least one round; each is told of, and what by then is told together only.

    After the first, a third of the work at most, also what is not told so far. RattleError where that is all
    there is: about what is as open as before, no later round looks any nearer. So where runs, of these
    `names`, ask for different values.
    """
    together = list[set[str]]()
    for number, each in enumerate(rounds, 1):
        wides, told, far = each.known.wides, each.known.told(), int(np.argmax(each.moved))
        screen.say(
            f"round {number}: {each.rigs} rigs, {sum(told)} of {len(wides)} values told; "
            f"moved by {each.moved[far]:.2g} deviations at most ({wides[far].name})"
        )
        if not each.last:
            require_one_rig(names, each.apart)
        if number == 1:
            if each.known.as_open_as_before():
                raise _nothing_told(each.known)
            if untold := [wide.name for wide, is_told in zip(wides, told, strict=True) if not is_told]:
                screen.warn(f"not told so far: {listed(untold)}; rounds nearer by may tell more")
        for several in each.known.together():
            if not any(said <= set(several) for said in together):
                screen.warn(TOGETHER.format(listed(several)))
                together.append(set(several))
    return each


def _nothing_told(known: Known) -> Refused:
    if ends := known.at_ends():
        return Refused(f"nothing was written: {'; '.join(AT_END.format(name) for name in ends)}")
    return Refused(
        f"these runs tell none of {listed([wide.name for wide in known.wides])}: nothing was written. Free "
        "fewer at once, give narrower ranges, or add runs at other settings"
    )


def identify(
    data: RecordedCampaign,
    wides: Sequence[Wide],
    campaign: WithValues,
    folder: Path,
    seed: int,
    budget_s: float,
    screen: Screen,
) -> Identification:
    """Find the values; what is simulated is kept in `folder` until it is done.

    Raises RattleError where time ran out, nothing is told, or the runs are of no such rig, or of several.
    """
    planned = _planned(campaign, len(wides))
    total = planned.most * planned.rigs + len(wides) + 1
    work = work_of("identify", campaign, [1] * total)
    deadline = time.monotonic() + budget_s
    with screen.bar("simulating", total, "rigs at most", work) as bar, worker_processes(cores()) as workers:

        def kept(of: Campaign, report: bool = True) -> Kept:
            found: Kept
            tell = (lambda done: bar(min(found.found + done, total))) if report else lambda _: None
            simulated = Simulated(of, workers.executor, deadline, tell)
            found = Kept(folder, _digest(of), simulated, 2 * cores())
            return found

        simulate = kept(campaign)
        require_moves(wides, campaign, simulate)
        layout, compared = campaign.layout.only(partial(_compared, campaign))
        seen = replace(data, measured=data.measured[:, compared])
        require_alike(seen, layout, partial(_shown, kept(campaign, report=False), compared), seed)
        with threadpool_limits(1, user_api="blas"):  # the order of its sums changes last bits
            rng = np.random.default_rng(seed)
            rounds = fitted_rounds(campaign, wides, data.measured, simulate, rng, data.told, planned)
            found = last_of(rounds, [path.name for path in data.paths], screen)
        known = found.known
        if not any(known.told()):
            raise _nothing_told(known)
        best = {wide.name: float(v) for wide, v in zip(wides, known.values(known.mean), strict=True)}
        kind = RIGS[campaign.rig]
        given = parse_scenario(data.scenarios[0]).model
        was = {name: kind.value(name, given) for name in best}
        repaired = _with_best(data, best)
        draws = [Draw((), seed + number, blocks=2) for number in range(_HEALTHY)]
        healthy = _shown(kept(repaired, report=False), compared, draws)
        if len(healthy) < _FEWEST:
            raise RattleError("too few rigs with the values found could be simulated; nothing was written")
        measure = gap_measure(healthy, layout)
        gaps = of_one_rig(seen, measure, healthy)
        cells = measure.cells(seen.measured)
        # many figures of responses that fit are not to hide that a motion does not
        of_motion = measure.total(cells, lambda cell: not _alone(campaign.runs[cell.run]))
        gap = max(of_motion, measure.total(cells))
        if gap > NOT_THIS_RIG:
            raise Refused(
                f"the best such rig still lies a gap of {gap:.2f} from these runs (1 is a healthy rig's), so "
                "something else is missing or wrong: nothing was written. rattle diagnose may tell what"
            )
        require_one_rig([path.name for path in data.paths], found.apart, gap)
        known = known.widened(max(1.0, gap) * np.hypot(1.0, found.unrest))
        if not any(known.told()):
            raise _nothing_told(known)
        more = None
        if any(known.open()):
            screen.say("looking for a further run that would tell more ...")
            more = _next_run(data, known, kept, np.random.default_rng([seed, 1]))
    of_runs = zip([path.name for path in data.paths], gaps, strict=True)
    return Identification(known, was, gap, found.converged, more, tuple(of_runs))


def _planned(campaign: Campaign, values: int) -> Rounds:
    """By the rig's rated speed, so that every machine does the same."""
    seconds = sum(run.motion_s(BLOCKS) for run in campaign.runs)
    return rounds_of(values, _SEARCH_S * _CORES * campaign.runs[0].twin.model.speed / seconds)


def _shown(
    simulate: Execute, compared: NDArray[np.bool_], draws: Sequence[Draw]
) -> list[NDArray[np.floating]]:
    """What is `compared` of the draws that could be simulated."""
    return [each[0][:, compared] for each in simulate(draws) if each and each[0] is not None]


def _compared(campaign: Campaign, cell: Cell) -> bool:
    """Whether `rattle gap` looks at it as well; of a run of responses, which it does not, everything is."""
    return _alone(campaign.runs[cell.run]) or cell.what != "spectrum"


def _alone(run: RunSetting) -> bool:
    return isinstance(run.columns, NarrowColumns) and run.columns.alone


def _with_best(data: RecordedCampaign, best: Mapping[str, float]) -> Campaign:
    """The same runs as a model file with the best values has them."""
    scenarios = [parse_scenario(text) for text in data.scenarios]
    kind = RIGS[scenarios[0].rig]
    runs = [
        replace(run, twin=replace(run.twin, rig=kind.changed(run.twin.rig, scenario.model, best)))
        for run, scenario in zip(data.campaign.runs, scenarios, strict=True)
    ]
    return replace(data.campaign, runs=tuple(runs))


def _next_run(
    data: RecordedCampaign,
    known: Known,
    kept: Callable[[Campaign, bool], Kept],
    rng: np.random.Generator,
) -> str | None:
    """The scenario of one more run that would tell most of what is not told yet, headed by how much.

    None where no run would tell more, or there is no time to look for one.
    """
    open_ones = np.array(known.open())
    at = next(number for number, run in enumerate(data.campaign.runs) if not _alone(run))
    columns, quiet = data.campaign.runs[at].columns, data.campaign.runs[at].quiet
    given = parse_scenario(data.scenarios[at]).model
    names = [wide.name for wide in known.wides]
    best, least = None, float(np.sum(np.log(known.deviation[open_ones])))
    recorded_s = len(data.sound[at]) / columns.rate
    others = options(data.scenarios[at], columns.channels, columns.rate, quiet, data.chains, recorded_s)
    scenarios = [(option, parse_scenario(option.scenario)) for option in others]
    # what is looked for is not set anew
    alike = [each for each in scenarios if all(each[1].model.get(n) == given.get(n) for n in names)]
    for option, scenario in alike[:_TRIED]:
        runs = [_narrow((), Path(), each) for each in option.campaign.runs]  # as it would be looked at
        more = identifying(runs, [scenario], names)
        try:
            deviations = after_one_more(more, known, kept(more, False), rng)
        except SimulationFailed:
            continue
        except OutOfTime:
            break
        left = float(np.sum(np.log(deviations[open_ones])))
        if left < least - _WORTH_IT:
            best, least = f"{_reason(known, deviations)}{option.scenario}", left
    return best


def _reason(known: Known, deviations: NDArray[np.float64]) -> str:
    """What one more run is for, after which values have such `deviations` (n,), as lines of its scenario."""
    rows = zip(known.wides, known.open(), known.deviation, deviations, strict=True)
    lines = [
        "Of other settings this one would tell most of what the runs so far do not. How wide the intervals",
        "are, of what they were beforehand (a value is told from half on):",
        *(f"  {wide.name}: {now:.0%}, then {later:.0%}" for wide, is_open, now, later in rows if is_open),
    ]
    return "".join(f"# {line}\n" for line in lines)


_TRIED = 3
"""Of other settings, the most different ones."""
_WORTH_IT = 0.2
"""By so much of its logarithm at least one more run has to narrow all that is open."""


def _digest(campaign: Campaign) -> str:
    """Of all that what its draws show follows from."""
    runs = [
        (twin.rig, twin.drive, sorted(twin.sensors.items()), twin.widths, twin.besides, run.columns)
        for run in campaign.runs
        for twin in [run.twin]
    ]
    rest = [(run.oversampling, run.cycles, run.quiet) for run in campaign.runs]
    known = [getattr(run.twin, "known", None) for run in campaign.runs]
    given = campaign.given if isinstance(campaign, WithValues) else ()
    sources = version_of(campaign.runs[0])
    names = [each.names for each in known if each is not None]
    return hashlib.sha256(repr((runs, rest, names, given, sources)).encode()).hexdigest()


_NO_ANSWER = "What stands under [not_told] is no answer: with the others it makes the twin that was fitted."


def model_text_of(
    found: Identification,
    rig: str,
    runs: Sequence[str],
    scenarios: Sequence[str],
    specimen: str | None = None,
) -> str:
    """The model file; it can be read."""
    identified = _identified(found)
    middles = zip(found.known.wides, found.known.estimates(), strict=True)
    lines = [
        "# Values of one rig, as rattle identify found them in recordings of it; for --model.",
        "# Behind each its 95 % interval, in the same unit, and what the scenarios had.",
        *([] if all(found.known.told()) else [f"# {_NO_ANSWER}"]),
        *(f"# Told together only: {listed(several)}." for several in found.known.together()),
        *(f"# {AT_END.format(name)}." for name in found.known.at_ends()),
        *([] if found.converged else [f"# {STILL_MOVED}, by which their intervals are wider."]),
        f"# Gap of the rig from its twin with these values: {found.gap:.2f} (1 is as far as a healthy rig).",
        *head_text(rig, runs, scenarios, specimen),
        *identified_text(
            rig,
            {wide.name: each.value for wide, each in middles},
            identified,
            {each.key: _remark(each, rig) for each in identified.values()},
        ),
        "",
    ]
    text = "\n".join(lines)
    parse_model(text, "model", rig)
    return text


def rows(found: Identification, rig: str) -> list[tuple[str, ...]]:
    """Of each value in words: key, value, interval, what it was, whether it is told."""
    told: list[tuple[str, ...]] = []
    for each, middle in zip(_identified(found).values(), found.known.estimates(), strict=True):
        unit = _unit(rig, each.key)
        value = f"{middle.value / si_factor(unit):.4g}" if each.told else "-"
        told.append((each.key, f"{value} {unit}".strip(), *_said(each, rig)))
    return told


def _identified(found: Identification) -> dict[str, Identified]:
    known = found.known
    estimates = zip(known.wides, known.estimates(), known.told(), strict=True)
    return {
        wide.name: Identified(wide.name, each.low, each.high, found.was[wide.name], told)
        for wide, each, told in estimates
    }


def _remark(found: Identified, rig: str) -> str:
    interval, was, untold = _said(found, rig)
    return "; ".join(filter(None, (interval, f"was {was}", untold)))


def _said(found: Identified, rig: str) -> tuple[str, str, str]:
    factor = si_factor(_unit(rig, found.key))
    was = "none" if found.was is None else f"{found.was / factor:.5g}"
    return f"{found.low / factor:.4g} to {found.high / factor:.4g}", was, "" if found.told else "not told"


def _unit(rig: str, key: str) -> str:
    meaning = RIGS[rig].model[key].meaning
    return meaning.unit if isinstance(meaning, Quantity) else ""


def discard(folder: Path) -> None:
    """Remove what was kept of a search that is done."""
    shutil.rmtree(folder, ignore_errors=True)

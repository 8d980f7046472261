"""Diagnoses a rig of somebody's own (`rattle diagnose --subject`): its file, what it measured, one answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv
from threadpoolctl import threadpool_limits

from daq.allowance import Allowance
from daq.errors import LogError, RattleError, SimulationFailed
from daq.formats.arrays import named
from daq.formats.contents import opened
from daq.log.reader import LogReader, begins_as_log
from rig.diagnosis.argument import of_cut_short
from rig.diagnosis.diagnose_runs import write_report
from rig.diagnosis.document import document, effects_file, provenance, write_json
from rig.diagnosis.kept import Kept, kept_rig
from rig.diagnosis.report import arguments, causes, gap_map, own_rig, verdict
from rig.diagnosis.report.case import Case, RunFacts
from rig.diagnosis.report.verdict import LEFT_OPEN
from rig.diagnosis.subject_file import ReadRig, failed, read_rig
from rig.ensembles import Simulated, cores, workers_when_needed
from rig.files.out_folder import check_out
from rig.pages.content import Section
from rig.session.pace import Work
from rig.session.progress import Screen
from sim_twin.diagnosis.findings import Findings
from sim_twin.own_rig import Check, Columns, Effort, Subject, Widening, check, diagnose, pooled

Asked = TypeVar("Asked")
_LEAST, _EACH, _JUDGING = 400, 40, 60
"""Rigs that are simulated to search with, or as many for each cause; and to judge with."""
_WIDTHS = (0.5, 2.0)
_NO_DEADLINE = 1e8
SECTIONS: Sequence[Section[Case]] = (
    Section("Verdict", verdict.parts),
    Section("How far to believe it", own_rig.trust),
    Section("Causes", causes.ranking),
    Section("What does not fit", arguments.what_does_not_fit),
    Section("Why not the next best", arguments.why_not),
    Section("Run by run", arguments.run_by_run),
    Section("Measured, nominal and repaired", own_rig.curves),
    Section("Gap map", gap_map.parts),
    Section("Parameters", causes.parameters),
    Section("Not told apart", causes.not_told_apart),
    Section("Basis", causes.basis),
)


@dataclass(frozen=True, slots=True)
class OwnRequest:
    """What is asked: `subject` is a Python file, or a name of `rattle.subjects`; `runs` are what it measured.

    `seeds` are as many as are asked, from `seed` on; `rigs` are simulated for each, None where the number of
    causes says how many, `effort` times as many in all. After `budget_s`, where that is given, none is
    begun, but for the check, which comes first.
    """

    subject: str
    runs: Sequence[Path]
    seed: int = 0
    seeds: int = 3
    rigs: int | None = None
    effort: float = 1.0
    budget_s: float | None = None


@dataclass(frozen=True, slots=True)
class _Answers:
    """What the check of a subject said, what was found with each seed, and at each other healthy width.

    `rigs` were simulated for each; `lacking` are remarks on what there was no time for.
    """

    subject: Subject
    checked: Check
    rigs: int
    by_seed: Mapping[int, Findings]
    by_width: Mapping[float, Findings]
    lacking: Sequence[str]


def diagnose_own(request: OwnRequest, out: Path, screen: Screen) -> tuple[Findings, dict[str, Path]]:
    """Check a subject, then diagnose what was measured; returns what was found, and the files that say so.

    Raises RattleError for a subject or files that cannot be used.
    """
    began = time.monotonic()
    check_out(out)
    tables = [columns_of(path) for path in request.runs]
    try:
        with threadpool_limits(1, user_api="blas"):
            rig = read_rig(request.subject, tables)
            answers = _answers(request, rig, began, screen)
    except RattleError:
        raise
    except Exception as error:  # whatever a simulator raises
        raise failed(request.subject, error) from error
    each, widths = list(answers.by_seed.values()), answers.by_width
    findings = pooled(each)
    told = [*_seeds(each, findings), *_widths(widths, findings), *_left(findings), *answers.lacking]
    for remark in told:
        screen.warn(remark)
    alike = [f"with {len(each)} seeds"] if len(each) > 1 and not _seeds(each, findings) else []
    tried = len(widths) == len(_WIDTHS)
    alike += ["with narrower and wider healthy rigs"] if tried and not _widths(widths, findings) else []
    if alike:
        screen.say(f"the same {' and '.join(alike)}")
    remarks = [*answers.checked.remarks, *told]
    asked = {"subject": request.subject, "seeds": request.seeds, "rigs": answers.rigs}
    said = {**provenance(request.seed), **asked, "budget_s": request.budget_s}
    content = document(findings, {}, request.runs, said, None, None, time.monotonic() - began, remarks)
    content["by_seed"] = [{"seed": seed, **_in_short(one)} for seed, one in answers.by_seed.items()]
    content["by_width"] = [{"width": times, **_in_short(one)} for times, one in widths.items()]
    content["found_again"] = [
        {"cause": cause, "found": right, "of": of, "else": wrong or None}
        for cause, (right, of, wrong) in answers.checked.found_again.items()
    ]
    out.mkdir(parents=True, exist_ok=True)
    names = {"diagnosis": "diagnosis.json", "effects": "effects.json", "report": "report.html"}
    files = {what: out / name for what, name in names.items()}
    parts = sorted({cell.run for cell in answers.subject.layout.cells})
    name = Path(request.subject).stem
    facts = [
        RunFacts(f"run {k + 1}" if parts != [0] else " ".join(p.name for p in request.runs), name)
        for k in parts
    ]
    case = Case(findings, content, facts, remarks, folder=out)
    content["sentences"] = verdict.sentences(case)
    write_json(files["diagnosis"], content)
    write_json(files["effects"], effects_file(findings))
    write_report(files["report"], case, SECTIONS)
    return findings, files


def _answers(request: OwnRequest, rig: ReadRig, began: float, screen: Screen) -> _Answers:
    """Have a rig checked and diagnosed; what was simulated of it before is not simulated again."""
    subject, name = rig.subject, Path(request.subject).stem
    rigs = max(1, round(request.effort * (request.rigs or max(_LEAST, _EACH * len(subject.causes)))))
    effort = Effort(rigs, _JUDGING)
    latest = began + (_NO_DEADLINE if request.budget_s is None else request.budget_s)
    seeds = range(request.seed, request.seed + request.seeds)
    widths = {times: subject.wider(times) for times in _WIDTHS} if isinstance(subject, Widening) else {}

    def kept(of: Subject) -> Kept:
        return kept_rig(of, lambda: rig.version, screen.warn)

    usual = cache(lambda: kept(subject))  # what is wrong at once is told before anything is looked up
    with workers_when_needed(cores()) as workers:

        def asked(of: Subject, known: Kept, bar: Callable[[float], None]) -> Callable[[int], Findings]:
            execute = known.by(Simulated(of, workers, latest, bar))
            return partial(diagnose, of, rig.measured, effort, execute)

        def at_width(times: float) -> Findings:
            text, other = f"with healthy rigs {times:g} times as wide", widths[times]
            with screen.bar(text, effort.most, "rigs", longest_s=request.budget_s) as bar:
                return asked(other, kept(other), bar)(request.seed)

        looked = Simulated(subject, workers, began + _NO_DEADLINE, lambda _: None)
        with screen.busy("checking the subject", Work(f"check {name} on {cores()}", rigs)):
            checked = check(
                subject, rig.measured, lambda draws: usual().by(looked)(draws), request.seed, rigs, looked
            )
        _tell(request.subject, checked, screen)
        total = len(seeds) * effort.most
        work = Work(f"{name} {'again ' if usual().some else ''}on {cores()}", total)
        with screen.bar("simulating", total, "rigs", work, longest_s=request.budget_s) as bar:
            first, *others = seeds
            ask = asked(subject, usual(), bar)
            by_seed = {first: ask(first), **_in_time(others, ask, latest)}
        by_width = _in_time(widths, at_width, latest)
    lacking = _lacking(by_seed, by_width, len(seeds), widths)
    return _Answers(subject, checked, rigs, by_seed, by_width, lacking)


def _in_time(
    wanted: Iterable[Asked], ask: Callable[[Asked], Findings], latest: float
) -> dict[Asked, Findings]:
    """What was found of all that is wanted; after `latest` (monotonic s), of what there was time for."""
    found = dict[Asked, Findings]()
    for each in wanted:
        try:
            found[each] = ask(each)
        except SimulationFailed:
            if time.monotonic() < latest:
                raise
            break
    return found


def _lacking(
    by_seed: Mapping[int, Findings], by_width: Mapping[float, Findings], seeds: int, widths: Iterable[float]
) -> list[str]:
    """Remarks where there was no time for all of some seeds and widths."""
    shares = ("searched", "judging")
    searched, judging = (min(getattr(one, share) for one in by_seed.values()) for share in shares)
    told = [of_cut_short(searched, judging)] if min(searched, judging) < 1.0 else []
    if len(by_seed) < seeds:
        told.append(f"there was time for {len(by_seed)} of {seeds} seeds")
    whole = {times for times, one in by_width.items() if min(one.searched, one.judging) == 1.0}
    if lacking := [f"{times:g}" for times in widths if times not in whole]:
        told.append(f"no time was left for all of it with healthy rigs {' and '.join(lacking)} times as wide")
    return told


def _tell(name: str, checked: Check, screen: Screen) -> None:
    """What the check found; raises RattleError where no answer could be believed."""
    if checked.faults:
        told = "".join(f"\n  {each}" for each in checked.faults)
        raise RattleError(f"{name} cannot be believed, nothing was diagnosed:{told}")
    for remark in checked.remarks:
        screen.warn(remark)
    right, of, _ = zip(*checked.found_again.values(), strict=True)
    screen.say(
        f"{sum(right)} of {sum(of)} simulated rigs, most with a cause hidden, were taken for what they are"
    )


def _seeds(each: Sequence[Findings], findings: Findings) -> list[str]:
    """A remark where other rigs say otherwise."""
    said, usual = [_said(one) for one in each], _said(findings)
    others = [one for one in said if one != usual]
    if not others:
        return []
    agree, other = f"{len(said) - len(others)} of {len(said)} seeds", ", ".join(dict.fromkeys(others))
    return [f"{agree} say {usual}, the others {other}: not sure; more --rigs or other measurements may tell"]


def _widths(widths: Mapping[float, Findings], findings: Findings) -> list[str]:
    """A remark where the answer hangs on how wide healthy rigs are."""
    usual = _said(findings)
    return [
        f"with healthy rigs {times:g} times as wide the answer would be {_said(one)}"
        for times, one in widths.items()
        if _said(one) != usual
    ]


def _left(findings: Findings) -> list[str]:
    """A remark where what was named does not close the gap."""
    after = findings.gap.after
    if not findings.names or after is None or after < LEFT_OPEN:
        return []
    names = " and ".join(findings.names)
    return [f"a gap of {after:.2g} is left: more is missing than {names}, whose sizes are then wrong"]


def _said(findings: Findings) -> str:
    return " and ".join(findings.names) or findings.verdict


def _in_short(one: Findings) -> dict[str, Any]:
    """What one of several answers says."""
    shares = {"none": one.none, "effect": one.effect, "unknown": one.unknown}
    return {"verdict": one.verdict, "selected": list(one.names), "probability": shares}


def columns_of(path: Path) -> Columns:
    """What a file holds, by the names of its columns: CSV with a line of names, .npz, or a log of one rate.

    Raises RattleError where it is none of these.
    """
    if begins_as_log(path):
        return _of_log(path)
    with opened(path) as file:
        if path.suffix == ".npz":
            return dict(named(path, file))
        return _of_csv(path, Allowance(path, file.fileno()))


def _of_csv(path: Path, allowance: Allowance) -> Columns:
    with csv.open_csv(path) as head:
        names = head.schema.names
    # whatever the first rows look like: 1 may be followed by 1.5
    numbers = csv.ConvertOptions(column_types=dict.fromkeys(names, pa.float64()))
    parts: dict[str, list[NDArray[np.floating]]] = {name: [np.empty(0)] for name in names}
    if len(parts) < len(names):
        raise LogError("columns of one name come twice")
    with csv.open_csv(path, convert_options=numbers) as table:
        for batch in table:
            allowance.spend(held=batch.nbytes, records=len(names))
            for name, cells in zip(names, batch.columns, strict=True):
                parts[name].append(cells.to_numpy(zero_copy_only=False))
    return {name: np.concatenate(each) for name, each in parts.items()}


def _of_log(path: Path) -> Columns:
    with LogReader(path) as log:
        table = log.table("measured", end_s=log.until_stop_s)
    if not table:
        raise LogError(f"{path}: nothing measured in it")
    first, *others = table.values()
    side = (first.sample_rate, first.first_sample, first.end_sample)
    if any((each.sample_rate, each.first_sample, each.end_sample) != side for each in others):
        raise LogError(
            f"{path}: its channels are not side by side; rattle export --to csv makes tables of them"
        )
    times = (first.first_sample + np.arange(len(first.values))) / first.sample_rate
    return {"time": times, **{name: np.asarray(each.values, np.float64) for name, each in table.items()}}

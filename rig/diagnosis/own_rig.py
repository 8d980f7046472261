"""Diagnoses a rig of somebody's own (`rattle diagnose --subject`): its file, what it measured, one answer."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv
from threadpoolctl import threadpool_limits

from daq.allowance import Allowance
from daq.errors import LogError, RattleError
from daq.formats.arrays import named
from daq.formats.contents import opened
from daq.log.reader import LogReader, begins_as_log
from daq.plugins import plugins
from rig.diagnosis.diagnose_runs import write_report
from rig.diagnosis.document import document, effects_file, provenance, write_json
from rig.diagnosis.report import arguments, causes, gap_map, own_rig, verdict
from rig.diagnosis.report.case import Case, RunFacts
from rig.diagnosis.report.verdict import LEFT_OPEN
from rig.ensembles import Simulated, cores, worker_processes
from rig.files.out_folder import check_out
from rig.pages.content import Section
from rig.session.pace import Work
from rig.session.progress import Screen
from sim_twin.diagnosis.findings import Findings
from sim_twin.own_rig import Check, Draw, Effort, Observed, OwnRig, Subject, Widening, check, diagnose, pooled

Blocks = NDArray[np.float32]
Columns = Mapping[str, NDArray[np.floating]]
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
    causes says how many.
    """

    subject: str
    runs: Sequence[Path]
    seed: int = 0
    seeds: int = 3
    rigs: int | None = None


def diagnose_own(request: OwnRequest, out: Path, screen: Screen) -> tuple[Findings, dict[str, Path]]:
    """Check a subject, then diagnose what was measured; returns what was found, and the files that say so.

    Raises RattleError for a subject or files that cannot be used.
    """
    began = time.monotonic()
    check_out(out)
    subject, measured = _read(request)
    rigs = request.rigs or max(_LEAST, _EACH * len(subject.causes))
    effort, name = Effort(rigs, _JUDGING), Path(request.subject).stem
    seeds = range(request.seed, request.seed + request.seeds)
    try:
        with ExitStack() as stack, threadpool_limits(1, user_api="blas"):
            # what is wrong at once is told before any worker has started
            workers = cache(lambda: stack.enter_context(worker_processes(cores())))

            def look(draws: Sequence[Draw]) -> list[Observed]:
                return Simulated(subject, workers().executor, began + _NO_DEADLINE, lambda _: None)(draws)

            with screen.busy("checking the subject", Work(f"check {name} on {cores()}", rigs)):
                checked = check(subject, measured, look, request.seed, rigs)
            _tell(request.subject, checked, screen)
            total = len(seeds) * effort.most
            with screen.bar("simulating", total, "rigs", Work(f"{name} on {cores()}", total)) as bar:
                shown = Simulated(subject, workers().executor, began + _NO_DEADLINE, bar)
                each = [diagnose(subject, measured, effort, shown, seed) for seed in seeds]
            widths = {}
            others = (
                {times: subject.wider(times) for times in _WIDTHS} if isinstance(subject, Widening) else {}
            )
            for times, other in others.items():
                told = f"with healthy rigs {times:g} times as wide"
                with screen.bar(told, effort.most, "rigs") as bar:
                    shown = Simulated(other, workers().executor, began + _NO_DEADLINE, bar)
                    widths[times] = diagnose(other, measured, effort, shown, request.seed)
    except RattleError:
        raise
    except Exception as error:  # whatever a simulator raises
        raise _failed(request.subject, error) from error
    findings = pooled(each)
    remarks = [*checked.remarks, *_seeds(each, findings), *_widths(widths, findings), *_left(findings)]
    for remark in remarks[len(checked.remarks) :]:
        screen.warn(remark)
    alike = [f"with {len(each)} seeds"] if len(each) > 1 and not _seeds(each, findings) else []
    alike += ["with narrower and wider healthy rigs"] if widths and not _widths(widths, findings) else []
    if alike:
        screen.say(f"the same {' and '.join(alike)}")
    asked = {"subject": request.subject, "seeds": len(seeds), "rigs": rigs}
    said = {**provenance(request.seed), **asked}
    content = document(findings, {}, request.runs, said, None, None, time.monotonic() - began, remarks)
    content["by_seed"] = [
        {"seed": seed, "verdict": one.verdict, "selected": list(one.names), **_shares(one)}
        for seed, one in zip(seeds, each, strict=True)
    ]
    content["by_width"] = [
        {"width": times, "verdict": one.verdict, "selected": list(one.names), **_shares(one)}
        for times, one in widths.items()
    ]
    content["found_again"] = [
        {"cause": cause, "found": right, "of": of, "else": wrong or None}
        for cause, (right, of, wrong) in checked.found_again.items()
    ]
    out.mkdir(parents=True, exist_ok=True)
    names = {"diagnosis": "diagnosis.json", "effects": "effects.json", "report": "report.html"}
    files = {what: out / name for what, name in names.items()}
    parts = sorted({cell.run for cell in subject.layout.cells})
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


def _shares(one: Any) -> dict[str, dict[str, float]]:
    return {"probability": {"none": one.none, "effect": one.effect, "unknown": one.unknown}}


def _read(request: OwnRequest) -> tuple[Subject, Blocks]:
    own = own_rig_of(request.subject)
    tables = [columns_of(path) for path in request.runs]
    try:
        return own.measured(tables)
    except Exception as error:  # a user's code may raise anything
        raise _failed(request.subject, error) from error


def _failed(name: str, error: BaseException) -> RattleError:
    """In words, with the last place in the user's own file where there is one."""
    frames = [
        each
        for each in traceback.extract_tb(error.__traceback__)
        if Path(each.filename).name == Path(name).name
    ]
    place = f", line {frames[-1].lineno}" if frames else ""
    return RattleError(f"{name}{place}: {type(error).__name__}: {error}")


def own_rig_of(name: str) -> OwnRig:
    """What a Python file has as its `SUBJECT`, or an installed package offers under that name.

    Raises RattleError, in words, where there is none.
    """
    path = Path(name)
    if path.suffix != ".py":
        offered = plugins("rattle.subjects", object)
        found = offered.found.get(name)
        if found is None:
            known = ", ".join(offered.found) or "none"
            raise RattleError(f"{name} is no Python file, and of installed subjects there is {known}")
    else:
        found = _loaded(path)
    if not isinstance(found, OwnRig):
        raise RattleError(f"{name} has neither a SUBJECT nor a function `measured`; see docs/own_rig.md")
    return found


def _loaded(path: Path) -> object:
    """The file as a module of its name, so that other processes find what is in it."""
    if not path.is_file():
        raise RattleError(f"{path}: no such file")
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        module = import_module(path.stem)
    except (Exception, SystemExit) as error:  # it may do anything as it is imported
        raise _failed(str(path), error) from error
    if Path(str(module.__file__)).resolve() != path.resolve():
        raise RattleError(f"{path}: another module has its name ({module.__file__}); give it another one")
    return getattr(module, "SUBJECT", module)


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

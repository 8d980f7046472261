"""Rigs of the truth engines whose values lie far off: drawn, recorded, identified, diagnosed, judged."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.blind.cases import NONE, answer_of
from benchmarks.blind.catalogue import BEAM, CATALOGUE, CRANK, SPATIAL, EffectEntry
from benchmarks.blind.command import rattle
from benchmarks.blind.crank.rig import CRANK_X, CRANK_Y, PISTON_Y
from benchmarks.blind.engines import engine_of
from benchmarks.blind.logs import write_log
from benchmarks.blind.operating_points import CRANK_RPM, PointOfRun, longest, points, scenario_text
from benchmarks.kept_results import TRUTHS, Results, made_by
from rig.diagnosis.identify import STILL_MOVED, wide_of
from rig.ensembles import cores
from rig.files.model_file import load_model
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from rig.twin.scenario_twin import twin_of

FREE: Final = {
    BEAM: (
        "beam_modulus", "beam_density", "beam_length", "beam_width", "beam_thickness", "contact_stiffness",
        "contact_damping", "modal_damping", "yoke_frequency", "clearance",
    ),
    CRANK: (
        "crank_length", "crank_mass", "rod_length", "rod_mass", "rod_inertia", "piston_mass", "clearance_1",
        "clearance_2", "restitution", "friction", *(
            f"frame_{where}_{what}" for where in ("crank_y", "crank_x", "piston_y")
            for what in ("frequency", "damping")
        ),
    ),
    SPATIAL: (
        "crank_radius", "rod_modulus", "rod_density", "rod_length", "rod_diameter", "slider_mass",
        "socket_clearance", "guide_clearance", "socket_stiffness", "guide_stiffness", "socket_damping",
        "guide_damping", "friction", "modal_damping",
    ),
}  # fmt: skip
_SEEDS: Final = {rig: number for number, rig in enumerate(FREE)}
RUNS, BUDGET_S, LONGEST_S = 2, 1200.0, 3600.0
LEARN, OF_ONE_LAB, WIDER = 5, 5, 2.0
STRIKES_FROM: Final = 170 * np.pi / 30
"""rad/s. A spatial crank begins to strike at some 150 rpm, by its clearances (decision 5)."""
FARTHEST: Final = 3.0
"""Of ten healthy deviations: farther no rig lies."""
FARTHEST_DAMPED: Final = 0.75
"""The same of a contact's damping, 4.5 times either way: what the truth engines' steps follow with an effect
of up to twenty times more in it."""
SET_VALUES: Final = {
    (CRANK, "restitution"): ("value", "restitution"),
    (CRANK, "joint_friction"): ("coefficient", "friction"),
    (SPATIAL, "guide_friction"): ("coefficient", "friction"),
}
"""Effects that set what a rig has of its own, in place of a ratio: their parameter and its key of [model]."""
APART: Final = {"restitution": 0.2, "friction": 0.03}
"""Ten healthy deviations, by which they lie off that at least."""
RIGS_A_KIND: Final = 20
"""In each step."""
_ENDED: Final = (0, 1, 2)
"""Exit codes of a command that did what was asked, or said why not."""
_DAMPED: Final = ("contact_damping", "socket_damping", "guide_damping")
_FRAMES: Final = {"crank_y": CRANK_Y, "crank_x": CRANK_X, "piston_y": PISTON_Y}


@dataclass(frozen=True, slots=True)
class Case:
    """A rig of its kind, by number and seed: its files lie `within`, what came of it in `results`."""

    rig: str
    number: int
    seed: int
    within: Path
    results: Mapping[str, Results]

    @property
    def name(self) -> str:
        return f"{self.rig}_{self.number:02d}_seed_{self.seed}"

    @property
    def folder(self) -> Path:
        return self.within / self.name

    def rng(self, *more: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, self.number, _SEEDS[self.rig], *more])

    def found(self, step: str) -> dict[str, Any] | None:
        return self.results[step].found(f"{self.name}_{step}")

    def keep(self, step: str, found: Mapping[str, Any]) -> None:
        self.results[step].keep(f"{self.name}_{step}", {"rig": self.rig, **found})


def beam_of(values: Mapping[str, float], rig: Any) -> Any:
    """The truth's beam with the values of keys of [model]."""
    beam, stop = rig.beam, rig.upper
    names = {"modulus": "beam_modulus", "density": "beam_density", "length": "beam_length",
             "width": "beam_width", "thickness": "beam_thickness"}  # fmt: skip
    ratios = np.array(beam.damping) / np.mean(beam.damping) * values["modal_damping"]
    beam = replace(beam, **{name: values[key] for name, key in names.items()}, damping=tuple(ratios.tolist()))
    stop = replace(
        stop,
        gap=values["clearance"],
        stiffness=values["contact_stiffness"],
        damping=values["contact_damping"],
    )
    return replace(rig, beam=beam, upper=stop, lower=stop, head=values["yoke_frequency"])


def crank_of(values: Mapping[str, float], crank: Any) -> Any:
    """The truth's crank with the values of keys of [model]; the rod's inertia goes with mass and length."""
    plain = ("crank_length", "crank_mass", "rod_length", "rod_mass", "piston_mass", "restitution", "friction")
    frames = {
        channel: replace(
            crank.frames[channel],
            frequency=values[f"frame_{where}_frequency"],
            damping_ratio=values[f"frame_{where}_damping"],
        )
        for where, channel in _FRAMES.items()
    }
    gaps = (values["clearance_1"], values["clearance_2"])
    return replace(crank, **{key: values[key] for key in plain}, clearances=gaps, frames=frames)


def spatial_of(values: Mapping[str, float], rig: Any) -> Any:
    """The truth's spatial crank with the values of keys of [model]."""
    rod, joints = rig.rod, dict[str, Any]()
    ratios = np.array(rod.damping) / np.mean(rod.damping) * values["modal_damping"]
    sizes = {name: values[f"rod_{name}"] for name in ("modulus", "density", "length", "diameter")}
    mass = values["slider_mass"]
    first, second, third = (mass / rig.slider.mass * moment for moment in rig.slider.inertia)
    for name in ("socket", "guide"):
        given = {what: values[f"{name}_{what}"] for what in ("stiffness", "damping")}
        joints |= {
            name: replace(getattr(rig, name), **given),
            f"{name}_clearance": values[f"{name}_clearance"],
        }
    return replace(
        rig,
        crank_radius=values["crank_radius"],
        rod=replace(rod, damping=tuple(ratios.tolist()), **sizes),
        slider=replace(rig.slider, mass=mass, inertia=(first, second, third)),
        friction=replace(rig.friction, coefficient=values["friction"]),
        **joints,
    )


BUILT: Final[Mapping[str, Callable[[Mapping[str, float], Any], Any]]] = {
    BEAM: beam_of,
    CRANK: crank_of,
    SPATIAL: spatial_of,
}


def points_of(rig: str, runs: int, rng: np.random.Generator) -> tuple[PointOfRun, ...]:
    """Settings with the gaps of the first; spatial cranks turn fast enough to strike, or would be refused."""
    first, *others = points(rig, runs, rng)
    if rig == SPATIAL:
        low, high = (each * np.pi / 30 for each in CRANK_RPM)
        share = (high - STRIKES_FROM) / (high - low)
        for each in (first, *others):
            each["speed"] = STRIKES_FROM + share * (float(each["speed"]) - low)
    gaps = {key: value for key, value in first.items() if "clearance" in key}
    return (first, *({**each, **gaps} for each in others))


def recorded_runs(
    folder: Path,
    rig: str,
    points: Sequence[PointOfRun],
    seed: int,
    built: Callable[[Any], Any] = lambda rig: rig,
    effects: Sequence[EffectEntry] = (),
    wider: float = 1.0,
    first: int = 0,
) -> list[Path]:
    """Logs of runs of one rig by the truth's engine, its `first` and on; what is recorded already stays."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"run{number + 1}.mcap" for number in range(len(points))]
    engine: Any = engine_of(rig)
    for number, (path, point) in enumerate(zip(paths, points, strict=True)):
        if path.exists():
            continue
        recording = engine.record(point, effects, seed, first + number, built=built, wider=wider)
        part = path.with_suffix(".part")
        part.unlink(missing_ok=True)
        write_log(part, recording, scenario_text(f"rig {seed}, run {number + 1}", point), path.stem, number)
        part.rename(path)
    return paths


def drawn_values(rig: str, point: PointOfRun, rng: np.random.Generator) -> dict[str, float]:
    """Values of the free keys, normal with ten healthy deviations about what the scenario says."""
    scenario, kind = parse_scenario(scenario_text("rig", point)), RIGS[rig]
    twin, values = twin_of(scenario), dict[str, float]()
    for key in FREE[rig]:
        farthest = FARTHEST_DAMPED if key in _DAMPED else FARTHEST
        z = np.clip(rng.standard_normal(), -farthest, farthest)
        values[key] = float(wide_of(kind, key, scenario.model, twin).value(np.array(z)))
    if rig == CRANK:  # as the truth has it
        first, length = scenario.model.get("rod_mass", 1.6403), 0.564
        values["rod_inertia"] = 9.45e-2 * values["rod_mass"] / first * (values["rod_length"] / length) ** 2
    return values


class Unanswered(RuntimeError):
    """A command that ended by a signal or an error of the program, or went on for too long."""


def said(file: Path, *arguments: object) -> tuple[int, str, float]:
    """Exit code of a command as a user calls it, what it said, which `file` keeps, and its wall time in s."""
    spent = rattle([str(each) for each in arguments], file, LONGEST_S)
    told = file.read_text()
    if spent.exit_code not in _ENDED or "Traceback" in told:
        raise Unanswered(f"{file}: exit code {spent.exit_code}, {told[-2000:]}")
    return spent.exit_code, told, spent.wall_s


def diagnosed(folder: Path, paths: Sequence[Path], *more: object) -> dict[str, Any]:
    """What `rattle diagnose` says of some runs: exit code, first answer, all of them, what it cost."""
    out = folder / "answer"
    code, told, wall_s = said(folder / "diagnose.txt", "diagnose", *paths, *more, "--out", out)
    if code:
        return {"code": code, "first": None, "refused": told[-2000:]}
    found = json.loads((out / "diagnosis.json").read_text())
    ranking = answer_of(found).ranking()
    seen = {key: found[key] for key in ("cost", "remarks") if key in found}
    return {"code": 0, "first": ranking[0][0], "ranking": ranking, "wall_s": wall_s, **seen}


def identify_rig(case: Case) -> None:
    """Draw, record and identify one rig."""
    folder, rig, rng = case.folder, case.rig, case.rng()
    points = points_of(rig, RUNS, rng)
    values = drawn_values(rig, points[0], rng)
    built, seed = partial(BUILT[rig], values), 1000 * case.seed + case.number
    paths = recorded_runs(folder, rig, points, seed, built)
    judged = recorded_runs(folder / "judged", rig, points, seed, built, first=RUNS)
    search, model = folder / "search", folder / "search" / "model.toml"
    done = search / "done.json"
    if not done.exists():
        shutil.rmtree(search, ignore_errors=True)  # of a call that was ended: its time would not count
        search.mkdir()
        asked = ("identify", *paths, "--free", ",".join(FREE[rig]), "-o", model, "--budget", BUDGET_S)
        code, told, wall_s = said(search / "identify.txt", *asked)
        spent = {"code": code, "wall_s": wall_s, "cores": cores()}
        done.write_text(json.dumps(spent | ({"refused": told[-2000:]} if code else {})))
    found: dict[str, Any] = {"truth": values, **json.loads(done.read_text())}
    if found["code"] == 0:
        known = load_model(model, rig)
        found |= {"model": known.text, "converged": STILL_MOVED not in known.text}
        found["identified"] = {
            key: {"value": known.model[key], "low": each.low, "high": each.high, "told": each.told}
            for key, each in known.identified.items()
        }
        for name, more in (("gap", ("--model", model)), ("gap_before", ())):
            gap, told, _ = said(folder / f"{name}.txt", "gap", *judged, *more, "--json")
            answer, _ = json.JSONDecoder().raw_decode(told[told.index("{") :]) if gap == 0 else ({}, 0)
            found[name] = answer.get("before")
    case.keep("rigs", found)
    print(f"{case.name}: exit code {found['code']}, {found['wall_s']:.0f} s", flush=True)
    shutil.rmtree(folder)


def diagnose_effect(case: Case) -> None:
    """Hide one effect in a rig that was identified, and the same in a nominal one: who names it?"""
    folder, rig, of_rig = case.folder, case.rig, case.found("rigs")
    assert of_rig is not None
    folder.mkdir(parents=True, exist_ok=True)
    causes = list(CATALOGUE[rig].values())
    draws, cause = case.rng(1), causes[case.number % len(causes)]
    entry = cause.draw(draws)
    while not lies_off(entry, rig, of_rig["truth"]):
        entry = cause.draw(draws)
    points = points_of(rig, RUNS, case.rng())
    looks: dict[str, tuple[Callable[[Any], Any], tuple[object, ...]]] = {"nominal": (_as_it_is, ())}
    found: dict[str, Any] = {"effect": entry}
    if of_rig["code"] == 0:
        model = folder / "model.toml"
        model.write_text(of_rig["model"])
        looks["identified"] = (partial(BUILT[rig], of_rig["truth"]), ("--model", model))
    else:
        found["identified"] = {"code": of_rig["code"], "first": None, "right": False}
    for name, (built, more) in looks.items():
        logs, seed = folder / name, 1000 * case.seed + case.number
        paths = recorded_runs(logs, rig, points, seed, built, (entry,), first=2 * RUNS)
        answer = diagnosed(logs, paths, *more)
        found[name] = {**answer, "right": answer["first"] == entry["name"]}
    case.keep("effects", found)
    firsts = [found[each]["first"] for each in ("identified", "nominal")]
    print(f"{case.name}: {entry['name']}, {firsts}", flush=True)
    shutil.rmtree(folder)


def lies_off(effect: EffectEntry, rig: str, own: Mapping[str, float]) -> bool:
    """Whether an effect that sets a value of [model] sets another one than the rig's `own`."""
    given: Any = effect["parameters"]
    parameter, key = SET_VALUES.get((rig, str(effect["name"])), ("", ""))
    return not key or bool(abs(given[parameter] - own[key]) >= APART[key])


def _as_it_is(rig: Any) -> Any:
    return rig


def judge_healthy(case: Case) -> None:
    """Diagnose a rig of tolerances twice as wide as usual, and by what five of its lab tell of them."""
    lab = case.number // OF_ONE_LAB
    (point,) = points_of(case.rig, 1, np.random.default_rng([case.seed, _SEEDS[case.rig], 2, lab]))
    point, folder = longest(point), case.folder / "healthy"
    model = _learnt(case, lab, point)
    paths = recorded_runs(folder, case.rig, [point], 2_000_000 + 1000 * case.seed + case.number, wider=WIDER)
    found = dict[str, Any]()
    looks: dict[str, tuple[object, ...]] = {"usual": ()}
    looks |= {} if model is None else {"own": ("--model", model)}
    for name, more in looks.items():
        found[f"{name} answer"] = answer = diagnosed(folder, paths, *more)
        found[name] = answer["first"] != NONE
    found.setdefault("own", True)  # a lab that was refused has no tolerances of its own
    case.keep("healthy", found)
    print(f"{case.name}: called off as shipped {found['usual']}, by its lab's {found['own']}", flush=True)
    shutil.rmtree(case.folder)


def _learnt(case: Case, lab: int, point: PointOfRun) -> Path | None:
    """The model of what five rigs of a lab tell of their tolerances; None where that was refused."""
    name = f"{case.rig}_seed_{case.seed}_lab_{lab}"
    results = case.results["healthy"]
    folder, kept = case.within / name, results.found(name)
    folder.mkdir(parents=True, exist_ok=True)
    model = folder / "lab.toml"
    if kept is None:
        first = 1_000_000 + 1000 * case.seed + LEARN * lab
        runs = [
            path
            for seed in range(first, first + LEARN)
            for path in recorded_runs(folder / f"rig{seed}", case.rig, [point], seed, wider=WIDER)
        ]
        model.unlink(missing_ok=True)
        code, told, _ = said(folder / "calibrate.txt", "calibrate", "--spread", *runs, "-o", model)
        print(told, flush=True)
        kept = {"model": None, "refused": told[-2000:]} if code else {"model": model.read_text()}
        results.keep(name, kept)
        for seed in range(first, first + LEARN):
            shutil.rmtree(folder / f"rig{seed}")
    if kept["model"] is None:
        return None
    model.write_text(kept["model"])
    return model


STEPS: Final = {"rigs": identify_rig, "effects": diagnose_effect, "healthy": judge_healthy}
_BY_NAME: Final = ("rig.rigs", "sim_twin.rigs", "rig.files", "drivers.ni_daq", *TRUTHS)
_HANGS_ON: Final = {
    "rigs": ("rig.commands.identify", "rig.diagnosis.health", *_BY_NAME),
    "effects": ("rig.commands.identify", "rig.commands.diagnose", *_BY_NAME),
    "healthy": ("rig.commands.diagnose", *_BY_NAME),
}
"""Of each step the modules that its results hang on, with what they import; some are imported by name."""
_BESIDE: Final = (
    "benchmarks/identified/rigs.py",
    "benchmarks/blind/cases.py",
    "benchmarks/blind/command.py",
    "rig/diagnosis/diagnose_runs.py",  # `rattle gap` is its own part of these two
    "sim_twin/diagnosis/judging.py",
    *(f"rig/rigs/{rig}.toml" for rig in FREE),
)


def results_in(folder: Path) -> dict[str, Results]:
    """Those of each step that this program made."""
    return {step: Results(folder, made_by(_HANGS_ON[step], _BESIDE)) for step in STEPS}

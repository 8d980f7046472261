"""Whether `rattle identify` finds the values of rigs that lie far from what their scenarios say.

Rigs are those of the blind check's truth engines, which share nothing with the twin. `rigs` draws values ten
times as far off as healthy rigs lie, records two runs of each and has `rattle identify` look for them, by its
own file and by `rattle gap` on further runs; `effects` hides one effect in each of the rigs that were
identified, and in a nominal one, and has `rattle diagnose` name it: in one that was refused it is missed;
`healthy` records healthy rigs of tolerances twice as wide and counts those that lie outside of the healthy
band, with and without what `rattle calibrate --spread` learnt of five others.

Every rig's result is a file in benchmarks/measured/identified, with the commit and a digest of what of the
program its step hangs on, and of the truth engines: those of one digest add up, over seeds too, what is there
is not done again, and a search that is stopped or runs out of time goes on where it was, by what DIR holds.
`score` prints what they come to, and how many of other digests it leaves out. The gap afterwards is at most
its bar where that of every rig is that was not refused, and one that could not be measured is not; no rig may
be refused, and none may take longer than its bar says. Returns 1 where a figure misses its bar, or a kind of
rig has less than twenty results of a step.

Usage: python -m benchmarks.identified {rigs,effects,healthy,score} DIR [--more N] [--only RIG] [--count N]
    [--seed 1] [--budget SECONDS] [--results FOLDER]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.blind.cases import answer_of
from benchmarks.blind.catalogue import BEAM, CATALOGUE, CRANK, SPATIAL, EffectEntry
from benchmarks.blind.crank.rig import CRANK_X, CRANK_Y, PISTON_Y
from benchmarks.blind.engines import engine_of
from benchmarks.blind.intervals import share_of
from benchmarks.blind.logs import write_log
from benchmarks.blind.operating_points import CRANK_RPM, PointOfRun, points, scenario_text
from benchmarks.kept_results import TRUTHS, Results, made_by
from rig.diagnosis.health import band_of
from rig.diagnosis.identify import STILL_MOVED, wide_of
from rig.diagnosis.recordings import recorded_alone
from rig.ensembles import cores
from rig.files.model_file import load_model
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from rig.session.progress import Screen, Terminal
from rig.twin.logged import campaign_with_model
from rig.twin.scenario_twin import twin_of

RESULTS = Path(__file__).with_name("measured") / "identified"
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
RUNS, BUDGET_S = 2, {"rigs": 3600.0, "effects": 60.0, "healthy": 600.0}
LEARN, WIDER, HEALTHY, LONGEST_S = 5, 2.0, 48, 20.0
STRIKES_FROM: Final = 170 * np.pi / 30
"""rad/s. A spatial crank begins to strike at some 150 rpm, by its clearances (decision 5)."""
FARTHEST: Final = 3.0
"""Of ten healthy deviations: farther no rig lies."""
HOLD, GAP, WALL_S, CORES, POINTS, CALLED_OFF = (0.88, 0.99), 1.15, 300.0, 2, 0.05, 3 / 60
"""Bars: share of values held, gap afterwards, seconds of wall time on so many cores, share of first answers
that fewer are right, share of healthy rigs called off."""
RIGS_A_KIND: Final = 20
"""In each step."""
_OUT_OF_TIME: Final = "time ran out"
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
        slider=replace(rig.slider, mass=values["slider_mass"]),
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
        z = np.clip(rng.standard_normal(), -FARTHEST, FARTHEST)
        values[key] = float(wide_of(kind, key, scenario.model, twin).value(np.array(z)))
    if rig == CRANK:  # as the truth has it
        first, length = scenario.model.get("rod_mass", 1.6403), 0.564
        values["rod_inertia"] = 9.45e-2 * values["rod_mass"] / first * (values["rod_length"] / length) ** 2
    return values


def rattle(said: Path, *arguments: object) -> tuple[int, str]:
    """Exit code and what a command said, as a user calls it; the file `said` holds it as it comes."""
    command = [sys.executable, "-u", "-m", "rig.start", *map(str, arguments)]
    with said.open("w") as file:
        done = subprocess.run(command, stdout=file, stderr=subprocess.STDOUT, check=False)  # noqa: S603 - our own
    return done.returncode, said.read_text()


def identify_rig(case: Case, budget_s: float) -> None:
    """Draw, record and identify one rig."""
    folder, rig, rng = case.folder, case.rig, case.rng()
    points = points_of(rig, RUNS, rng)
    values = drawn_values(rig, points[0], rng)
    built, seed = partial(BUILT[rig], values), 1000 * case.seed + case.number
    paths = recorded_runs(folder, rig, points, seed, built)
    model, free = folder / "model.toml", ",".join(FREE[rig])
    for left in folder.glob("model*.toml"):  # by a call that was ended before its result was kept
        left.unlink()
    spent, began = folder / "wall_s.txt", time.monotonic()
    before_s = float(spent.read_text()) if spent.exists() else 0.0
    try:
        code, told = rattle(
            folder / "identify.txt", "identify", *paths, "--free", free, "-o", model, "--budget", budget_s
        )
    finally:
        wall_s = before_s + time.monotonic() - began
        spent.write_text(str(wall_s))
    if code and _OUT_OF_TIME in told:
        print(f"{case.name}: not done after {wall_s:.0f} s; it goes on there", flush=True)
        return
    found: dict[str, Any] = {"truth": values, "code": code, "wall_s": wall_s, "cores": cores()}
    if code == 0:
        known = load_model(model, rig)
        found |= {"model": known.text, "converged": STILL_MOVED not in known.text}
        found["identified"] = {
            key: {"value": known.model[key], "low": each.low, "high": each.high, "told": each.told}
            for key, each in known.identified.items()
        }
        judged = recorded_runs(folder / "judged", rig, points, seed, built, first=RUNS)
        for name, more in (("gap", ("--model", model)), ("gap_before", ())):
            code, told = rattle(folder / f"{name}.txt", "gap", *judged, *more, "--json")
            found[name] = json.loads(told[told.index("{") :])["before"] if code == 0 else None
    case.keep("rigs", found)
    print(f"{case.name}: exit code {found['code']}, {wall_s:.0f} s", flush=True)


def diagnose_effect(case: Case, budget_s: float) -> None:
    """Hide one effect in a rig that was identified, and the same in a nominal one: who names it?"""
    folder, rig, of_rig = case.folder, case.rig, case.found("rigs")
    assert of_rig is not None
    folder.mkdir(parents=True, exist_ok=True)
    causes = list(CATALOGUE[rig].values())
    entry = causes[case.number % len(causes)].draw(case.rng(1))
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
        out = logs / "answer"
        code, _ = rattle(logs / "diagnose.txt", "diagnose", *paths, *more, "--out", out, "--budget", budget_s)
        first = None
        if code == 0:
            answer = answer_of(json.loads((out / "diagnosis.json").read_text()))
            first = answer.ranking()[0][0]
        found[name] = {"code": code, "first": first, "right": first == entry["name"]}
    case.keep("effects", found)
    print(f"{case.name}: {entry['name']}, {[found[each]['first'] for each in ('identified', 'nominal')]}")


def _as_it_is(rig: Any) -> Any:
    return rig


def judge_healthy(case: Case, budget_s: float) -> None:
    """Judge a rig of tolerances twice as wide as usual, and by what five others tell of them."""
    rig, point = case.rig, points_of(case.rig, 1, np.random.default_rng([case.seed, _SEEDS[case.rig], 2]))
    known = load_model(_learnt(case, point, budget_s), rig)
    seed = 8000 * case.seed + case.number
    (path,) = recorded_runs(case.folder / "healthy", rig, point, seed, wider=WIDER)
    plain, screen = recorded_alone(path, LONGEST_S), Screen(Terminal(stderr=True))
    campaign = campaign_with_model(plain.campaign, known, [plain.scenario], print)
    found = dict[str, bool]()
    for name, run, text in (("usual", plain, ""), ("own", replace(plain, campaign=campaign), known.text)):
        band = band_of(run, text, HEALTHY, screen)
        if band is None:
            raise SystemExit("no healthy band")
        found[name] = any(place.beyond for place in band.places(run.measured))
    case.keep("healthy", found)
    print(f"{case.name}: beyond the usual band {found['usual']}, beyond the lab's {found['own']}", flush=True)


def _learnt(case: Case, point: Sequence[PointOfRun], budget_s: float) -> Path:
    """The model of what five rigs tell of their tolerances; it is kept with the results."""
    name = f"{case.rig}_seed_{case.seed}_lab"
    results = case.results["healthy"]
    folder, kept = case.within / name, results.found(name)
    folder.mkdir(parents=True, exist_ok=True)
    lab = folder / "lab.toml"
    if kept is None:
        runs = [
            path
            for number in range(LEARN)
            for path in recorded_runs(
                folder / f"rig{number}", case.rig, point, 7000 * case.seed + number, wider=WIDER
            )
        ]
        lab.unlink(missing_ok=True)
        code, told = rattle(
            folder / "calibrate.txt", "calibrate", "--spread", *runs, "-o", lab, "--budget", budget_s
        )
        if code:
            raise SystemExit(told)
        print(told, flush=True)
        kept = {"model": lab.read_text()}
        results.keep(name, kept)
    lab.write_text(kept["model"])
    return lab


STEPS: Final = {"rigs": identify_rig, "effects": diagnose_effect, "healthy": judge_healthy}
_BY_NAME: Final = ("rig.rigs", "sim_twin.rigs", "rig.files", "drivers.ni_daq", *TRUTHS)
_HANGS_ON: Final = {
    "rigs": ("rig.commands.identify", "rig.diagnosis.health", *_BY_NAME),
    "effects": ("rig.commands.identify", "rig.commands.diagnose", *_BY_NAME),
    "healthy": ("rig.commands.diagnose", *_BY_NAME),
}
"""Of each step the modules that its results hang on, with what they import; some are imported by name."""
_BESIDE: Final = (
    "benchmarks/identified.py",
    "rig/diagnosis/diagnose_runs.py",  # `rattle gap` is its own part of it
    *(f"rig/rigs/{rig}.toml" for rig in FREE),
)


def results_in(folder: Path) -> dict[str, Results]:
    """Those of each step that this program made."""
    return {step: Results(folder, made_by(_HANGS_ON[step], _BESIDE)) for step in STEPS}


def score(results: Mapping[str, Results]) -> bool:
    """Print what the rigs' results come to; whether none is missing and every figure meets its bar."""
    met, called_off = True, list[bool]()
    for step, kept in results.items():
        print(f"{step}: program {kept.digest}; results of others, left out: {kept.others(f'*_{step}')}")
    for rig in FREE:
        found = {step: kept.every(f"{rig}_*_{step}") for step, kept in results.items()}
        print(f"{rig}: {', '.join(f'{step} {len(each)} of {RIGS_A_KIND}' for step, each in found.items())}")
        met &= all(len(each) >= RIGS_A_KIND for each in found.values())
        met &= _score_values(found["rigs"])
        met &= _score_effects(found["effects"])
        for name, words in (("usual", "as shipped"), ("own", "as learnt of five")):
            beyond = [each[name] for each in found["healthy"]]
            print(f"  healthy rigs twice as wide, called off by tolerances {words}: {share_of(beyond)}")
        called_off += [each["own"] for each in found["healthy"]]
    print(f"healthy rigs of all kinds, called off by tolerances as learnt of five: {share_of(called_off)}")
    return met and sum(called_off) <= CALLED_OFF * len(called_off)


def _score_values(results: Sequence[Mapping[str, Any]]) -> bool:
    """A rig that was refused holds no value and closes no gap."""
    done = [each for each in results if each["code"] == 0]
    if not done:
        return False
    still = sum(each["converged"] for each in done)
    print(f"  identified {len(done)}, refused {len(results) - len(done)}; converged {still}")
    held = [
        interval["low"] <= each["truth"][key] <= interval["high"]
        for each in done
        for key, interval in each["identified"].items()
        if interval["told"]
    ]
    share = float(np.mean(held)) if held else 0.0
    print(f"  values told that their 95 % intervals hold: {share_of(held)}")
    after, before = (
        [np.inf if each[name] is None else each[name] for each in done] for name in ("gap", "gap_before")
    )
    within = [gap <= GAP for gap in after]
    print(f"  gap afterwards within {GAP}: {share_of(within)}")
    middle = f"{np.median(before):.2f} before, {np.median(after):.2f} after"
    print(f"  gap, medians: {middle}; largest {max(after):.2f}")
    wall_s, most = [float(each["wall_s"]) for each in results], max(int(each["cores"]) for each in results)
    print(f"  seconds on {most} cores: median {np.median(wall_s):.0f}, largest {max(wall_s):.0f}")
    on_time = max(wall_s) <= WALL_S and most <= CORES
    return len(done) == len(results) and HOLD[0] <= share <= HOLD[1] and all(within) and on_time


def _score_effects(results: Sequence[Mapping[str, Any]]) -> bool:
    right: dict[str, list[bool]] = {
        name: [each[name]["right"] for each in results] for name in ("identified", "nominal")
    }
    for name, each in right.items():
        print(f"  single effects on {name} rigs, first answer right: {share_of(each)}")
    return sum(right["identified"]) >= sum(right["nominal"]) - POINTS * len(results)


def main(arguments: list[str] | None = None) -> int:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identified", description=__doc__)
    parser.add_argument("step", choices=(*STEPS, "score"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--count", type=int, default=RIGS_A_KIND, help="rigs a kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=FREE)
    parser.add_argument("--more", type=int, default=1000, help="do at most so many")
    parser.add_argument("--budget", type=float, help="seconds of each search, diagnosis or calibration")
    asked = parser.parse_args(arguments)
    results = results_in(asked.results)
    if asked.step == "score":
        return 0 if score(results) else 1
    within = asked.folder / results[asked.step].digest
    every = [
        Case(rig, number, asked.seed, within, results)
        for number in range(asked.count)
        for rig in ((asked.only,) if asked.only else FREE)
    ]
    open_ones = [case for case in every if case.found(asked.step) is None]
    if asked.step == "effects":  # in rigs that were looked for
        open_ones = [case for case in open_ones if case.found("rigs") is not None]
    for case in open_ones[: asked.more]:
        STEPS[asked.step](case, asked.budget or BUDGET_S[asked.step])
    return 0 if score(results) else 1


if __name__ == "__main__":
    sys.exit(main())

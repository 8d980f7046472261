"""Whether `rattle identify` finds the values of rigs that lie far from what their scenarios say.

Rigs are those of the blind check's truth engines, which share nothing with the twin. `rigs` draws values ten
times as far off as healthy rigs lie, records two runs of each and has `rattle identify` look for them, by its
own file and by `rattle gap` on further runs; `effects` hides one effect in each of the rigs that were
identified, and in a nominal one, and has `rattle diagnose` name it; `healthy` records healthy rigs of
tolerances twice as wide and counts those that lie outside of the healthy band, with and without what `rattle
calibrate --spread` learnt of five others. Every rig's result is a file in benchmarks/measured/identified,
with the commit that it is of: what is there is not done again, so parts of it add up, and a search that is
stopped or runs out of time goes on where it was, by what DIR holds. `score` prints. Each step returns 1 where
a figure misses its bar.

Usage: python -m benchmarks.identified {rigs,effects,healthy,score} DIR [--more N] [--only RIG] [--count N]
    [--seed 1] [--budget SECONDS] [--results FOLDER]
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections import Counter
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
from benchmarks.blind.intervals import wilson
from benchmarks.blind.logs import write_log
from benchmarks.blind.operating_points import CRANK_RPM, PointOfRun, points, scenario_text
from rig.diagnosis.health import band_of
from rig.diagnosis.identify import wide_of
from rig.diagnosis.recordings import recorded_alone
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
RUNS, BUDGET_S = 2, {"rigs": 3600.0, "effects": 60.0}
LEARN, WIDER, HEALTHY, LONGEST_S = 5, 2.0, 48, 20.0
STRIKES_FROM: Final = 170 * np.pi / 30
"""rad/s. A spatial crank begins to strike at some 150 rpm, by its clearances (decision 5)."""
FARTHEST: Final = 3.0
"""Of ten healthy deviations: farther no rig lies."""
HOLD, GAP, WALL_S, POINTS, CALLED_OFF = (0.88, 0.99), 1.15, 300.0, 0.05, 3 / 60
"""Bars: share of values held, median gap afterwards, seconds of two cores, share of first answers that fewer
are right, share of healthy rigs called off."""
_COUNTS: Final = {"rigs": 20, "effects": 20, "healthy": 30, "score": 0}
_OUT_OF_TIME: Final = "time ran out"
_FRAMES: Final = {"crank_y": CRANK_Y, "crank_x": CRANK_X, "piston_y": PISTON_Y}


@dataclass(frozen=True, slots=True)
class Case:
    """A rig: its logs and what is not yet done lie in `folder`, what came out in files of `results`."""

    folder: Path
    results: Path

    def found(self, step: str) -> dict[str, Any] | None:
        file = self._file(step)
        return json.loads(file.read_text()) if file.exists() else None

    def keep(self, step: str, found: Mapping[str, Any]) -> None:
        self.results.mkdir(parents=True, exist_ok=True)
        self._file(step).write_text(json.dumps({"commit": commit(), **found}, indent=1) + "\n")

    def _file(self, step: str) -> Path:
        return self.results / f"{self.folder.name}_{step}.json"


def commit() -> str:
    """What is measured; with a plus where files of it have been changed since."""

    def git(*ask: str) -> str:
        command = ["git", *ask]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()  # noqa: S603

    changed = git("status", "--porcelain", "--", "rig", "sim_twin", "daq", "drivers")
    return git("rev-parse", "--short=8", "HEAD") + ("+" if changed else "")


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


def _children_s() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def identify_rig(case: Case, rig: str, number: int, seed: int, budget_s: float) -> None:
    """Draw, record and identify one rig."""
    folder = case.folder
    spent = folder / "spent.json"
    rng = np.random.default_rng([seed, number, _SEEDS[rig]])
    points = points_of(rig, RUNS, rng)
    values = drawn_values(rig, points[0], rng)
    built = partial(BUILT[rig], values)
    paths = recorded_runs(folder, rig, points, 1000 * seed + number, built)
    model, began, cpu_s = folder / "model.toml", time.monotonic(), _children_s()
    free = ",".join(FREE[rig])
    code, told = rattle(
        folder / "identify.txt", "identify", *paths, "--free", free, "-o", model, "--budget", budget_s
    )
    before = json.loads(spent.read_text()) if spent.exists() else [0.0, 0.0]
    took = before[0] + time.monotonic() - began, before[1] + _children_s() - cpu_s
    if code and _OUT_OF_TIME in told:
        spent.write_text(json.dumps(took))
        print(f"{folder.name}: not done after {took[0]:.0f} s; it goes on there", flush=True)
        return
    found: dict[str, Any] = {"rig": rig, "truth": values, "code": code}
    found |= {"wall_s": took[0], "cpu_s": took[1]}
    if code == 0:
        known = load_model(model, rig)
        found["model"] = known.text
        found["identified"] = {
            key: {"value": known.model[key], "low": each.low, "high": each.high, "told": each.told}
            for key, each in known.identified.items()
        }
        judged = recorded_runs(folder / "judged", rig, points, 1000 * seed + number, built, first=RUNS)
        for name, more in (("gap", ("--model", model)), ("gap_before", ())):
            code, told = rattle(folder / f"{name}.txt", "gap", *judged, *more, "--json")
            found[name] = json.loads(told[told.index("{") :])["before"] if code == 0 else None
    case.keep("rigs", found)
    print(f"{folder.name}: exit code {found['code']}, {found['wall_s']:.0f} s", flush=True)


def diagnose_effect(case: Case, rig: str, number: int, seed: int, budget_s: float) -> None:
    """Hide one effect in a rig that was identified, and the same in a nominal one: who names it?"""
    folder, of_rig = case.folder, case.found("rigs")
    assert of_rig is not None
    folder.mkdir(parents=True, exist_ok=True)
    truth, model = of_rig["truth"], folder / "model.toml"
    model.write_text(of_rig["model"])
    rng = np.random.default_rng([seed, number, _SEEDS[rig], 1])
    causes = list(CATALOGUE[rig].values())
    entry = causes[number % len(causes)].draw(rng)
    points = points_of(rig, RUNS, np.random.default_rng([seed, number, _SEEDS[rig]]))
    found: dict[str, Any] = {"rig": rig, "effect": entry}
    own: Callable[[Any], Any] = partial(BUILT[rig], truth)
    for name, built, more in (("identified", own, ("--model", model)), ("nominal", _as_it_is, ())):
        logs = folder / name
        paths = recorded_runs(logs, rig, points, 1000 * seed + number, built, (entry,), first=2 * RUNS)
        out = logs / "answer"
        code, _ = rattle(logs / "diagnose.txt", "diagnose", *paths, *more, "--out", out, "--budget", budget_s)
        first = None
        if code == 0:
            answer = answer_of(json.loads((out / "diagnosis.json").read_text()))
            first = answer.ranking()[0][0]
        found[name] = {"code": code, "first": first, "right": first == entry["name"]}
    case.keep("effects", found)
    print(f"{folder.name}: {entry['name']}, {[found[each]['first'] for each in ('identified', 'nominal')]}")


def _as_it_is(rig: Any) -> Any:
    return rig


def judge_healthy(folder: Path, results: Path, rig: str, count: int, seed: int, more: int) -> int:
    """Rigs of tolerances twice as wide: five to learn from, at most `more` that are judged (how many)."""
    point = points_of(rig, 1, np.random.default_rng([seed, _SEEDS[rig], 2]))
    learn = [
        path
        for number in range(LEARN)
        for path in recorded_runs(folder / f"learn{number}", rig, point, 7000 + number, wider=WIDER)
    ]
    lab, screen = folder / "lab.toml", Screen(Terminal(stderr=True))
    if not lab.exists():
        code, told = rattle(folder / "calibrate.txt", "calibrate", "--spread", *learn, "-o", lab)
        if code:
            raise SystemExit(told)
        print(told, flush=True)
    cases = {number: Case(folder / f"{rig}_{number:02d}", results) for number in range(count)}
    open_ones = [number for number, case in cases.items() if case.found("healthy") is None][:more]
    for number in open_ones:
        (path,) = recorded_runs(folder / f"rig{number:02d}", rig, point, 8000 + number, wider=WIDER)
        plain, known = recorded_alone(path, LONGEST_S), load_model(lab, rig)
        campaign = campaign_with_model(plain.campaign, known, [plain.scenario], print)
        found: dict[str, Any] = {"rig": rig}
        for name, run, text in (("usual", plain, ""), ("own", replace(plain, campaign=campaign), known.text)):
            band = band_of(run, text, HEALTHY, screen)
            if band is None:
                raise SystemExit("no healthy band")
            found[name] = any(place.beyond for place in band.places(run.measured))
        cases[number].keep("healthy", found)
        print(
            f"{cases[number].folder.name}: beyond the usual band {found['usual']}, "
            f"beyond the lab's {found['own']}",
            flush=True,
        )
    return len(open_ones)


def score(results: Path) -> bool:
    """Print what the rigs' results come to; whether every figure that there is meets its bar."""
    met, called_off, judged = True, 0, 0
    for rig in FREE:
        met &= _score_values(rig, _results(results, "rigs", rig))
        effects = _results(results, "effects", rig)
        right = {name: sum(each[name]["right"] for each in effects) for name in ("identified", "nominal")}
        for name, count in right.items() if effects else ():
            print(f"  single effects on {name} rigs: first right in {count} of {len(effects)}")
        met &= right["identified"] >= right["nominal"] - POINTS * len(effects)
        healthy = _results(results, "healthy", rig)
        for name, words in (("usual", "as shipped"), ("own", "as learnt of five")) if healthy else ():
            beyond = sum(each[name] for each in healthy)
            print(f"  healthy rigs twice as wide, tolerances {words}: {beyond} of {len(healthy)} called off")
        called_off, judged = called_off + sum(each["own"] for each in healthy), judged + len(healthy)
    return met and called_off <= CALLED_OFF * judged


def _results(folder: Path, step: str, rig: str) -> list[dict[str, Any]]:
    found = [json.loads(file.read_text()) for file in sorted(folder.glob(f"{rig}_*_{step}.json"))]
    if found:
        counts = Counter(each["commit"] for each in found)
        print(f"{rig}, {step}: {', '.join(f'{count} at {at}' for at, count in counts.items())}")
    return found


def _score_values(rig: str, results: Sequence[Mapping[str, Any]]) -> bool:
    """A rig that was refused holds no value and closes no gap."""
    done = [each for each in results if each["code"] == 0]
    print(f"{rig}: {len(results)} rigs, {len(done)} identified")
    met = len(done) == len(results)
    held = [
        interval["low"] <= each["truth"][key] <= interval["high"]
        for each in done
        for key, interval in each["identified"].items()
        if interval["told"]
    ]
    if held:
        share, (low, high) = np.mean(held), wilson(sum(held), len(held))
        print(f"  95 % intervals hold {share:.3f} ({low:.2f} to {high:.2f}) of {len(held)} values told")
        met &= HOLD[0] <= share <= HOLD[1]
    gaps = [each["gap"] for each in done if each["gap"] is not None]
    if gaps:
        before = np.median([each["gap_before"] for each in done if each["gap_before"] is not None])
        print(f"  gap before {before:.2f}, after {np.median(gaps):.2f}, largest {max(gaps):.2f}")
        met &= float(np.median(gaps)) <= GAP
        wall_s, cpu_s = (np.median([each[what] for each in done]) for what in ("wall_s", "cpu_s"))
        print(f"  seconds, medians: {wall_s:.0f} of wall time, {cpu_s:.0f} of processors")
        met &= float(cpu_s) <= 2 * WALL_S
    return met


_STEPS: Final = {"rigs": identify_rig, "effects": diagnose_effect}


def main(arguments: list[str] | None = None) -> int:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identified", description=__doc__)
    parser.add_argument("step", choices=("rigs", "effects", "healthy", "score"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--count", type=int, help="rigs a kind; without it as many as the figures want")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=FREE)
    parser.add_argument("--more", type=int, default=1000, help="do at most so many")
    parser.add_argument("--budget", type=float, help="seconds of each search or diagnosis")
    asked = parser.parse_args(arguments)
    rigs = (asked.only,) if asked.only else tuple(FREE)
    count = asked.count or _COUNTS[asked.step]
    if asked.step == "healthy":
        more = asked.more
        for rig in rigs:
            folder = asked.folder / f"{rig}_healthy"
            more -= judge_healthy(folder, asked.results, rig, count, asked.seed, more)
    if asked.step in _STEPS:
        every = [
            (Case(asked.folder / f"{rig}_{number:02d}", asked.results), rig, number)
            for number in range(count)
            for rig in rigs
        ]
        open_ones = [each for each in every if each[0].found(asked.step) is None]
        if asked.step == "effects":  # in rigs that were identified
            open_ones = [each for each in open_ones if "model" in (each[0].found("rigs") or {})]
        for case, rig, number in open_ones[: asked.more]:
            _STEPS[asked.step](case, rig, number, asked.seed, asked.budget or BUDGET_S[asked.step])
    return 0 if score(asked.results) else 1


if __name__ == "__main__":
    sys.exit(main())

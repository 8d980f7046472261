"""Impacts a cycle: by the rule beside a count by eye of ten cycles, and predicted beside measured.

Healthy rigs are drawn by seed and simulated as the emulated benches are; the nominal twin of their scenario
predicts each from that rig's phase, and both go through what derives impacts in a run. Motions that part
after a second are other draws: the twin against all rigs together is given with its 95 % interval, from how
the pairs scatter. Counts by eye are of ten cycles from 1 s on,
of the first of those rigs and of recordings of another program (`--samples`), from plots without the rule's
impacts (`--plots`), a rise to be counted from the level drawn in.

Usage: python -m benchmarks.impact_counts [--rigs N] [--seconds S] [--samples FOLDER] [--plots FOLDER]
Returns 1 if the rule is more than 10 % off a count by eye, or the twin off the rigs together.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from daq.block import SampleBlock
from daq.log.reader import LogReader, Origin
from daq.log.records import Impact
from rig.derived.derivation import Derivation
from rig.derived.settings import RECORD, Settings, from_record
from rig.files.scenario import Scenario, load_scenario, parse_scenario
from rig.pages.content import Part, page
from rig.pages.plots import Plots
from rig.stream import Block, Metadata, Record
from rig.twin.prediction import blocks_of, settling_s, skip
from rig.twin.scenario_twin import twin_of
from sim_twin.twin import AnyTwin

SCENARIOS: Final[Mapping[str, tuple[str, Mapping[str, str]]]] = {
    "beam, 20 Hz": ("impact_beam", {}),
    "beam, 5 Hz": ("impact_beam", {"drive.frequency": "5 Hz"}),
    "planar crank, 200 rpm": ("planar_slider_crank", {}),
    "spatial crank, 230 rpm": ("spatial_slider_crank", {}),
}
SAMPLES: Final = ("beam_healthy", "beam_base_flexibility", "crank_healthy", "crank_joint_friction")
_UPPER, _LOWER = "contact.force_upper", "contact.force_lower"
_CRANK_Y, _CRANK_X = "crank_frame.acceleration_y", "crank_frame.acceleration_x"
_PISTON_Y = "piston_frame.acceleration_y"
BY_EYE: Final[Mapping[str, Mapping[str, tuple[int, float]]]] = {
    "beam, 20 Hz": {_UPPER: (10, 5.43224), _LOWER: (10, 5.51759)},
    "beam, 5 Hz": {_UPPER: (10, 3.68228), _LOWER: (10, 3.71962)},
    "planar crank, 200 rpm": {_CRANK_Y: (21, 10.1688), _CRANK_X: (20, 26.4215), _PISTON_Y: (20, 7.00428)},
    "spatial crank, 230 rpm": {"socket.force": (62, 14.9989), "slider.force_1": (124, 1.13139)},
    "beam_healthy": {_UPPER: (10, 6.43542), _LOWER: (10, 6.3825)},
    "beam_base_flexibility": {_UPPER: (10, 6.41679), _LOWER: (10, 6.37769)},
    "crank_healthy": {_CRANK_Y: (19, 7.5188), _CRANK_X: (19, 21.2911), _PISTON_Y: (17, 6.84831)},
    "crank_joint_friction": {_CRANK_Y: (10, 3.25649), _CRANK_X: (10, 9.99048), _PISTON_Y: (10, 3.95329)},
}
"""Counts, and the rms of what was counted: another processor's motion may be another one."""
RATE: Final = 25_600.0
CYCLES, FROM_S, OFF, SAME, SHORT = 10, 1.0, 0.10, 1e-3, 0.05
SELDOM: Final = 0.2
Samples = Mapping[str, NDArray[np.floating]]


class Derived:
    """Impacts and settings of all origins of a recording."""

    def __init__(self) -> None:
        self.impacts: list[Impact] = []
        self.settings: Mapping[str, Settings] = {}

    def __call__(self, record: Record) -> None:
        match record:
            case Impact():
                self.impacts.append(record)
            case Metadata(name, values) if name == RECORD:
                self.settings = from_record(values)

    def counts(self, origin: Origin, from_sample: float = 0.0, end_sample: float = np.inf) -> Counter[str]:
        """By channel, of those that begin in a stretch."""
        return Counter(
            each.channel
            for each in self.impacts
            if each.origin == origin and from_sample <= each.first_sample < end_sample
        )


def derived(blocks: Iterable[Block], scenario: Scenario, channels: Mapping[Origin, Iterable[str]]) -> Derived:
    found = Derived()
    derivation = Derivation(found, {origin: tuple(names) for origin, names in channels.items()}, scenario)
    for block in blocks:
        derivation(block)
    derivation.finish()
    return found


def shown(scenario: Scenario, seed: int, seconds: float) -> list[Iterator[SampleBlock]]:
    """What the sensors of a healthy rig show once it has settled, and what the nominal twin predicts."""
    nominal, rng = twin_of(scenario), np.random.default_rng(seed)
    drawn, phase = nominal.model.draw_healthy(nominal, rng, rng), float(rng.uniform(0, 2 * np.pi))

    def one(twin: AnyTwin, noise: np.random.Generator | None) -> Iterator[SampleBlock]:
        stream = twin.model.stream(twin, RATE, noise)
        stream.drive(twin.drive, phase)
        skip(stream, round(settling_s(twin, scenario.acquisition.settle) * RATE))
        yield from blocks_of(stream, 0, round(seconds * RATE), start_ns=0)

    return [one(drawn, rng), one(nominal, None)]


def ratio(pairs: NDArray[np.float64]) -> tuple[float, float]:
    """Predicted over measured of all pairs together less 1, and half its 95 % interval; shape (n, 2)."""
    measured, predicted = pairs.T
    together = predicted.mean() / measured.mean()
    scatter = np.std(predicted - together * measured, ddof=1) / measured.mean()
    return float(together - 1), float(student.ppf(0.975, len(pairs) - 1) * scatter / np.sqrt(len(pairs)))


def as_samples(blocks: Iterable[Block]) -> Samples:
    parts: dict[str, list[NDArray[np.floating]]] = {}
    for block in blocks:
        if block.origin == "measured":
            parts.setdefault(block.samples.channel, []).append(block.samples.values)
    return {name: np.concatenate(each) for name, each in parts.items()}


def plotted(whose: str, samples: Samples, settings: Settings, rate: float) -> list[Part]:
    """Ten cycles of each channel that is counted, over a grid of its bounces' time, with its level."""
    parts: list[Part] = []
    for name in BY_EYE[whose]:
        levels, cycle = settings.levels[name], rate / (settings.cycle_hz or 1.0)
        bounces = settings.within_s[name] * rate / cycle
        rows = 20 if bounces < SHORT else 2
        plots = Plots(rows, 1, 150)
        for row in range(rows):
            first, end = (round(FROM_S * rate + CYCLES * cycle * at / rows) for at in (row, row + 1))
            turns = (np.arange(first, end) - FROM_S * rate) / cycle
            plots.axes(row, f"{name}, from {levels.counts_from_n:.3g}", x_axis={"dtick": bounces})
            values = np.abs(samples[name][first:end])
            plots.outline(row, "measured", turns, values, points=6000)
            plots.line(row, "limit", turns[[0, -1]], [levels.counts_from_n] * 2)
        parts.append(plots.figure(name.replace(".", "-")))
    return parts


def by_eye(whose: str, found: Derived, samples: Samples, rate: float) -> bool:
    """Print the rule's count of ten cycles beside that by eye; whether they agree."""
    settings, well = found.settings["measured"], True
    begin, end = FROM_S * rate, (FROM_S + CYCLES / (settings.cycle_hz or 1.0)) * rate
    counted = found.counts("measured", begin, end)
    for name in BY_EYE[whose]:
        looked_at = samples[name][round(begin) : round(end)]
        rms = float(np.sqrt(np.mean(np.square(looked_at, dtype=np.float64))))
        eye, then = BY_EYE[whose][name]
        same = abs(rms / then - 1) < SAME if then else False
        beside = f"{eye:4d} by eye" if same else "other motion" if then else "not counted"
        off = abs(counted[name] / eye - 1) if same else 0.0
        well &= off <= OFF
        print(f"{whose:24s} {name:28s} {counted[name]:4d} {beside:12s} {off:6.1%}  rms {rms:.6g}", flush=True)
    return well


def of_rigs(whose: str, rigs: int, seconds: float, plots: Path | None) -> bool:
    """Print how often the rigs are struck and their twins; whether that agrees."""
    file, settings = SCENARIOS[whose]
    asked: Mapping[str, Any] = {**settings, "acquisition.sample_rate": f"{RATE:g} Hz"}
    scenario = load_scenario(Path("scenarios") / f"{file}.toml", asked)
    cycles, well = seconds * scenario.drive.cycle_hz, True
    counts: dict[str, list[tuple[int, int]]] = {}
    for seed in range(rigs):
        rig, twin = shown(scenario, seed, seconds)
        blocks = [Block("measured", each) for each in rig]
        twins = [Block("predicted", each) for each in twin]
        names = list(dict.fromkeys(each.samples.channel for each in blocks))
        found = derived([*blocks, *twins], scenario, {"measured": names, "predicted": names})
        if seed == 0:
            samples = as_samples(blocks)
            well &= by_eye(whose, found, samples, RATE)
            draw(plots, whose, plotted(whose, samples, found.settings["measured"], RATE))
        measured, predicted = found.counts("measured"), found.counts("predicted")
        for name in found.settings["measured"].levels:
            counts.setdefault(name, []).append((measured[name], predicted[name]))
    for name, pairs in counts.items():
        table = np.array(pairs, dtype=np.float64)
        mean = table.mean(axis=0) / cycles
        if mean.max() < SELDOM:  # a point that hardly ever touches
            print(f"{whose:24s} {name:28s} a cycle {mean[0]:6.2f} measured {mean[1]:6.2f} predicted")
            continue
        off, (together, half) = table[:, 1] / table[:, 0] - 1, ratio(table)
        well &= abs(together) <= OFF
        print(
            f"{whose:24s} {name:28s} a cycle {mean[0]:6.2f} measured {mean[1]:6.2f} predicted "
            f"{together:+6.1%} +- {half:.1%}; single rigs {off.min():+.1%} to {off.max():+.1%}",
            flush=True,
        )
    return well


def of_sample(name: str, folder: Path, plots: Path | None) -> bool:
    with LogReader(folder / f"{name}.mcap") as log:
        scenario = parse_scenario(log.scenario)
        blocks = [Block(origin, block) for origin, block in log.blocks("measured")]
        found = derived(blocks, scenario, {"measured": log.channels("measured")})
    samples, rate = as_samples(blocks), blocks[0].samples.sample_rate
    draw(plots, name, plotted(name, samples, found.settings["measured"], rate))
    return by_eye(name, found, samples, rate)


def draw(folder: Path | None, whose: str, parts: list[Part]) -> None:
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        name = whose.replace(",", "").replace(" ", "_")
        (folder / f"{name}.html").write_text(page(whose, [], [("Ten cycles", parts)]), encoding="utf-8")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.impact_counts")
    parser.add_argument("--rigs", type=int, default=16)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--samples", type=Path)
    parser.add_argument("--plots", type=Path)
    asked = parser.parse_args(arguments)
    well = [of_rigs(whose, asked.rigs, asked.seconds, asked.plots) for whose in SCENARIOS]
    if asked.samples is not None:
        well += [of_sample(name, asked.samples, asked.plots) for name in SAMPLES]
    return int(not all(well))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

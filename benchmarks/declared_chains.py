"""Whether a healthy rig on a bench of odd but declared chains lies within the healthy band, and only then.

Benches of the three rigs in turn, each with chains of its own: high-passes of charge amplifiers and IEPE
sensors (0.5 to 20 Hz), Butterworth filters (1 to 10 kHz, order 4 to 8), gains (0.4 to 2 of the usual),
inputs that are late (24 to 38 samples, each module by its own), encoders of 500 to 5000 lines that count
either way, index marks and markers anywhere, of 2 to 10 V, rising or falling. What is on the bench is made
by the emulated card, whose filters are none of the twin's. Each run is judged twice by the band of healthy
rigs that a report's verdict uses: by its log, and by the same log in which nothing is said of the chains. The
same rig on the usual bench says whether it is the rig that lies outside, as one in so many does.
A run of which nothing is said may not even be read: it is refused, which is not outside.

Every bench's result is a file in DIR, with the commit and a digest of the program that it is of: what is
there of the present one is not done again, so parts of it add up, and those of others are left out.

Usage: python -m benchmarks.declared_chains DIR [--more N] [--only RIG] [--benches 40] [--rigs 48] [--seed 0]
Returns 1 if more than one in twenty declared benches lies outside, or no more than half of the others
do, or some are not done yet.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.intervals import share_of
from benchmarks.kept_results import Results, made_by
from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import ConfigurationError, LogError
from daq.log.writer import LogWriter
from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.emulator.converter import AngleCount, Converter, EdgeCount, Measure, PulseFrequency
from drivers.ni_daq.emulator.wiring import CounterWire, Input
from drivers.ni_daq.sensors import described, known_sensor
from drivers.protocols.speed_drive import MotorOutput
from rig.diagnosis.health import band_of
from rig.diagnosis.recordings import recorded_alone
from rig.emulated_rig import drawn_rig
from rig.emulation import wiring_of
from rig.files.bench import Bench, embedded_bench, parse_bench
from rig.files.faults import read_toml, toml_of
from rig.files.scenario import Scenario, load_scenario
from rig.rigs import RIGS
from rig.session.progress import Screen, Terminal
from rig.twin.chains import declared_by

SCENARIOS: Final = ("impact_beam", "planar_slider_crank", "spatial_slider_crank")
_HANGS_ON: Final = (
    "rig.diagnosis.health",
    "rig.emulated_rig",
    "rig.emulation",
    "rig.files",
    "rig.rigs",
    "sim_twin.rigs",
    "drivers.ni_daq",
)
_BESIDE: Final = ("benchmarks/declared_chains.py", *(f"rig/rigs/{rig}.toml" for rig in SCENARIOS))
"""Modules that the results hang on, with what they import, and files."""
TRIMMED: Final = 2e-4
"""Standard deviation of a speed from the one that is asked for, of a healthy run."""
BLOCK_S, SETTLE_S, LONGEST_S = 0.1, 3.0, 20.0
START_NS: Final = 1_790_000_000_000_000_000
MOST_OUTSIDE, LEAST_SEEN = 1 / 20, 1 / 2
Array = NDArray[np.float64]


def odd_bench(rig: str, rate: float, rng: np.random.Generator) -> Bench:
    """The rig's embedded bench with chains of every kind that a bench can declare."""
    table: dict[str, Any] = read_toml(RIGS[rig].bench, "embedded bench")
    table["emulation"] = {"seed": int(rng.integers(2**31))}
    late: dict[str, float] = {}
    for channel in table["daq_card"]["channels"]:
        _make_odd(channel, rate, late, rng)
    return parse_bench(toml_of(table), f"odd bench of the {rig}", Path(), rig)


def _make_odd(channel: dict[str, Any], rate: float, late: dict[str, float], rng: np.random.Generator) -> None:
    def within(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")

    module, kind = channel["physical"].partition("/")[0], channel["kind"]
    if kind == "encoder":
        channel |= {
            "pulses_per_revolution": int(rng.integers(500, 5001)),
            "decoding": str(rng.choice(["x1", "x2", "x4"])),
            "index": True,
            "initial_angle": f"{rng.uniform(0, 359.9):.2f} deg",
            "direction": str(rng.choice(["forwards", "backwards"])),
        }
        return
    if kind == "marker":
        channel["angle"] = f"{rng.uniform(0, 359.9):.2f} deg"
        if "/ctr" in channel["physical"]:
            return
        channel |= {
            "level": f"{rng.uniform(2.0, 10.0):.3f} V",
            "polarity": str(rng.choice(["rising", "falling"])),
        }
    samples = late.setdefault(module, float(rng.uniform(24.0, 38.0)))
    channel["delay"] = f"{1e3 * samples / rate:.4f} ms"
    if kind == "charge_amplifier":
        channel["amplifier"] = {"corner": f"{within(0.5, 20.0)} Hz", "output": "10 V"}
    if kind in ("force_iepe", "acceleration_iepe"):
        channel["corner"] = f"{within(0.5, 20.0)} Hz"
        channel["sensitivity"] = _scaled(channel["sensitivity"], within(0.4, 2.0))
    elif kind in ("charge_amplifier", "voltage"):
        channel["filter"] = {"corner": f"{within(1.0, 10.0)} kHz", "order": int(rng.integers(4, 9))}
        scale = "gain" if kind == "charge_amplifier" else "sensitivity"
        channel[scale] = _scaled(channel[scale], within(0.4, 2.0))


def _scaled(quantity: str, factor: float) -> str:
    number, unit = quantity.split(maxsplit=1)
    return f"{float(number) * factor:.6g} {unit}"


def measured(scenario: Scenario, bench: Bench, seed: int) -> dict[str, Array]:
    """What the card of the bench reads of a healthy rig in motion, once it has settled."""
    rate = scenario.acquisition.sample_rate
    rig = drawn_rig(scenario, bench, seed, seed + 1)
    plant, output = rig.plant(), rig.scenario_output
    plant.start(rate)
    if rig.motor is not None:  # as a run trims it: no whole number of samples a turn
        assert isinstance(output, MotorOutput)
        off = TRIMMED * np.random.default_rng([seed, 1]).standard_normal()
        level = scenario.drive.speed / rig.motor.rad_s_per_level * (1 + off)
        output = replace(output, level=level, target=level)
    plant.drive(output, 0.0)
    wiring, channels = wiring_of(bench), bench.daq_card.channels
    analog = [channel for channel in channels if not channel.counted]
    inputs = [Input(channel.physical, 1.0, math.inf) for channel in analog]
    converter = Converter(wiring, plant.channels, inputs, rate)
    counters = {
        each.name: _counter(each, wiring.counters[each.physical], rate) for each in channels if each.counted
    }
    decoders = {each.name: known_sensor(each).decoder(each) for each in channels if each.counted}
    parts: dict[str, list[Array]] = {channel.name: [] for channel in channels}
    block = round(BLOCK_S * rate)
    begin = round((SETTLE_S + np.random.default_rng(seed).uniform()) * rate)
    for _ in range(0, begin + round(scenario.acquisition.duration * rate), block):
        rows = plant.advance(block)
        volts, _ = converter.convert(rows)
        for channel, row in zip(analog, volts, strict=True):
            offset = channel.mark.offset if channel.mark is not None else 0.0
            scale = known_sensor(channel).scale(channel)
            parts[channel.name].append(row * (scale or 1 / channel.volts_per_unit) + offset)
        for name, measure in counters.items():
            parts[name].append(decoders[name](measure(rows[plant.channels.index(name)])))
    return {name: np.concatenate(each)[begin:] for name, each in parts.items()}


def _counter(channel: CardChannel, wire: CounterWire, rate: float) -> Measure:
    pulses = channel.pulses
    if pulses is None:
        return EdgeCount(wire)
    if channel.unit != "rad":
        return PulseFrequency(wire, rate)
    counts = round(pulses.counted_from / pulses.rad_per_count)
    return AngleCount(wire, pulses.decoding, counts, counts if pulses.index else None)


def write(
    path: Path, scenario: Scenario, bench: Bench, record: Mapping[str, str], seen: dict[str, Array]
) -> None:
    """A measured log of it."""
    rate = scenario.acquisition.sample_rate
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": scenario.text})
        log.add_metadata("run", {"id": path.stem, "started": "1970-01-01T00:00:00Z", **record})
        channels: list[Channel] = [described(each) for each in bench.daq_card.channels]
        for channel in channels:
            log.declare("measured", channel)
        block = round(BLOCK_S * rate)
        for first in range(0, len(next(iter(seen.values()))), block):
            for name, row in seen.items():
                values, time_ns = row[first : first + block], sample_time_ns(START_NS, first, rate)
                if name.endswith(".angle"):
                    values = values - math.tau * math.floor(row[0] / math.tau)
                else:
                    values = values.astype(np.float32)
                log.add_block("measured", SampleBlock(name, first, time_ns, rate, values), time_ns)


def judged(path: Path, rigs: int, screen: Screen) -> tuple[bool, str]:
    """Whether the run of a log lies within the healthy band, and its gap in words."""
    run = recorded_alone(path, LONGEST_S)
    band = band_of(run, "", rigs, screen)
    if band is None:
        raise SystemExit("no healthy band")
    whole, *channels = band.places(run.measured)
    beyond = [each for each in channels if each.beyond]
    worst = (beyond or channels)[0]
    words = (
        f"gap {whole.gap:5.2f} ({whole.farthest:.2f}), {worst.channel} {worst.gap:.2f}, {worst.worst.what}"
    )
    return not (whole.beyond or beyond), words


def judged_bench(number: int, name: str, rigs: int, seed: int) -> dict[str, Any]:
    """Whether the healthy rig of this number lies within by each log, its gaps in words, and what it cost."""
    scenario = load_scenario(Path("scenarios") / f"{name}.toml")
    rng, screen = np.random.default_rng([seed, 9]), Screen(Terminal(stderr=True))
    rate = scenario.acquisition.sample_rate
    bench, plain = odd_bench(name, rate, rng), embedded_bench(name)
    began_s = _processors_s()
    odd, usual = (measured(scenario, each, 1000 + seed) for each in (bench, plain))
    found: dict[str, Any] = {"rig": name}
    with tempfile.TemporaryDirectory() as folder:
        for kind, seen, of, record in (
            ("declared", odd, bench, declared_by(bench, rate)),
            ("not", odd, bench, {}),
            ("usual", usual, plain, declared_by(plain, rate)),
        ):
            path = Path(folder) / f"{name}_{number}_{kind}.mcap"
            write(path, scenario, of, record, seen)
            try:
                healthy, told = judged(path, rigs, screen)
                verdict = "within" if healthy else "outside"
            except (ConfigurationError, LogError) as error:
                if kind != "not":
                    raise
                verdict, told = "refused", f"{type(error).__name__}: {error}"
            found[kind] = {"verdict": verdict, "told": told}
            print(f"{number:3d} {name:21s} {kind:9s}{verdict:8s} {told}", flush=True)
    return found | {"cpu_s": round(_processors_s() - began_s)}


def _processors_s() -> float:
    return sum(os.times()[:4])


def score(results: Sequence[Mapping[str, Any]], total: int) -> int:
    """Print what became of those that are done; what `main` returns."""

    def those(kind: str, verdict: str) -> list[bool]:
        return [each[kind]["verdict"] == verdict for each in results]

    done, declared, outside = len(results), those("declared", "within"), those("not", "outside")
    least, most = done * (1 - MOST_OUTSIDE), done * LEAST_SEEN
    print(f"declared, within the healthy band    {share_of(declared)}; at least {least:.0f}")
    print(f"the same rigs on the usual bench     {share_of(those('usual', 'within'))}")
    print(f"not declared, outside                {share_of(outside)}; more than {most:.0f}")
    print(f"not declared, refused                {share_of(those('not', 'refused'))}")
    print(f"processors                           {sum(each['cpu_s'] for each in results) / 60:.0f} min")
    if done < total:
        print(f"{total - done} of {total} are not done yet")
    return int(done < total or sum(declared) < least or sum(outside) <= most)


def main(arguments: list[str] | None = None) -> int:
    """Do benches that are not done yet; print their gaps, and how many of all lie within the band."""
    parser = argparse.ArgumentParser(description="Healthy rigs on benches of odd chains.")
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--more", type=int, help="do at most so many")
    parser.add_argument("--benches", type=int, default=40)
    parser.add_argument("--rigs", type=int, default=48)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=SCENARIOS)
    asked = parser.parse_args(arguments)
    os.environ["XDG_CACHE_HOME"] = str(asked.folder)  # the bands of undeclared and usual benches stay there
    results = Results(asked.folder, made_by(_HANGS_ON, _BESIDE))
    names = {number: f"{number:02d}_{asked.rigs}_rigs_seed_{asked.seed}" for number in range(asked.benches)}
    open_ones = [
        number
        for number, name in names.items()
        if results.found(name) is None and asked.only in (None, SCENARIOS[number % len(SCENARIOS)])
    ]
    for number in open_ones[: asked.more]:
        rig = SCENARIOS[number % len(SCENARIOS)]
        results.keep(names[number], judged_bench(number, rig, asked.rigs, asked.seed + number))
    print(f"program {results.digest}; results of others, left out: {results.others('*')}")
    done = [found for name in names.values() if (found := results.found(name)) is not None]
    return score(done, asked.benches)


if __name__ == "__main__":
    sys.exit(main())

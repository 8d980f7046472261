"""Logs of a crank whose frame does what its angle and clearances say, with some noise: it can be learnt."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from daq.block import SampleBlock, sample_time_ns
from daq.log.records import RECORD_END, Event
from daq.log.writer import LogWriter
from rig.files.bench import embedded_bench
from rig.surrogates.recordings import SEED, Setting
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, ANGLE, CHANNELS
from tests.rig.synthetic_run import START_NS

RATE, BLOCK = 25_600.0, 2560
NOISE = 0.05


def shown(setting: Setting, seconds: float, rate: float = RATE) -> dict[str, np.ndarray]:
    """What each channel shows: the angle of the crank, and a harmonic of it for each acceleration."""
    angle = 0.3 + 2 * math.pi * setting.speed / 60 * np.arange(round(seconds * rate)) / rate
    random = np.random.default_rng(int(setting.speed))
    size = setting.clearance_1 * setting.speed / 100
    waves = (size * np.sin((1 + number) * angle) for number in range(3))
    rows = {
        name: (wave + random.normal(scale=NOISE, size=len(angle))).astype(np.float32)
        for name, wave in zip(ACCELERATIONS, waves, strict=True)
    }
    return {**rows, ANGLE: np.round(angle * 4096 / (2 * math.pi)) * 2 * math.pi / 4096}


def write_log(
    path: Path,
    setting: Setting,
    seconds: float = 3.0,
    leave_out: str = "",
    spoil: str = "",
    show: Callable[[Setting, float], dict[str, np.ndarray]] = shown,
) -> Path:
    rows = {name: row for name, row in show(setting, seconds).items() if name != leave_out}
    if spoil:
        rows[spoil][:] = np.nan
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": setting.scenario(seconds)})
        bench = hashlib.sha256(embedded_bench("planar_slider_crank").text.encode()).hexdigest()
        log.add_metadata("run", {"bench_sha256": bench, "emulation_seed": str(SEED)})
        for name in rows:
            log.declare("measured", CHANNELS[name].described)
        for first in range(0, round(seconds * RATE), BLOCK):
            time_ns = sample_time_ns(START_NS, first, RATE)
            for name, row in rows.items():
                log.add_block(
                    "measured", SampleBlock(name, first, time_ns, RATE, row[first : first + BLOCK]), time_ns
                )
        log.add_event(Event(START_NS + round(seconds * 1e9), "info", "sequencer", RECORD_END, "recorded"))
    return path


def write_recordings(
    folder: Path,
    settings: Iterable[Setting],
    seconds: float,
    show: Callable[[Setting, float], dict[str, np.ndarray]] = shown,
) -> list[Path]:
    """As the emulated bench would have left them."""
    paths = []
    for each in settings:
        (folder / each.name).mkdir(parents=True)
        paths.append(write_log(folder / each.name / "run.mcap", each, seconds, show=show))
    return paths

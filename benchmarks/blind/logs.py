"""Writes recordings as logs that say nothing of what is hidden in them."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.engines import Engine
from benchmarks.blind.operating_points import scenario_text
from benchmarks.blind.recording import Recording
from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.writer import LogWriter

_BLOCK_S = 0.1
_FIRST_RUN_NS = 1_790_000_000 * NS_PER_S
_BETWEEN_RUNS_NS = 600 * NS_PER_S


def run_names(campaign: Campaign) -> list[str]:
    """File names of a campaign's logs."""
    return [f"{campaign.name}_run{number + 1}.mcap" for number in range(len(campaign.runs))]


def write_campaign(folder: Path, campaign: Campaign, engine: Engine) -> list[Path]:
    """Record what is not there yet of a campaign's runs; returns their logs."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in run_names(campaign)]
    for number, path in enumerate(paths):
        if not path.exists():
            seed = campaign.run_seeds[number]
            recording = engine.record(
                campaign.runs[number],
                (*campaign.page, *campaign.effects),
                campaign.rig_seed,
                seed,
                wider=campaign.wider,
            ).without(campaign.missing)
            title = f"campaign {campaign.name}, run {number + 1}"
            _write_whole(path, recording, scenario_text(title, campaign.runs[number]), number)
    return paths


def _write_whole(path: Path, recording: Recording, toml: str, number: int) -> None:
    """Under another name until it is complete, so that an interrupted one is made again."""
    unfinished = path.with_suffix(".part")
    unfinished.unlink(missing_ok=True)
    write_log(unfinished, recording, toml, path.stem, number)
    unfinished.rename(path)


def write_log(path: Path, recording: Recording, toml: str, run_id: str, number: int) -> None:
    """Write /measured/... of a recording; `number` is the run's place in its campaign."""
    start_ns = _FIRST_RUN_NS + number * _BETWEEN_RUNS_NS
    with LogWriter(path, library="rattle blind check") as log:
        log.add_metadata("scenario", {"toml": toml})
        log.add_metadata("run", {"id": run_id, "started": f"{_utc(start_ns):%Y-%m-%dT%H:%M:%SZ}"})
        for name, unit in recording.units.items():
            log.declare("measured", _channel(name, unit))
        _write_blocks(log, recording, start_ns)


def _utc(time_ns: int) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(time_ns / NS_PER_S, datetime.UTC)


def _channel(name: str, unit: str) -> Channel:
    location, _, quantity = name.partition(".")
    return Channel(name, unit, quantity.split("_")[0], location)


def _write_blocks(log: LogWriter, recording: Recording, start_ns: int) -> None:
    rate = recording.sample_rate
    length = round(_BLOCK_S * rate)
    samples = max(len(values) for values in recording.channels.values())
    for first in range(0, samples, length):
        time_ns = sample_time_ns(start_ns, first, rate)
        host_ns = sample_time_ns(start_ns, min(first + length, samples), rate)
        for name, values in recording.channels.items():
            part = _as_logged(name, values[first : first + length])
            log.add_block("measured", SampleBlock(name, first, time_ns, rate, part), host_ns)


def _as_logged(name: str, values: NDArray[np.float64]) -> NDArray[np.floating]:
    return values if name.endswith(".angle") else values.astype(np.float32)

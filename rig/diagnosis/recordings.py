"""Recorded runs as a campaign: what was measured, cut into blocks of cycles, and what was lost of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.errors import ConfigurationError, LogError, Problem
from daq.log import LogReader
from rig.twin.alignment import FREQUENCY_TOLERANCE, Alignment
from rig.twin.overlay import scenario_of
from rig.twin.rigs import kind_of
from rig.twin.scenario_twin import twin_of
from sim_twin.decimation import decimated
from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.fingerprint.columns import Columns
from sim_twin.rigs.catalogue import model_of
from sim_twin.sensors import Encoder, anti_alias_taps
from sim_twin.twin import AnyTwin, Twin

Array = NDArray[np.floating]
_RATE = 25_600.0
_BLOCK_S, _BLOCK_CYCLES = 1.8, 8
_FEWEST_CYCLES = 10
_FEWEST_IN_A_BLOCK = 5
_MOST_BLOCKS = 6
_COUPLED = {"N", "m/s2"}
_SPOILT = Flag.OVERLOAD | Flag.OPEN_SENSOR | Flag.NOT_FINITE


@dataclass(frozen=True, slots=True)
class Recorded:
    """A campaign with its `measured` fingerprints (blocks, numbers); `remarks` say what was lost or odd.

    `scenarios` are the runs' scenario texts.
    """

    campaign: Campaign
    measured: NDArray[np.float32]
    remarks: tuple[str, ...]
    scenarios: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Run:
    path: Path
    twin: AnyTwin
    records: dict[str, Array]
    sound: NDArray[np.bool_]
    rate: float
    step: int
    remarks: tuple[str, ...]
    scenario: str


def recorded(paths: Sequence[Path]) -> Recorded:
    """Read runs of one rig; ConfigurationError or LogError, naming the run, for what cannot be used."""
    runs = [_read(path) for path in paths]
    _of_one_rig(runs)
    common = [name for name in runs[0].twin.channels if all(name in run.records for run in runs)]
    settings = [_setting(run, common) for run in runs]
    campaign = Campaign(tuple(settings))
    blocks = [setting.blocks_of(run.records, run.sound) for setting, run in zip(settings, runs, strict=True)]
    count = min(_MOST_BLOCKS, *(len(each) for each in blocks))
    measured = np.concatenate([_grouped(each, count) for each in blocks], axis=1)
    remarks = [f"{run.path.name}: {remark}" for run in runs for remark in run.remarks]
    return Recorded(campaign, measured, tuple(remarks), tuple(run.scenario for run in runs))


def _grouped(blocks: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    return np.array([part.mean(axis=0) for part in np.array_split(blocks, count)], dtype=np.float32)


def _of_one_rig(runs: Sequence[_Run]) -> None:
    rigs = {model_of(run.twin).name: run.path.name for run in runs}
    if len(rigs) > 1:
        what = ", ".join(f"{path} is of the {rig}" for rig, path in rigs.items())
        raise ConfigurationError("campaign", [Problem("runs", what, "runs of one rig")])


def _read(path: Path) -> _Run:
    with LogReader(path) as log:
        scenario = scenario_of(log)
        channels = log.channels("measured")
        twin = twin_of(scenario, channels)
        model = model_of(twin)
        if model.reference not in channels:
            raise LogError(f"{path}: no {model.reference}; without it nobody knows the phase of a cycle")
        wanted = [name for name in twin.channels if name in channels]
        _check_units(path, channels, twin, wanted)
        table = log.table("measured", wanted)
        sound, spoilt = _sound(log, wanted, table)
    missing = [name for name in twin.channels if name not in channels]
    remarks = [f"no {name}: what only it shows cannot be found" for name in missing]
    if spoilt:
        remarks.append(f"{spoilt:.1%} of it left out (missing, overloaded or not finite)")
    step, records, kept = _resampled(table, sound, twin)
    rate = table[model.reference].sample_rate / step
    twin = _in_step(path, twin, records[model.reference], rate)
    return _Run(path, twin, records, kept, rate, step, tuple(remarks), scenario.text)


def _in_step(path: Path, twin: AnyTwin, reference: Array, rate: float) -> AnyTwin:
    """The twin at the measured mean frequency; raises LogError where that is not the scenario's."""
    model, kind = model_of(twin), kind_of(twin)
    nominal = kind.untouched(twin.drive).frequency
    wrong = (
        f"{path}: {model.reference} does not run at the scenario's {nominal:g} Hz within "
        f"{100 * FREQUENCY_TOLERANCE:g} %; correct the scenario, or the channel"
    )
    try:
        cycles = model.follow(reference, rate, nominal)
    except ValueError as error:
        raise LogError(f"{wrong} ({error})") from error
    if abs(cycles.frequency / nominal - 1) > FREQUENCY_TOLERANCE:
        raise LogError(f"{wrong} (it runs at {cycles.frequency:.6g} Hz)")
    drive = kind.in_step(twin.drive, Alignment(cycles.frequency, cycles.phase))
    return Twin(twin.rig, drive, twin.sensors)


def _check_units(path: Path, channels: dict[str, Channel], twin: AnyTwin, wanted: Sequence[str]) -> None:
    for name in wanted:
        unit = model_of(twin).channel_unit(name)
        if channels[name].unit != unit:
            raise LogError(f"{path}: {name} is in {channels[name].unit}, the twin's in {unit}")


def _sound(
    log: LogReader, wanted: Sequence[str], table: dict[str, SampleBlock]
) -> tuple[NDArray[np.bool_], float]:
    """Which samples of the span that all channels share can be used, and the share that cannot."""
    first, end = _span(table)
    sound = np.ones(end - first, dtype=bool)
    for series in table.values():
        sound &= np.isfinite(series.values[first - series.first_sample : end - series.first_sample])
    for _, block in log.blocks("measured", wanted):
        if block.flags & _SPOILT:
            sound[max(block.first_sample - first, 0) : max(block.end_sample - first, 0)] = False
    return sound, float(1 - sound.mean())


def _span(table: dict[str, SampleBlock]) -> tuple[int, int]:
    first = max(series.first_sample for series in table.values())
    return first, min(series.end_sample for series in table.values())


def _resampled(
    table: dict[str, SampleBlock], sound: NDArray[np.bool_], twin: AnyTwin
) -> tuple[int, dict[str, Array], NDArray[np.bool_]]:
    """How many samples become one; records at about 25.6 kHz, by the filter of the simulated ones."""
    rates = {series.sample_rate for series in table.values()}
    if len(rates) > 1:
        told = ", ".join(f"{rate:g} Hz" for rate in sorted(rates))
        raise LogError(f"channels of different rates ({told}) cannot be compared")
    rate = rates.pop()
    step = max(1, round(rate / _RATE))
    first, end = _span(table)
    count = (end - first) // step
    records = {
        name: _coarse(
            series.values[first - series.first_sample : end - series.first_sample], name, twin, step, count
        )
        for name, series in table.items()
    }
    return step, records, np.all(sound[: count * step].reshape(count, step), axis=1)


def _coarse(values: Array, name: str, twin: AnyTwin, step: int, count: int) -> Array:
    filled = np.nan_to_num(np.asarray(values, dtype=np.float64))
    if step == 1 or isinstance(twin.sensors.get(name), Encoder):
        return filled[: count * step : step]
    taps = anti_alias_taps(step, 0.0)
    half = len(taps) // 2
    return decimated(np.pad(filled, (half, half + step)), taps, step, count)


def _setting(run: _Run, channels: Sequence[str]) -> RunSetting:
    setting = setting_of(run.twin, channels, run.rate, float(run.sound.sum() / run.rate), run.step)
    if setting.cycles < _FEWEST_IN_A_BLOCK:
        whole = int(run.sound.sum() / run.rate * setting.columns.frequency)
        raise LogError(f"{run.path}: {whole} sound cycles; a diagnosis needs {_FEWEST_CYCLES} at least")
    return setting


def setting_of(
    twin: AnyTwin, channels: Sequence[str], rate: float, seconds: float, step: int = 1
) -> RunSetting:
    """How a run of so many sound `seconds` is looked at, at `rate` Hz after `step` samples became one."""
    model = model_of(twin)
    frequency = kind_of(twin).untouched(twin.drive).frequency
    coupled = tuple(
        name for name in channels if model.channel_unit(name) in _COUPLED and name != model.reference
    )
    whole = int(seconds * frequency - 1.5)
    cycles = min(max(_BLOCK_CYCLES, round(_BLOCK_S * frequency)), whole // 2)
    oversampling = 2 * max(1, round(model.fine_rate / rate / 2))
    angles = tuple(name for name in channels if isinstance(twin.sensors.get(name), Encoder))
    columns = Columns(tuple(channels), coupled, frequency, rate, angles)
    return RunSetting(twin, columns, oversampling, cycles, _quiet(step))


def _quiet(step: int) -> float:
    """Share of white noise's rms that the filter before a decimation leaves."""
    return 1.0 if step == 1 else float(np.sqrt(np.sum(anti_alias_taps(step, 0.0) ** 2)))

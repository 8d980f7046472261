"""Recorded runs as a campaign: what was measured, cut into blocks of cycles, and what was lost of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.errors import ConfigurationError, LogError, Problem
from daq.log.reader import LogReader
from rig.ensembles import cores
from rig.files.scenario import Scenario
from rig.files.table import NOTHING
from rig.rigs import RIGS
from rig.session.pace import Work
from rig.twin.alignment import FREQUENCY_TOLERANCE
from rig.twin.logged import followed_scenario, logged_twin
from sim_twin.decimation import decimated
from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.fingerprint import Columns
from sim_twin.rigs.cycles import Cycles
from sim_twin.sensors import Encoder, anti_alias_taps
from sim_twin.twin import AnyTwin

_SPOILT = {Flag.OVERLOAD: "overloaded", Flag.OPEN_SENSOR: "open", Flag.NOT_FINITE: "not finite"}
_MISSING = "missing"
_MOSTLY = 0.5
"""Share of a channel that cannot be used, from which on the channel is left out instead of its time."""


@dataclass(frozen=True, slots=True)
class Lossy:
    """A channel's samples; `lost`, shape (n,), says which of them cannot be used, `why` in words."""

    series: SampleBlock
    lost: NDArray[np.bool_]
    why: tuple[str, ...]


def work_of(what: str, campaign: Campaign, draws: int) -> Work:
    """Work in which all runs of a campaign are simulated for so many draws, in s of motion."""
    motion_s = sum(run.samples(1) / run.columns.rate + run.settle for run in campaign.runs)
    return Work(f"{what} {campaign.runs[0].twin.model.name} on {cores()}", draws * motion_s)


def lost_of(log: LogReader, names: Sequence[str], end_s: float | None = None) -> dict[str, Lossy]:
    """Channels up to a time, with what is lost of each: missing, flagged or not finite; LogError for none."""
    spoilt: list[SampleBlock] = []
    table = log.table(
        "measured", names, end_s=end_s, heard=lambda block: spoilt.append(block) if block.flags else None
    )
    lost = {name: ~np.isfinite(series.values) for name, series in table.items()}
    why: dict[str, list[str]] = {name: [_MISSING] if lost[name].any() else [] for name in table}
    for block in spoilt:
        first = table[block.channel].first_sample
        here = slice(max(block.first_sample - first, 0), max(block.end_sample - first, 0))
        for flag, word in _SPOILT.items():
            if block.flags & flag:
                lost[block.channel][here] = True
                why[block.channel].append(word)
    return {name: Lossy(table[name], lost[name], tuple(dict.fromkeys(why[name]))) for name in table}


def usable(
    path: Path, lost: Mapping[str, Lossy], reference: str
) -> tuple[dict[str, SampleBlock], NDArray[np.bool_], tuple[str, ...]]:
    """The channels that can be used, which samples of the `span` they share, shape (n,), and what is lost.

    A channel that is lost for half of the run or more is left out. Raises LogError where that is `reference`,
    which tells the cycles.
    """
    kept = {name: each for name, each in lost.items() if each.lost.mean() < _MOSTLY}
    if reference not in kept:
        each = lost[reference]
        raise LogError(
            f"{path}: {each.lost.mean():.0%} of {reference} {' and '.join(each.why)}; "
            "without it nobody knows the phase of a cycle"
        )
    table = {name: each.series for name, each in kept.items()}
    first, end = span(table)
    sound = np.ones(end - first, dtype=bool)
    remarks = [
        f"{name} is not used: {each.lost.mean():.0%} of it {' and '.join(each.why)}"
        for name, each in lost.items()
        if name not in kept
    ]
    alike: dict[str, list[str]] = {}
    for name, each in kept.items():
        spoilt = each.lost[first - each.series.first_sample : end - each.series.first_sample]
        sound &= ~spoilt
        if spoilt.any():
            alike.setdefault(f"{spoilt.mean():.1%} {' and '.join(each.why)}", []).append(name)
    for what, names in alike.items():
        whose = "all channels" if len(names) == len(kept) else ", ".join(names)
        remarks.append(f"{whose}: {what}; left out, in all channels")
    return table, sound, tuple(remarks)


def span(table: Mapping[str, SampleBlock]) -> tuple[int, int]:
    """First sample that all channels have, and the one after the last."""
    first = max(series.first_sample for series in table.values())
    return first, min(series.end_sample for series in table.values())


Array = NDArray[np.floating]
_RATE = 25_600.0
_BLOCK_S, _BLOCK_CYCLES = 1.8, 8
_FEWEST_CYCLES = 10
_FEWEST_SAMPLES = 64
_MOST_BLOCKS = 6
_SHORTER = 0.01
_OTHER_AMPLITUDE = 0.05
_SETTLED_S = 1.0
"""What a run from rest shows of how the motion sets in."""
_COUPLED = {"N", "m/s2"}


@dataclass(frozen=True, slots=True)
class RecordedCampaign:
    """A campaign with its `measured` fingerprints (blocks, numbers); `remarks` say what was lost or odd.

    `scenarios` are the runs' scenario texts, `records` their channels at the rate of the setting, `sound`
    says which samples of a run can be used. `chains` is what the first log says of its chains.
    """

    campaign: Campaign
    measured: NDArray[np.float32]
    remarks: tuple[str, ...]
    scenarios: tuple[str, ...]
    records: tuple[dict[str, Array], ...]
    sound: tuple[NDArray[np.bool_], ...]
    chains: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class _Run:
    path: Path
    twin: AnyTwin
    records: dict[str, Array]
    sound: NDArray[np.bool_]
    rate: float
    step: int
    cycles: int
    remarks: tuple[str, ...]
    left_out: tuple[str, ...]
    scenario: Scenario
    record: Mapping[str, str]


def recorded(
    paths: Sequence[Path], looked_at: Callable[[int, RunSetting], RunSetting] = lambda _, setting: setting
) -> RecordedCampaign:
    """Read runs of one rig; ConfigurationError or LogError, naming the run, for what cannot be used.

    `looked_at` gives the setting of a run, by its number, as it is to be looked at.
    """
    twice = sorted({str(path) for path in paths if [p.resolve() for p in paths].count(path.resolve()) > 1})
    if twice:
        raise ConfigurationError("campaign", [Problem("runs", ", ".join(twice), "each run once")])
    runs = [_read(path) for path in paths]
    # a copy under another name would count as a second run
    for first, second in combinations(runs, 2):
        shared = first.records.keys() & second.records.keys()
        if shared and all(np.array_equal(first.records[name], second.records[name]) for name in shared):
            same = f"{first.path} and {second.path} hold the same samples"
            raise ConfigurationError("campaign", [Problem("runs", same, "each run once")])
    rigs = {run.twin.model.name: run.path.name for run in runs}
    if len(rigs) > 1:
        what = ", ".join(f"{path} is of the {rig}" for rig, path in rigs.items())
        raise ConfigurationError("campaign", [Problem("runs", what, "runs of one rig")])
    problems = [problem for run in runs[1:] for problem in _other_rig(runs[0], run)]
    if problems:
        raise ConfigurationError("campaign", problems)
    common = [name for name in runs[0].twin.channels if all(name in run.records for run in runs)]
    plain = [setting_of(run.twin, common, run.rate, run.cycles, run.step) for run in runs]
    settings = [looked_at(number, setting) for number, setting in enumerate(plain)]
    if not settings[0].columns.coupled:
        raise LogError(f"{paths[0]}: nothing but {', '.join(common)}; there is no response to compare")
    campaign = Campaign(tuple(settings))
    blocks = [setting.blocks_of(run.records, run.sound) for setting, run in zip(settings, runs, strict=True)]
    count = min(_MOST_BLOCKS, *(len(each) for each in blocks))
    parts = [[part.mean(axis=0) for part in np.array_split(each, count)] for each in blocks]
    measured = np.concatenate([np.array(each, dtype=np.float32) for each in parts], axis=1)
    remarks = []
    for run in runs:
        effects = run.twin.model.effects.values()
        refused = [(effect.name, effect.refusal(run.twin)) for effect in effects]
        not_looked = [f"{name} was not looked for ({reason})" for name, reason in refused if reason]
        remarks += [f"{run.path.name}: {remark}" for remark in (*run.remarks, *not_looked)]
    return RecordedCampaign(
        campaign,
        measured,
        tuple(remarks),
        scenarios=tuple(run.scenario.text for run in runs),
        records=tuple(run.records for run in runs),
        sound=tuple(run.sound for run in runs),
        chains=runs[0].record,
    )


def _other_rig(first: _Run, other: _Run) -> Iterator[Problem]:
    """Keys of [model] in which two runs differ though no lab sets them between runs."""
    set_up = RIGS[first.scenario.rig].set_up
    for key in RIGS[first.scenario.rig].model:
        one, two = (run.scenario.model.get(key) for run in (first, other))
        if one != two and key not in set_up:
            told = ["default" if value is None else str(value) for value in (one, two)]
            what = f"{told[0]} in {first.path.name}, {told[1]} in {other.path.name}"
            yield Problem(f"model.{key}", what, f"runs of one rig ({', '.join(set_up)} may differ)")


@dataclass(frozen=True, slots=True)
class AloneRun:
    """A run at its scenario's own frequency: nothing in `campaign` hangs on what was measured.

    `measured` are its fingerprints (blocks, numbers), `left_out` channels of which nothing is in them.
    """

    scenario: Scenario
    campaign: Campaign
    measured: NDArray[np.float32]
    remarks: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def recorded_alone(path: Path, longest_s: float) -> AloneRun:
    """The first seconds of a run; ConfigurationError or LogError for what cannot be used."""
    run = _read(path, longest_s)
    hertz = run.scenario.drive.cycle_hz
    twin = replace(run.twin, drive=run.twin.drive.at_cycle_hz(hertz))
    # wherever in its first cycle a run begins
    whole = min(
        run.cycles, max(int(min(run.scenario.acquisition.duration, longest_s) * hertz) - 3, _FEWEST_CYCLES)
    )
    names = [name for name in twin.channels if name in run.records]
    setting = setting_of(twin, names, run.rate, whole, run.step)
    if not setting.columns.coupled:
        raise LogError(f"nothing but {', '.join(names)}; there is no response to compare")
    sound = run.sound
    if run.scenario.acquisition.settle < setting.settle:  # nor has a simulated motion its start in it
        sound = sound & (np.arange(len(sound)) >= _SETTLED_S * run.rate)
    blocks = setting.blocks_of(run.records, sound)
    if not len(blocks):
        raise LogError(f"less than {setting.cycles} sound cycles together, once the motion has set in")
    return AloneRun(run.scenario, Campaign((setting,)), blocks, run.remarks, run.left_out)


def _read(path: Path, longest_s: float | None = None) -> _Run:
    with LogReader(path) as log:
        scenario = followed_scenario(log)
        channels = log.channels("measured")
        twin = logged_twin(log, scenario)
        model = twin.model
        if model.reference not in channels:
            raise LogError(f"{path}: no {model.reference}; without it nobody knows the phase of a cycle")
        wanted = [name for name in twin.channels if name in channels]
        for name in wanted:
            unit = model.channel_unit(name)
            if channels[name].unit != unit:
                raise LogError(f"{path}: {name} is in {channels[name].unit}, the twin's in {unit}")
        ends = [end_s for end_s in (log.until_stop_s, longest_s) if end_s is not None]
        record = log.metadata.get("run", NOTHING)
        lost = lost_of(log, wanted, min(ends, default=None))
        unfinished = []
        if longest_s is not None:
            whole_s = log.until_stop_s or log.end_s("measured", model.reference)
            if whole_s > longest_s:
                unfinished.append(f"only the first {longest_s:g} s of {whole_s:.4g} s were looked at")
        if log.until_stop_s is not None:
            unfinished.append(
                f"stopped before its time, after {log.until_stop_s:.3g} s; the rest is not used"
            )
        if not log.complete:
            reason = f" ({log.damage})" if log.damage else ""
            unfinished += [f"the log was never finished, or cut{reason}; its whole blocks are used"]
    table, sound, losses = usable(path, lost, model.reference)
    step, records, kept = _resampled(path, table, sound, twin)
    rate = table[model.reference].sample_rate / step
    cycles = _cycles(path, twin, records[model.reference], rate)
    drive = twin.drive.at_cycle_hz(cycles.frequency)
    # each with the half of the next that is looked at with it
    reach = cycles.length + cycles.length // 2
    whole = sum(bool(kept[at : at + reach].all()) for at in cycles.starts(len(kept)))
    if whole < _FEWEST_CYCLES:
        raise _too_few(path, whole)
    remarks = (*unfinished, *losses, *_remarks(twin, channels, table, records))
    left_out = tuple(name for name in wanted if name not in table)
    followed = replace(twin, drive=drive)
    return _Run(path, followed, records, kept, rate, step, whole, remarks, left_out, scenario, record)


def _too_few(path: Path, whole: int) -> LogError:
    return LogError(f"{path}: {whole} sound cycles; a diagnosis needs {_FEWEST_CYCLES} whole ones at least")


def _remarks(
    twin: AnyTwin,
    channels: Mapping[str, Channel],
    table: Mapping[str, SampleBlock],
    records: Mapping[str, Array],
) -> tuple[str, ...]:
    """What is lost of a run, and what of it contradicts its scenario."""
    remarks = [
        f"no {name}: what only it shows cannot be found" for name in twin.channels if name not in channels
    ]
    longest = max(series.end_sample for series in table.values())
    for name, series in table.items():
        if series.end_sample < (1 - _SHORTER) * longest:
            remarks.append(
                f"{name} ends after {series.end_sample / series.sample_rate:.3g} s; the rest is not used"
            )
    reference = twin.model.reference
    if reference in twin.model.smooth(twin.rig):
        shown = float(np.sqrt(2) * np.std(records[reference]))
        if abs(shown / twin.drive.amplitude - 1) > _OTHER_AMPLITUDE:
            remarks.append(
                f"{reference} has an amplitude of {shown:.3g}, in the scenario {twin.drive.amplitude:g}: "
                "either its sensor is wrong, which can be found, or the scenario"
            )
    return tuple(remarks)


def _cycles(path: Path, twin: AnyTwin, reference: Array, rate: float) -> Cycles:
    """The measured cycles; raises LogError where they are not the scenario's."""
    model = twin.model
    nominal = twin.drive.cycle_hz
    if rate / nominal < _FEWEST_SAMPLES:
        raise LogError(f"{path}: {rate / nominal:.3g} samples a cycle; a diagnosis needs {_FEWEST_SAMPLES}")
    if len(reference) * nominal / rate < _FEWEST_CYCLES:
        raise _too_few(path, int(len(reference) * nominal / rate))
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
    return cycles


def _resampled(
    path: Path, table: dict[str, SampleBlock], sound: NDArray[np.bool_], twin: AnyTwin
) -> tuple[int, dict[str, Array], NDArray[np.bool_]]:
    """How many samples become one; records at about 25.6 kHz, by the filter of the simulated ones."""
    rates = {series.sample_rate for series in table.values()}
    if len(rates) > 1:
        told = ", ".join(f"{rate:g} Hz" for rate in sorted(rates))
        raise LogError(f"{path}: channels of different rates ({told}) cannot be compared")
    rate = rates.pop()
    step = max(1, round(rate / _RATE))
    first, end = span(table)
    count = (end - first) // step
    records: dict[str, Array] = {}
    for name, series in table.items():
        values = series.values[first - series.first_sample : end - series.first_sample]
        known = np.isfinite(values)
        filled = np.where(known, np.asarray(values, dtype=np.float64), 0.0)
        if known.any():  # straight lines over what is missing, so that filters and angles stay on course
            at = np.arange(len(values))
            filled[~known] = np.interp(at[~known], at[known], filled[known])
        if step == 1 or isinstance(twin.sensors.get(name), Encoder):
            records[name] = filled[: count * step : step]
            continue
        taps = anti_alias_taps(step, 0.0)
        half = len(taps) // 2
        records[name] = decimated(np.pad(filled, (half, half + step)), taps, step, count)
    return step, records, np.all(sound[: count * step].reshape(count, step), axis=1)


def setting_of(twin: AnyTwin, channels: Sequence[str], rate: float, whole: int, step: int = 1) -> RunSetting:
    """How a run of so many `whole` cycles is looked at, at `rate` Hz."""
    model = twin.model
    frequency = twin.drive.cycle_hz
    coupled = tuple(
        name for name in channels if model.channel_unit(name) in _COUPLED and name != model.reference
    )
    cycles = min(max(_BLOCK_CYCLES, round(_BLOCK_S * frequency)), whole // 2)
    oversampling = 2 * max(1, round(model.fine_rate / rate / 2))
    angles = tuple(name for name in channels if isinstance(twin.sensors.get(name), Encoder))
    columns = Columns(tuple(channels), coupled, frequency, rate, angles)
    # the share of white noise's rms that the filter before a decimation leaves
    quiet = 1.0 if step == 1 else float(np.sqrt(np.sum(anti_alias_taps(step, 0.0) ** 2)))
    return RunSetting(twin, columns, oversampling, cycles, quiet)

"""Recorded runs as a campaign: what was measured, cut into blocks of cycles, and what was lost of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import ceil, pi, tau
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import NS_PER_S, Flag, SampleBlock
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
from sim_twin.rigs.channel_table import ENCODER_ANGLE, Role
from sim_twin.rigs.cycles import FOLLOWS, Cycles
from sim_twin.sensors import Encoder, SensorChain, anti_alias_taps
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


def work_of(what: str, campaign: Campaign, draws: Iterable[int]) -> Work:
    """Work in which all runs of a campaign are simulated for draws of so many blocks each, in s of motion."""
    motion_s = sum(
        often * run.motion_s(blocks) for blocks, often in Counter(draws).items() for run in campaign.runs
    )
    return Work(f"{what} {campaign.runs[0].twin.model.name} on {cores()}", motion_s)


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


class RunUnusable(LogError):
    """A run that cannot be read or tells nothing, `why` in words; others of its rig may stand in for it."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: {why}")
        self.name, self.why = path.name, why


def usable(lost: Mapping[str, Lossy]) -> tuple[dict[str, Lossy], tuple[str, ...]]:
    """The channels that can be used, and what is lost; one that is lost for half of it is left out."""
    kept = {name: each for name, each in lost.items() if each.lost.mean() < _MOSTLY}
    remarks = [
        f"{name} is not used: {each.lost.mean():.0%} of it {' and '.join(each.why)}"
        for name, each in lost.items()
        if name not in kept
    ]
    alike: dict[str, list[str]] = {}
    for name, each in kept.items():
        if each.lost.any():
            alike.setdefault(f"{each.lost.mean():.1%} {' and '.join(each.why)}", []).append(name)
    for what, names in alike.items():
        whose = "all channels" if len(names) == len(kept) else ", ".join(names)
        remarks.append(f"{whose}: {what}; left out, in all channels")
    return kept, tuple(remarks)


Array = NDArray[np.floating]
_RATE = 25_600.0
_BLOCK_S, _BLOCK_CYCLES = 1.8, 8
_FEWEST_CYCLES = 2
"""With the half of the next one that is looked at with each: three whole cycles have so many."""
_FEWEST_JUDGED = 10
"""For a verdict on one run."""
_FEWEST_BLOCKS = 2
_FEWEST_SAMPLES = 64
_SLIPPED = 0.04
"""Share of its speed by which a motor without a controller is followed; more is another scenario."""
_SLOWEST = 0.5
"""Of the fastest channel's rate: what is slower has too little in common with it."""
_SHORTER = 0.01
_OTHER_AMPLITUDE = 0.05
_SAME_INSTANT = 0.01
"""Of a sample: times are kept in whole ns."""
_REACH, _KAISER, _PARTS = 32, 8.0, 1024
"""Of the kernel between samples: how many to each side, the window's shape, parts of a sample."""
_SETTLED_S = 1.0
"""What a run from rest shows of how the motion sets in."""
_COUPLED = {"N", "m/s2"}


@dataclass(frozen=True, slots=True)
class RecordedCampaign:
    """A campaign with its `measured` fingerprints (blocks, numbers); `remarks` say what was lost or odd.

    `paths` are the runs that are used, `scenarios` their scenario texts, `records` their channels at the rate
    of the setting, `sound` says which samples of a run can be used. `chains` is what the first log says of
    its chains, `specimen` what they say was run. Every row of `measured` has a block of each run, those of a
    short run several times; `told` is how many blocks of each run that is worth.
    """

    campaign: Campaign
    measured: NDArray[np.float32]
    told: tuple[float, ...]
    paths: tuple[Path, ...]
    remarks: tuple[str, ...]
    scenarios: tuple[str, ...]
    records: tuple[dict[str, Array], ...]
    sound: tuple[NDArray[np.bool_], ...]
    chains: Mapping[str, str]
    specimen: str | None


@dataclass(frozen=True, slots=True)
class _Run:
    path: Path
    twin: AnyTwin
    records: dict[str, Array]
    sound: NDArray[np.bool_]
    setting: RunSetting
    cycles: int
    slip: float
    remarks: tuple[str, ...]
    left_out: tuple[str, ...]
    scenario: Scenario
    record: Mapping[str, str]
    begin_ns: int


def recorded(
    paths: Sequence[Path], looked_at: Callable[[Path, RunSetting], RunSetting] = lambda _, setting: setting
) -> RecordedCampaign:
    """Read runs of one rig; ConfigurationError or LogError, naming the run, for what cannot be used.

    A run that cannot be read, or tells nothing, is left out with a remark where another can stand in for it.
    Their order is that in which they were made, however they are named: what is drawn for one stays the same
    when one that was made later joins them.

    `looked_at` gives the setting of a run, by its path, as it is to be looked at.
    """
    twice = sorted({str(path) for path in paths if [p.resolve() for p in paths].count(path.resolve()) > 1})
    if twice:
        raise ConfigurationError("campaign", [Problem("runs", ", ".join(twice), "each run once")])
    runs, unusable = list[_Run](), list[RunUnusable]()
    for path in paths:
        try:
            runs.append(_read(path))
        except RunUnusable as error:
            unusable.append(error)
        except (ConfigurationError, LogError) as error:
            if len(paths) == 1 or not path.is_file():  # told as it came; a path that is none was mistyped
                raise
            unusable.append(RunUnusable(path, _why(path, error)))
    if not runs:
        raise LogError("; ".join(map(str, unusable)))
    runs.sort(key=lambda run: run.begin_ns)
    # a copy under another name would count as a second run
    for first, second in combinations(runs, 2):
        shared = first.records.keys() & second.records.keys()
        if shared and all(np.array_equal(first.records[name], second.records[name]) for name in shared):
            same = f"{first.path} and {second.path} hold the same samples"
            raise ConfigurationError("campaign", [Problem("runs", same, "each run once")])
    _require_one_rig(runs)
    settings = [looked_at(run.path, run.setting) for run in runs]
    blocks = [setting.blocks_of(run.records, run.sound) for setting, run in zip(settings, runs, strict=True)]
    count = max(map(len, blocks))
    rows = [_rows(len(each), count) for each in blocks]
    remarks = [f"{error.name} is left out: {error.why}" for error in unusable]
    for run in runs:
        remarks += [f"{run.path.name}: {remark}" for remark in run.remarks]
    return RecordedCampaign(
        Campaign(tuple(settings)),
        np.concatenate([each[at] for each, at in zip(blocks, rows, strict=True)], axis=1),
        told=tuple(count**2 / float(np.sum(np.bincount(at) ** 2)) for at in rows),
        paths=tuple(run.path for run in runs),
        remarks=tuple(remarks),
        scenarios=tuple(run.scenario.text for run in runs),
        records=tuple(run.records for run in runs),
        sound=tuple(run.sound for run in runs),
        chains=runs[0].record,
        specimen=runs[0].scenario.specimen,
    )


def _why(path: Path, error: LogError | ConfigurationError) -> str:
    """In one line what keeps a run from being read."""
    if isinstance(error, ConfigurationError):
        return f"what it says of its rig cannot be used: {'; '.join(map(str, error.problems))}"
    return str(error).removeprefix(f"{path}: ")


def _rows(blocks: int, count: int) -> NDArray[np.intp]:
    """Which of some blocks stand in `count` rows, evenly, and none in both of `judging.halves`."""
    rows = np.zeros(count, dtype=np.intp)
    if blocks > 1:
        for turn in range(min(count, 2)):
            own, room = np.arange(turn, blocks, 2), rows[turn::2]
            room[:] = own[np.arange(len(room)) * len(own) // len(room)]
    return rows


def _require_one_rig(runs: Sequence[_Run]) -> None:
    rigs = {run.twin.model.name: run.path.name for run in runs}
    if len(rigs) > 1:
        what = ", ".join(f"{path} is of the {rig}" for rig, path in rigs.items())
        raise ConfigurationError("campaign", [Problem("runs", what, "runs of one rig")])
    specimens = {run.scenario.specimen or "none that is named": run.path.name for run in runs}
    if len(specimens) > 1:
        what = ", ".join(f"{path} is of {specimen}" for specimen, path in specimens.items())
        raise ConfigurationError("campaign", [Problem("notes.specimen", what, "runs of one rig")])
    problems = [problem for run in runs[1:] for problem in _other_rig(runs[0], run)]
    if problems:
        raise ConfigurationError("campaign", problems)


def _other_rig(first: _Run, other: _Run) -> Iterator[Problem]:
    """Keys of [model] in which two runs differ though no lab sets them between runs."""
    set_up = RIGS[first.scenario.rig].set_up
    for key in RIGS[first.scenario.rig].model:
        one, two = (run.scenario.model.get(key) for run in (first, other))
        if one != two and key not in set_up:
            told = ["default" if value is None else str(value) for value in (one, two)]
            what = f"{told[0]} in {first.path.name}, {told[1]} in {other.path.name}"
            yield Problem(f"model.{key}", what, f"runs of one rig ({', '.join(set_up)} may differ)")
    widths, besides = (
        tuple(getattr(run.scenario, of) for run in (first, other)) for of in ("widths", "besides")
    )
    if widths[0] != widths[1] or besides[0] != besides[1]:
        what = f"others in {first.path.name} than in {other.path.name}"
        yield Problem("tolerances", what, "the same, of runs of one rig")


@dataclass(frozen=True, slots=True)
class AloneRun:
    """A run at its scenario's own frequency: nothing in `campaign` hangs on what was measured.

    `measured` are its fingerprints (blocks, numbers), `left_out` channels of which nothing is in them. A
    healthy rig is looked at for `blocks`, as long as a whole run of the scenario: in a longer one it has more
    of what it seldom does.
    """

    scenario: Scenario
    campaign: Campaign
    measured: NDArray[np.float32]
    remarks: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    blocks: int = _FEWEST_BLOCKS


def recorded_alone(path: Path, longest_s: float) -> AloneRun:
    """The first seconds of a run; ConfigurationError or LogError for what cannot be used."""
    run = _read(path, longest_s)
    if abs(run.slip) > FREQUENCY_TOLERANCE:
        raise LogError(f"its mean speed is {_told_slip(run.slip)}, and a verdict holds for that one")
    whole = run.cycles
    if whole < _FEWEST_JUDGED:
        raise LogError(f"{whole} sound cycles; a verdict needs {_FEWEST_JUDGED} at least: record longer")
    hertz = run.scenario.drive.cycle_hz
    twin = replace(run.twin, drive=run.twin.drive.at_cycle_hz(hertz))
    # wherever in its first cycle a run begins
    longest = max(int(min(run.scenario.acquisition.duration, longest_s) * hertz) - 3, _FEWEST_JUDGED)
    whole = min(whole, longest)
    followed = run.setting
    setting = setting_of(
        twin, followed.columns.channels, followed.columns.rate, whole, followed.quiet, followed.reference
    )
    sound = run.sound
    if run.scenario.acquisition.settle < setting.settle:  # nor has a simulated motion its start in it
        sound = sound & (np.arange(len(sound)) >= _SETTLED_S * setting.columns.rate)
    blocks = setting.blocks_of(run.records, sound)
    if not len(blocks):
        raise LogError(
            f"less than {setting.cycles} sound cycles together, once the motion has set in: record longer"
        )
    looked_at = max(longest // setting.cycles, _FEWEST_BLOCKS)
    while looked_at >= 2 * max(len(blocks), _FEWEST_BLOCKS):  # of a run that was cut, healthy rigs as short
        looked_at //= 2
    return AloneRun(run.scenario, Campaign((setting,)), blocks, run.remarks, run.left_out, looked_at)


def _read(path: Path, longest_s: float | None = None) -> _Run:
    with LogReader(path) as log:
        scenario = followed_scenario(log)
        channels = log.channels("measured")
        twin = logged_twin(log, scenario)
        model = twin.model
        there = [name for name in twin.channels if name in channels]
        foreign = {
            name: f"{name} is in {channels[name].unit}, the twin's in {model.channel_unit(name)}"
            for name in there
            if channels[name].unit != model.channel_unit(name)
        }
        wanted = [name for name in there if name not in foreign]
        ends = [end_s for end_s in (log.until_stop_s, longest_s) if end_s is not None]
        record = log.metadata.get("run", NOTHING)
        lost = lost_of(log, wanted, min(ends, default=None))
        beside = twin.sensors.get(ENCODER_ANGLE.name)
        if model.reference not in wanted and isinstance(beside, Encoder) and ENCODER_ANGLE.name in channels:
            sent = lost_of(log, [ENCODER_ANGLE.name], min(ends, default=None))
            lost[model.reference] = _turned(sent[ENCODER_ANGLE.name], beside)
        unfinished = _unfinished(log, wanted, longest_s)
    kept, losses = usable(lost)
    reference = _reference(path, twin, wanted, lost, kept, foreign)
    grid = _resampled(kept, twin, reference)
    rate, records, sound = grid.rate, grid.records, grid.sound
    cycles = _cycles(path, twin, reference, records[reference], rate)
    slip = cycles.frequency / twin.drive.cycle_hz - 1
    followed = replace(twin, drive=twin.drive.at_cycle_hz(cycles.frequency))
    # each with the half of the next that is looked at with it
    reach = cycles.length + cycles.length // 2
    whole = sum(bool(sound[at : at + reach].all()) for at in cycles.starts(len(sound)))
    if whole < _FEWEST_CYCLES:
        raise _too_few(path, whole)
    # of a mark on a counter there is when it comes, by which the cycles are cut, and nothing to compare
    marks = [name for name in wanted if _counts_edges(twin, name)]
    names = [name for name in wanted if name in records and name not in marks]
    setting = setting_of(followed, names, rate, whole, grid.quiet, reference)
    if not setting.columns.coupled:
        raise RunUnusable(path, f"nothing but {', '.join(names)}; there is no response to compare")
    odd = [f"{each}: it is not used" for each in foreign.values()]
    odd += [f"{name} is not used: its rate is too far below that of the others" for name in grid.slow]
    if reference != model.reference or reference not in wanted:
        told_by = reference if reference in wanted else ENCODER_ANGLE.name
        odd.append(f"{told_by} tells the cycles in place of {model.reference}")
    if abs(slip) > FREQUENCY_TOLERANCE:
        odd.append(f"its mean speed is {_told_slip(slip)}; the twin runs as fast as the rig did")
    remarks = (*unfinished, *losses, *odd, *_remarks(twin, channels, kept, records, reference))
    left_out = tuple(name for name in there if name not in (*names, *marks))
    return _Run(
        path, followed, records, sound, setting, whole, slip, remarks, left_out, scenario, record,
        grid.begin_ns,
    )  # fmt: skip


def _unfinished(log: LogReader, wanted: Sequence[str], longest_s: float | None) -> list[str]:
    """What of a log is not looked at."""
    found = []
    if longest_s is not None:
        whole_s = log.until_stop_s or (log.end_s("measured", wanted[0]) if wanted else 0.0)
        if whole_s > longest_s:
            found.append(f"only the first {longest_s:g} s of {whole_s:.4g} s were looked at")
    if log.until_stop_s is not None:
        found.append(f"stopped before its time, after {log.until_stop_s:.3g} s; the rest is not used")
    if not log.complete:
        reason = f" ({log.damage})" if log.damage else ""
        found.append(f"the log was never finished, or cut{reason}; its whole blocks are used")
    return found


def _reference(
    path: Path,
    twin: AnyTwin,
    measured: Sequence[str],
    lost: Mapping[str, Lossy],
    kept: Mapping[str, Lossy],
    foreign: Mapping[str, str],
) -> str:
    """The best channel that tells the cycles; what stands for one that was not measured comes last.

    `foreign` says of channels what keeps them from being used.
    """
    model = twin.model
    names = [model.reference, *model.channels.with_role(*FOLLOWS)]
    for name in sorted(names, key=lambda each: each not in measured):
        if name in kept:
            return name
    if not measured:
        raise RunUnusable(path, "; ".join(foreign.values()) or "nothing was measured")
    if model.reference not in lost:
        why = foreign.get(model.reference, f"no {model.reference}")
        raise RunUnusable(path, f"{why}; without it nobody knows the phase of a cycle")
    each = lost[model.reference]
    raise RunUnusable(
        path,
        f"{each.lost.mean():.0%} of {model.reference} {' and '.join(each.why)}; "
        "without it nobody knows the phase of a cycle",
    )


def _turned(sent: Lossy, encoder: Encoder) -> Lossy:
    """The crank's angle by what an encoder beside the card sent: on average half a count less."""
    own = np.asarray(sent.series.values, dtype=np.float64) + pi / encoder.counts
    return replace(
        sent, series=replace(sent.series, values=encoder.zero + (-own if encoder.backwards else own))
    )


def _told_slip(slip: float) -> str:
    return f"{abs(slip):.2%} {'above' if slip > 0 else 'below'} the scenario's"


def _too_few(path: Path, whole: int) -> RunUnusable:
    return RunUnusable(
        path,
        f"too short: {whole} sound cycles with half of the next one behind them; a diagnosis needs "
        f"{_FEWEST_CYCLES}, so three whole cycles in a row",
    )


def _remarks(
    twin: AnyTwin,
    channels: Mapping[str, Channel],
    table: Mapping[str, Lossy],
    records: Mapping[str, Array],
    reference: str,
) -> tuple[str, ...]:
    """What is lost of a run, and what of it contradicts its scenario."""
    remarks = [
        f"no {name}: what only it shows cannot be found" for name in twin.channels if name not in channels
    ]
    ends = {name: each.series.end_sample / each.series.sample_rate for name, each in table.items()}
    remarks += [
        f"{name} ends after {end_s:.3g} s; the rest is not used"
        for name, end_s in ends.items()
        if end_s < (1 - _SHORTER) * max(ends.values())
    ]
    if reference in twin.model.smooth(twin.rig):
        shown = float(np.sqrt(2) * np.std(records[reference]))
        if abs(shown / twin.drive.amplitude - 1) > _OTHER_AMPLITUDE:
            remarks.append(
                f"{reference} has an amplitude of {shown:.3g}, in the scenario {twin.drive.amplitude:g}: "
                "either its sensor is wrong, which can be found, or the scenario"
            )
    return tuple(remarks)


def _cycles(path: Path, twin: AnyTwin, reference: str, values: Array, rate: float) -> Cycles:
    """The measured cycles; raises RunUnusable where they are not the scenario's."""
    model = twin.model
    nominal = twin.drive.cycle_hz
    if rate / nominal < _FEWEST_SAMPLES:
        raise RunUnusable(path, f"{rate / nominal:.3g} samples a cycle; a diagnosis needs {_FEWEST_SAMPLES}")
    if len(values) * nominal / rate < _FEWEST_CYCLES + 0.5:
        raise _too_few(path, max(0, int(len(values) * nominal / rate - 0.5)))
    # a motor may slip, a generator does not
    tolerance = FREQUENCY_TOLERANCE if model.channels[reference].role is Role.DRIVE else _SLIPPED
    wrong = (
        f"{reference} does not run at the scenario's {nominal:g} Hz within "
        f"{100 * tolerance:g} %; correct the scenario, or the channel"
    )
    try:
        cycles = model.followed(reference)(values, rate, nominal)
    except ValueError as error:
        raise RunUnusable(path, f"{wrong} ({error})") from error
    if abs(cycles.frequency / nominal - 1) > tolerance:
        raise RunUnusable(path, f"{wrong} (it runs at {cycles.frequency:.6g} Hz)")
    return cycles


@dataclass(frozen=True, slots=True)
class _OnGrid:
    """All channels of a run at one `rate`; `quiet` is the share of each one's noise that is left.

    `slow` are those that have too low a rate of their own, `begin_ns` is the time of the first sample.
    """

    rate: float
    records: dict[str, Array]
    sound: NDArray[np.bool_]
    quiet: dict[str, float]
    slow: tuple[str, ...]
    begin_ns: int


def _resampled(table: Mapping[str, Lossy], twin: AnyTwin, reference: str) -> _OnGrid:
    """Records at about 25.6 kHz by the filter of the simulated ones, or at the lowest rate near that."""
    steps = {name: max(1, round(each.series.sample_rate / _RATE)) for name, each in table.items()}
    rates = {name: each.series.sample_rate / steps[name] for name, each in table.items()}
    angles = {name for name in table if isinstance(twin.sensors.get(name), Encoder)} | {reference}
    analog = {name: rate for name, rate in rates.items() if name not in angles} or rates
    slow = tuple(name for name, rate in analog.items() if rate < _SLOWEST * max(analog.values()))
    rate = min(rate for name, rate in analog.items() if name not in slow)
    kept = {name: each for name, each in table.items() if name not in slow}
    begin_ns = max(each.series.time_ns for each in kept.values())
    begins = {name: _sample_at(each.series, begin_ns) for name, each in kept.items()}
    count = min(
        int((len(each.series.values) - begins[name]) * rate / each.series.sample_rate + 1e-6)
        for name, each in kept.items()
    )
    count = max(count, 0)
    records, sound, quiet = dict[str, Array](), np.ones(count, dtype=bool), dict[str, float]()
    for name, each in kept.items():
        own = each.series.sample_rate
        at = begins[name] + own / rate * np.arange(count)
        lost = np.concatenate([[0], np.cumsum(each.lost)])
        first = np.floor(at + 1e-6).astype(np.intp)
        end = np.minimum(np.ceil(at + own / rate - 1e-6).astype(np.intp), len(each.lost))
        sound &= lost[np.maximum(end, first)] == lost[first]
        values, smooth = _filled(each), name in angles and not _low_passed(twin, name)
        if _counts_edges(twin, name):
            values, smooth = _held(values, ceil(own / rate)), True
        records[name], quiet[name] = _sampled(values, at, 1 if smooth else steps[name], own / rate, smooth)
    return _OnGrid(rate, records, sound, quiet, slow, begin_ns)


def _low_passed(twin: AnyTwin, name: str) -> bool:
    """Whether a filter is behind a sensor, whose noise does not stay as dense where samples are left out."""
    sensor = twin.sensors.get(name)
    stages = sensor.stages if isinstance(sensor, SensorChain) else None
    return stages is not None and stages.low_pass is not None


def _counts_edges(twin: AnyTwin, name: str) -> bool:
    sensor = twin.sensors.get(name)
    return isinstance(sensor, SensorChain) and sensor.edges is not None


def _held(pulses: NDArray[np.float64], step: int) -> NDArray[np.float64]:
    """Pulses of one sample, each for `step` of them: one of so many is looked at."""
    held = pulses.copy()
    for late in range(1, step):
        held[late:] = np.maximum(held[late:], pulses[:-late])
    return held


def _sample_at(series: SampleBlock, time_ns: int) -> float:
    """Which of its samples (fractional) was taken then; whole where that is meant."""
    at = (time_ns - series.time_ns) * series.sample_rate / NS_PER_S
    return float(round(at)) if abs(at - round(at)) < _SAME_INSTANT else at


def _filled(each: Lossy) -> NDArray[np.float64]:
    """Straight lines over what is missing, so that filters and angles stay on course."""
    values = np.asarray(each.series.values, dtype=np.float64)
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.where(known, values, 0.0)
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known]))


def _sampled(
    values: NDArray[np.float64], at: Array, step: int, apart: float, smooth: bool
) -> tuple[Array, float]:
    """Values at places (fractional samples) that are `apart`, and the share of white noise's rms in them."""
    whole = float(apart).is_integer() and float(at[0]).is_integer() if len(at) else True
    if whole and (smooth or apart == 1):
        return values[at.astype(np.intp)], 1.0
    if smooth:
        return np.asarray(np.interp(at, np.arange(len(values)), values)), 1.0
    step = round(apart) if whole else step
    taps, first = anti_alias_taps(step, 0.0), int(at[0])
    half = len(taps) // 2
    count = len(at) if whole else -(-(len(values) - first) // step)
    padded = np.pad(values[first:], (half, half + step))
    coarse = decimated(padded, taps, step, count) if step > 1 else values[first:]
    left = float(np.sqrt(np.sum(taps**2))) if step > 1 else 1.0
    if whole:
        return coarse, left
    share = min(1.0, step / apart)
    return _between(coarse, (at - first) / step, share), left * float(np.sqrt(share))


def _between(values: NDArray[np.float64], at: Array, cutoff: float) -> NDArray[np.float64]:
    """Values at fractional places of what is band-limited, without what is above `cutoff` (of half the rate).

    By a sinc under a Kaiser window (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.5).
    """
    half = ceil(_REACH / cutoff)
    places = np.arange(1 - half, half + 1) - np.arange(_PARTS + 1)[:, None] / _PARTS
    window = np.i0(_KAISER * np.sqrt(np.clip(1 - (places / half) ** 2, 0.0, None))) / np.i0(_KAISER)
    kernels = np.ascontiguousarray((cutoff * np.sinc(cutoff * places) * window).T)
    first = np.floor(at).astype(np.intp)
    part = np.round((at - first) * _PARTS).astype(np.intp)
    padded = np.pad(values, (half - 1, half + 1), mode="edge")
    found = np.zeros(len(at))
    for k, kernel in enumerate(kernels):
        found += kernel[part] * padded[first + k]
    return found


def setting_of(
    twin: AnyTwin,
    channels: Sequence[str],
    rate: float,
    whole: int,
    quiet: Mapping[str, float] = NOTHING,
    reference: str = "",
) -> RunSetting:
    """How a run of so many `whole` cycles is looked at, at `rate` Hz; see `RunSetting`."""
    model = twin.model
    frequency = twin.drive.cycle_hz
    coupled = tuple(
        name for name in channels if model.channel_unit(name) in _COUPLED and name != model.reference
    )
    cycles = min(max(_BLOCK_CYCLES, round(_BLOCK_S * frequency)), whole // 2)
    oversampling = 2 * max(1, round(model.fine_rate / rate / 2))
    angles = tuple(name for name in channels if isinstance(twin.sensors.get(name), Encoder))
    driven = model.channels.drive
    by_mark = (reference or model.reference) == model.channels.marker
    begins = getattr(twin.rig, "marker_angle", 0.0) / tau if by_mark else 0.0
    columns = Columns(tuple(channels), coupled, frequency, rate, angles, driven, begins)
    return RunSetting(twin, columns, oversampling, cycles, dict(quiet), reference)

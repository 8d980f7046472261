"""Samples of a log as a surrogate learns from them, and what a surrogate says beside a log."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock, as_logged, sample_time_ns
from daq.errors import LogError
from daq.log.reader import LogReader
from rig.files.scenario import Scenario
from rig.twin.logged import followed_scenario
from rig.twin.prediction import BLOCK_S
from rig.twin.scenario_twin import twin_of
from sim_twin.decimation import decimated
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, ANGLE
from sim_twin.rigs.planar_slider_crank.model import MATERIALS
from sim_twin.sensors import anti_alias_taps
from sim_twin.surrogates.samples import COLUMNS, SETTINGS, Samples

if TYPE_CHECKING:
    from sim_twin.surrogates.surrogate import Surrogate

Array = NDArray[np.float64]
RIG = "planar_slider_crank"
"""The one whose settings a surrogate knows."""


def samples_of(log: LogReader, every: int = 1) -> Samples:
    """Its samples before a stop of the run, where all of them are known, at a rate so many times lower.

    At a lower rate they are filtered, and begin and end where the filter lies wholly in the record. Raises
    LogError where it is no run of the planar slider-crank, or lacks a channel.
    """
    scenario = learnable(log)
    table = log.table("measured", (*ACCELERATIONS, ANGLE), end_s=log.until_stop_s)
    if len({each.sample_rate for each in table.values()}) > 1:
        raise LogError(f"{log.path}: channels of different rates cannot be learnt together")
    first = max(each.first_sample for each in table.values())
    end = min(each.end_sample for each in table.values())
    rows = {}
    for name, each in table.items():
        rows[name] = np.asarray(each.values[first - each.first_sample : end - each.first_sample], np.float64)
        if not np.isfinite(rows[name]).any():
            raise LogError(f"{log.path}: {name} has no value that is finite; nothing can be learnt from it")
    taps = np.ones(1) if every == 1 else anti_alias_taps(every, 0.0)
    half, count = len(taps) // 2, (end - first - len(taps)) // every + 1
    if count < 1:
        raise LogError(f"{log.path}: {end - first} samples are too few to learn from")
    rate = table[ANGLE].sample_rate
    speed = _mean_speed(rows[ANGLE], rate)
    for name, row in rows.items():
        at = row[half : half + count * every : every]
        rows[name] = at if every == 1 or name == ANGLE else decimated(row, taps, every, count)
    known = np.all([np.isfinite(row) for row in rows.values()], axis=0)
    times = (first + half + every * np.arange(count)) / rate
    inputs = asked(scenario, times[known], rows[ANGLE][known], speed)
    turns = np.floor(rows[ANGLE][known] / math.tau).astype(np.int64)
    outputs = np.array([rows[name][known] for name in ACCELERATIONS]).T
    return Samples(inputs, outputs, np.zeros(len(turns), np.int64), turns)


def _mean_speed(angle: Array, rate: float) -> float | None:
    """In rad/s, of an angle in rad where it is known; None where that is nowhere or once."""
    known = np.flatnonzero(np.isfinite(angle))
    if len(known) < 2:
        return None
    return float((angle[known[-1]] - angle[known[0]]) / (known[-1] - known[0]) * rate)


def learnable(log: LogReader) -> Scenario:
    """The scenario of a log that a surrogate can learn from or speak beside; raises LogError of another."""
    scenario = followed_scenario(log)
    if scenario.rig != RIG:
        raise LogError(f"{log.path}: a run of the {scenario.rig}; surrogates are of the {RIG} alone")
    lacking = [name for name in (*ACCELERATIONS, ANGLE) if name not in log.channels("measured")]
    if lacking:
        raise LogError(f"{log.path}: {', '.join(lacking)} not measured, which a surrogate goes by")
    return scenario


def asked(scenario: Scenario, times_s: Array, angles: Array, speed: float | None = None) -> Array:
    """What a surrogate takes for a scenario at times and crank angles (rad), shape (n, inputs).

    `speed` is the mean that was measured, in rad/s; None: the scenario's.
    """
    rig = twin_of(scenario).rig
    settings = {
        "speed": (scenario.drive.speed if speed is None else speed) * 60 / math.tau,
        "clearance_1": 1e3 * rig.clearance_1,
        "clearance_2": 1e3 * rig.clearance_2,
        "density": MATERIALS[str(scenario.model.get("material", "steel"))].density,
    }
    columns = {"time": times_s, "angle": angles}
    columns |= {name: np.full(len(angles), value) for name, value in settings.items()}
    return np.column_stack([columns[name] for name in COLUMNS])


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def each_once(logs: Sequence[Path], tell: Callable[[str], None]) -> dict[Path, str]:
    """The logs whose measured samples no earlier one has, each with a digest of these; `tell` of the others.

    A copy with predictions in it has the samples of its run. Raises LogError for what is no log.
    """
    found: dict[str, Path] = {}
    for path in logs:
        digest = hashlib.sha256()
        with LogReader(path) as log:
            for message in log.messages({f"/measured/{name}" for name in log.channels("measured")}):
                digest.update(message.topic.encode() + message.data)
        earlier = found.setdefault(digest.hexdigest(), path)
        if earlier is not path:
            tell(f"{path} has the measured samples of {earlier}; they count once")
    return {path: digest for digest, path in found.items()}


def beside(log: LogReader, surrogate: Surrogate) -> tuple[Iterator[SampleBlock], Mapping[str, str]]:
    """What `surrogate` says at every sample of the crank's angle, and what lies outside of what it learnt.

    Not a number where the angle is not known.
    """
    scenario = learnable(log)
    angle = log.series("measured", ANGLE, end_s=log.until_stop_s)
    rate, known = angle.sample_rate, np.flatnonzero(np.isfinite(angle.values))
    times, angles = (angle.first_sample + known) / rate, np.asarray(angle.values, np.float64)
    inputs = asked(scenario, times, angles[known], _mean_speed(angles, rate))
    told = beyond(surrogate, surrogate.outside(inputs) if len(inputs) else {})

    def blocks() -> Iterator[SampleBlock]:
        most = max(1, round(BLOCK_S * rate))
        for first in range(0, len(angle), most):
            count = min(most, len(angle) - first)
            here = slice(*np.searchsorted(known, (first, first + count)))
            values = np.full((len(surrogate.channels), count), np.nan)
            if here.stop > here.start:
                values[:, known[here] - first] = surrogate.predict(inputs[here]).T
            time_ns = sample_time_ns(angle.time_ns, first, rate)
            for name, row in zip(surrogate.channels, values, strict=True):
                yield SampleBlock(name, angle.first_sample + first, time_ns, rate, as_logged(name, row))

    return blocks(), told


def beyond(surrogate: Surrogate, outside: Mapping[str, tuple[float, float]]) -> dict[str, str]:
    """Inputs that lie outside of what was learnt, from the least to the largest, in words."""
    words = {}
    for name, (low, high) in outside.items():
        span = f"{low:.4g} to {high:.4g}" if high > low else f"{low:.4g}"
        words[name] = f"{name} {span} {COLUMNS[name]}, where it learnt {_learnt(surrogate, name)}"
    return words


def settings_words(surrogate: Surrogate) -> dict[str, str]:
    """The range of each setting that it learnt, in words."""
    return {name: f"{_learnt(surrogate, name)} {COLUMNS[name]}" for name in SETTINGS}


def _learnt(surrogate: Surrogate, name: str) -> str:
    low, high = surrogate.ranges[name]
    return f"{low:.4g}" if name in surrogate.features.constants else f"{low:.4g} to {high:.4g}"

"""What the record of a point comes to: figures by names that hold their unit."""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from math import nan
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from daq.log.reader import Origin
from rig.derived.settings import rings_s, role_of
from rig.files.scenario import Scenario
from rig.report.crank_figures import beside_turns, turns_of
from rig.report.record import RunRecord, read_run
from rig.report.summary import half_cycle_statistics
from rig.rigs import RIGS
from rig.session.frequency import OFF, UNKNOWN, FrequencyCheck
from sim_twin.rigs.channel_table import Role

Array = NDArray[np.floating]

HELD: Final = ("drive held [Hz]", "speed held [rpm]")
IMPACTS: Final = "impacts recorded"
A_CYCLE: Final = "impacts a cycle"
FIRST_MEAN, FIRST_SD = "impact initial peak mean", "impact initial peak sd"
PEAK_MEAN, PEAK_SD = "impact peak mean", "impact peak sd"
RMS, LARGEST, SMALLEST = "rms", "peak", "smallest peak at its angle"
"""Of a channel; see `figure_of`."""
PREDICTED: Final = "predicted "
"""Begins the names of figures that are the twin's."""
WHOSE: Final[tuple[tuple[Origin, str], ...]] = (("measured", ""), ("predicted", PREDICTED))
NEAR_DEG: Final = 15.0
"""About the same angle."""
_FAILS = {OFF, UNKNOWN, "drive.not_seen", "motor.off_speed", "motor.limit"}
"""Codes of events that say of a complete record that its drive was not as asked for."""


def figure_of(channel: str, what: str, unit: str) -> str:
    """The name of a channel's figure."""
    return f"{channel} {what} [{unit}]"


def channels_with(what: str, names: Iterable[str]) -> dict[str, str]:
    """The channels of which figures of these names are, as measured, and their units."""
    found = (re.fullmatch(rf"(?!{PREDICTED})(.+) {what} \[(.*)\]", name) for name in names)
    return {each[1]: each[2] for each in found if each is not None}


def outcome_of(log: Path, scenario: Scenario) -> tuple[str, dict[str, float]]:
    """Read a point's complete log once: why it is not what the sweep asked for, or nothing, and its figures.

    Those by names that hold the unit, none that is not finite: what the drive was held to, impacts on the
    rig's contact forces (elsewhere on the channel that shows most of them) with their initial and largest
    peaks in its unit, statistics of the peaks of half cycles where it has contact forces, rms and peak of
    each channel, and of each with impacts the smallest peak at the angle of the largest; all but the drive
    measured and predicted.
    """
    held = RIGS[scenario.rig].held_sine(scenario.drive)
    check = None if held is None else FrequencyCheck(*held)
    run = read_run(log, [] if check is None else [check])
    figures: dict[str, float] = {}
    if check is not None:
        figures[HELD[0]] = check.result().measured
    elif (speed := run.speeds.get("measured")) is not None and np.isfinite(speed.values).any():
        figures[HELD[1]] = float(speed.values[np.isfinite(speed.values)].astype(np.float64).mean())
    figures |= _impacts(run, scenario)
    for origin, whose in WHOSE:
        if (statistics := half_cycle_statistics(run, origin)) is not None:
            peaks = dataclasses.asdict(statistics)
            peaks = {"half_cycles": peaks.pop("count"), **peaks}
            figures |= {whose + name: value for name, value in peaks.items()}
    for origin, whose in WHOSE:
        for name in run.channels:
            if (tally := run.tallies.get((origin, name))) is not None:
                unit = run.channels[name].unit
                figures[whose + figure_of(name, RMS, unit)] = tally.rms
                figures[whose + figure_of(name, LARGEST, unit)] = tally.peak
        for name, smallest in _smallest(run, origin):
            figures[whose + figure_of(name, SMALLEST, run.channels[name].unit)] = smallest
    why = "; ".join(event.text for event in run.events if event.code in _FAILS)
    return why, {name: float(value) for name, value in figures.items() if math.isfinite(value)}


def _impacts(run: RunRecord, scenario: Scenario) -> dict[str, float]:
    """As measured, and as predicted where there is a prediction."""
    on = RIGS[scenario.rig].contacts
    if not on:
        seen = (impact.channel for impact in run.impacts if impact.origin == "measured")
        on = tuple(channel for channel, _ in Counter(seen).most_common(1))
    cycles = run.duration_s * scenario.drive.cycle_hz or nan
    found: dict[str, float] = {}
    for origin, whose in WHOSE:
        if not any((origin, channel) in run.traces for channel in on):
            continue
        at = [impact for impact in run.impacts if impact.origin == origin and impact.channel in on]
        found |= {whose + A_CYCLE: len(at) / cycles} | ({} if whose else {IMPACTS: len(at)})
        names = ((FIRST_MEAN, FIRST_SD), (PEAK_MEAN, PEAK_SD))
        peaks = ([each.first_peak for each in at], [each.peak for each in at])
        for (mean, deviation), values in zip(names, peaks, strict=True):
            if at:
                found |= {whose + mean: float(np.mean(values)), whose + deviation: float(np.std(values))}
    return found


def impacts_in(channel: str) -> bool:
    """Whether impacts are what a channel shows."""
    return role_of(channel) in (Role.CONTACT, Role.VIBRATION)


def _smallest(run: RunRecord, origin: Origin) -> Iterator[tuple[str, float]]:
    """Each channel of a crank with impacts and its `smallest_peak`, in its unit.

    None where nothing tells the angle, nor of a record that is longer than what is kept of its samples.
    """
    turns = turns_of(run, origin)
    if turns is not None and run.kept_s is None:
        for name, trace in beside_turns(run, origin, list(filter(impacts_in, run.channels))).items():
            yield name, smallest_peak(_size(name, trace.values), turns)


def _size(name: str, values: Array) -> Array:
    return np.abs(values) if rings_s(name) else values


def smallest_peak(values: Array, turns: Array) -> float:
    """The smallest peak of the other cycles at about the angle of the largest; NaN without another cycle.

    `values` and `turns` at each sample, (n,) and (m,), NaN where unknown. A cycle's peak is its largest value
    within 15 degrees of that angle; one that the record does not hold whole there has none. Source: Deck and
    Dubowsky, the lower line of figure 17 ("at approximately the same crank angle", whose width it leaves
    open); the upper one is the largest.
    """
    count = min(len(values), len(turns))
    values, turns = values[:count], turns[:count]
    known = np.isfinite(turns)
    seen = np.where(known & np.isfinite(values), values, -np.inf)
    if not np.isfinite(seen).any():
        return nan
    at = turns - turns[np.argmax(seen)]
    number, width = np.rint(at), NEAR_DEG / 360
    near = np.abs(at - number) <= width
    begins = np.flatnonzero(np.diff(number[near], prepend=nan) != 0)
    peaks, numbers = np.maximum.reduceat(values[near], begins), number[near][begins]
    first, last = at[known][[0, -1]]
    whole = (first <= numbers - width) & (numbers + width <= last)
    others = peaks[whole & (numbers != 0) & np.isfinite(peaks)]
    return float(others.min()) if len(others) else nan

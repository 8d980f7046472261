"""How the peaks of half cycles spread over a run, and how close twins come to it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.log.reader import Origin
from daq.log.records import LIMIT_WARNING
from daq.signals.impacts import HalfCycles, merged
from daq.signals.spectrum import Autospectrum, autospectrum, log_bands
from rig.report.record import ORIGINS, RunRecord, Trace


@dataclass(frozen=True, slots=True)
class HalfCycleStatistics:
    """Peaks over all half cycles of a run, in N: mean and standard deviation (NaN for a single one)."""

    count: int
    first_mean_n: float
    first_sd_n: float
    max_mean_n: float
    max_sd_n: float


def half_cycles_of(run: RunRecord, origin: Origin) -> HalfCycles | None:
    """Half cycles of one origin, from its impacts; None where the run lacks a contact force."""
    sides = dict(zip(run.roles.stops or (), (1, -1), strict=False))
    if not sides or any((origin, stop) not in run.traces for stop in sides):
        return None
    struck = [each for each in run.impacts if each.origin == origin and each.channel in sides]
    return merged(
        HalfCycles(
            side=np.array([sides[each.channel] for each in struck], np.intp),
            start=np.array([each.first_sample for each in struck], np.intp),
            first_n=np.array([each.first_peak for each in struck], np.float64),
            max_index=np.array([each.peak_sample for each in struck], np.intp),
            max_n=np.array([each.peak for each in struck], np.float64),
            contacts=np.array([1 + each.bounces for each in struck], np.intp),
        )
    )


def half_cycle_statistics(run: RunRecord, origin: Origin) -> HalfCycleStatistics | None:
    """Of one origin; None where the run lacks a contact force, or an impact in it."""
    found = half_cycles_of(run, origin)
    if found is None or not len(found):
        return None
    first, largest = mean_and_deviation(found.first_n), mean_and_deviation(found.max_n)
    return HalfCycleStatistics(len(found), *first, *largest)


def mean_and_deviation(values: NDArray[np.floating]) -> tuple[float, float]:
    """Mean and standard deviation: NaN without a value, and of a single one."""
    return (
        float(values.mean()) if len(values) else math.nan,
        float(np.std(values, ddof=1)) if len(values) > 1 else math.nan,
    )


def as_json(run: RunRecord) -> dict[str, Any]:
    """What a run comes to, for another program; null where a number has no meaning."""

    def plain(value: float) -> float | None:
        return value if math.isfinite(value) else None

    def figures(name: str) -> dict[str, Any]:
        tallies = {origin: run.tallies[origin, name] for origin in ORIGINS if (origin, name) in run.tallies}
        return {
            origin: {"rms": plain(each.rms), "peak": plain(each.peak)} for origin, each in tallies.items()
        }

    statistics = {origin: half_cycle_statistics(run, origin) for origin in ORIGINS}
    return {
        "duration_s": run.duration_s,
        "channels": {name: {"unit": each.unit, **figures(name)} for name, each in run.channels.items()},
        "half_cycles": {
            origin: {key: plain(value) for key, value in asdict(each).items()}
            for origin, each in statistics.items()
            if each is not None
        },
        "verdict": None if run.verdict is None else asdict(run.verdict),
        "impacts": Counter(impact.origin for impact in run.impacts),
        "missing": run.missing,
        "overloaded_blocks": run.overloaded_blocks,
        "events": [asdict(event) for event in run.events if event.level != "info"],
    }


def warnings_passed(run: RunRecord) -> str:
    """How often warning levels were passed, and the first time in words; empty where none was."""
    told = [event.text for event in run.events if event.code == LIMIT_WARNING]
    return f"Warnings of limits: {len(told)}, the first {told[0]}" if told else ""


_BANDS = 42
"""Between 2 Hz and 25.6 kHz about a third of an octave each."""

_DEPTH_DB = 40.0
"""Only bands so far below a channel's strongest count: further down lies the sensor's noise."""


@dataclass(frozen=True, slots=True)
class Closeness:
    """Rms of the level differences in dB between autospectra of a channel.

    Of either twin to the measurement, and of the measurement's second half to its first: as far as chatter
    alone takes it.
    """

    channel: str
    nominal_db: float
    repaired_db: float
    halves_db: float


def closeness(run: RunRecord) -> list[Closeness]:
    """One for each channel that is compared; none without a nominal twin."""
    found = _distances(run, ("nominal", "predicted"))
    return [Closeness(name, nominal, repaired, halves) for name, (nominal, repaired), halves in found]


def distance_to(run: RunRecord, origin: Origin) -> tuple[float, float]:
    """How far an origin's autospectra lie from the measured ones, and their halves from another; dB.

    Rms over the channels that are compared; NaN without one.
    """
    rows = [(*apart_db, halves_db) for _, apart_db, halves_db in _distances(run, (origin,))]
    both = np.sqrt(np.mean(np.array(rows) ** 2, axis=0)) if rows else (math.nan, math.nan)
    return float(both[0]), float(both[1])


def _distances(run: RunRecord, origins: tuple[Origin, ...]) -> Iterator[tuple[str, tuple[float, ...], float]]:
    """Each channel with how far these origins lie from it as measured, and its halves from another; dB.

    But for angles, which grow for ever and so are all alike, and for what stands still.
    """
    for name, measured in ((name, run.traces.get(("measured", name))) for name in run.channels):
        traces = [run.traces.get((origin, name)) for origin in origins]
        others = [trace for trace in traces if trace is not None]
        if measured is None or len(others) < len(origins) or name in run.still | run.roles.unwrapped:
            continue
        spectrum, half = _banded(measured.values, measured), len(measured.values) // 2
        if (spectrum.density > 0).any():
            first, last = (
                _banded(part, measured) for part in (measured.values[:half], measured.values[half:])
            )
            floor = run.noise(name) ** 2 / (measured.sample_rate / 2)
            apart_db = tuple(distance_db(spectrum, _banded(each.values, each), floor) for each in others)
            yield name, apart_db, distance_db(first, last, floor)


def overall(channels: Sequence[Closeness]) -> Closeness:
    """Rms over channels."""
    rows = np.array([(each.nominal_db, each.repaired_db, each.halves_db) for each in channels])
    return Closeness("", *(float(value) for value in np.sqrt(np.mean(rows**2, axis=0))))


def distance_db(one: Autospectrum, other: Autospectrum, floor: float = 0.0) -> float:
    """Rms level difference over the bands of `one` within 40 dB of its strongest; 40 dB at most each.

    `floor` is the density of the sensor's noise: what both lies below it differs by nothing.
    """
    if not (one.density > 0).any():
        return 0.0
    depth = 10 ** (-_DEPTH_DB / 10)
    counted = one.density > depth * one.density.max()
    frequency, here = one.frequency_hz[counted], one.density[counted]
    there = np.interp(frequency, *other) if len(other.density) else np.zeros_like(here)
    here, there = here + floor, there + floor
    level = 10 * np.log10(here / np.maximum(there, depth * here))
    return float(np.sqrt(np.mean(np.minimum(np.abs(level), _DEPTH_DB) ** 2)))


def _banded(values: NDArray[np.floating], trace: Trace) -> Autospectrum:
    return log_bands(autospectrum(values, trace.sample_rate), _BANDS)

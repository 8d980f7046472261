"""How the peaks of half cycles spread over a run, and how close twins come to it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.log.reader import Origin
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
    """One for each channel that was measured and that moves in either twin; none without a nominal twin."""
    found: list[Closeness] = []
    for name in run.channels:
        measured, nominal = run.traces.get(("measured", name)), run.traces.get(("nominal", name))
        repaired = run.traces.get(("predicted", name))
        if measured is None or nominal is None or repaired is None:
            continue
        if not (nominal.values.any() or repaired.values.any()):  # a place that stands still in both twins
            continue
        spectrum, half = _banded(measured.values, measured), len(measured.values) // 2
        if (spectrum.density > 0).any():
            halves = (_banded(part, measured) for part in (measured.values[:half], measured.values[half:]))
            nominal_db = distance_db(spectrum, _banded(nominal.values, nominal))
            repaired_db = distance_db(spectrum, _banded(repaired.values, repaired))
            found.append(Closeness(name, nominal_db, repaired_db, distance_db(*halves)))
    return found


def distance_to(run: RunRecord, origin: Origin) -> tuple[float, float]:
    """How far an origin's autospectra lie from the measured ones, and their halves from another; dB.

    Rms over channels but angles; NaN without one.
    """
    found: list[tuple[float, float]] = []
    for name in run.measured:
        measured, other = run.traces.get(("measured", name)), run.traces.get((origin, name))
        if measured is None or other is None or name in run.roles.unwrapped:
            continue
        spectrum, half = _banded(measured.values, measured), len(measured.values) // 2
        if (spectrum.density > 0).any():
            halves = (_banded(part, measured) for part in (measured.values[:half], measured.values[half:]))
            found.append((distance_db(spectrum, _banded(other.values, other)), distance_db(*halves)))
    both = np.sqrt(np.mean(np.array(found) ** 2, axis=0)) if found else (math.nan, math.nan)
    return float(both[0]), float(both[1])


def overall(channels: Sequence[Closeness]) -> Closeness:
    """Rms over channels."""
    rows = np.array([(each.nominal_db, each.repaired_db, each.halves_db) for each in channels])
    return Closeness("", *(float(value) for value in np.sqrt(np.mean(rows**2, axis=0))))


def distance_db(one: Autospectrum, other: Autospectrum) -> float:
    """Rms level difference over the bands of `one` within 40 dB of its strongest; 40 dB at most each."""
    if not (one.density > 0).any():
        return 0.0
    depth = 10 ** (-_DEPTH_DB / 10)
    counted = one.density > depth * one.density.max()
    frequency, here = one.frequency_hz[counted], one.density[counted]
    there = np.interp(frequency, *other) if len(other.density) else np.zeros_like(here)
    level = 10 * np.log10(here / np.maximum(there, depth * here))
    return float(np.sqrt(np.mean(np.minimum(np.abs(level), _DEPTH_DB) ** 2)))


def _banded(values: NDArray[np.floating], trace: Trace) -> Autospectrum:
    return log_bands(autospectrum(values, trace.sample_rate), _BANDS)

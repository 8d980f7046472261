"""The numbers of a run: what the terminal shows at its end and the report at its top."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daq.log.reader import Origin
from daq.log.records import Gap
from daq.signals.impacts import HalfCycles, half_cycles
from rig.report.record import RunRecord, Tally, read_run


@dataclass(frozen=True, slots=True)
class TraceSummary:
    """One channel of one origin, in the channel's unit; NaN where no sample is finite.

    `missing` counts samples that never came, `overloaded_blocks` blocks that the device marked.
    """

    samples: int
    missing: int
    not_finite: int
    rms: float
    peak: float
    minimum: float
    maximum: float
    overloaded_blocks: int


@dataclass(frozen=True, slots=True)
class ChannelSummary:
    """A channel as measured and as predicted, where there is one; `nominal` beside a repaired twin."""

    name: str
    unit: str
    measured: TraceSummary | None
    predicted: TraceSummary | None
    nominal: TraceSummary | None


@dataclass(frozen=True, slots=True)
class HalfCycleStatistics:
    """Peaks over all half cycles of a run, in N: mean and standard deviation (NaN for a single one)."""

    count: int
    first_mean_n: float
    first_sd_n: float
    max_mean_n: float
    max_sd_n: float


@dataclass(frozen=True, slots=True)
class RunSummary:
    """What a run came to; the statistics are None where the run has no contact force with an impact in it."""

    log: Path
    run_id: str
    started: str
    scenario: str
    drive: str
    duration_s: float
    complete: bool
    channels: tuple[ChannelSummary, ...]
    measured_peaks: HalfCycleStatistics | None
    predicted_peaks: HalfCycleStatistics | None
    nominal_peaks: HalfCycleStatistics | None
    gaps: tuple[Gap, ...]

    @property
    def missing(self) -> int:
        """Measured samples that never came, over all channels."""
        return sum(channel.measured.missing for channel in self.channels if channel.measured)

    @property
    def overloaded_blocks(self) -> int:
        """Measured blocks with an overload, over all channels."""
        return sum(channel.measured.overloaded_blocks for channel in self.channels if channel.measured)


def summarise(log: Path) -> RunSummary:
    """Read a log and return its numbers; raises LogError."""
    return summary_of(read_run(log))


def summary_of(run: RunRecord) -> RunSummary:
    """Return the numbers of a run that has been read."""
    facts = run.facts
    identity = run.metadata.get("run", {})
    return RunSummary(
        log=run.path,
        run_id=identity.get("id", ""),
        started=identity.get("started", ""),
        scenario=facts.name,
        drive=facts.drive,
        duration_s=max((each.end_sample / each.sample_rate for each in run.tallies.values()), default=0.0),
        complete=run.complete,
        channels=tuple(
            ChannelSummary(
                name,
                channel.unit,
                _trace_summary(run.tallies.get(("measured", name))),
                _trace_summary(run.tallies.get(("predicted", name))),
                _trace_summary(run.tallies.get(("nominal", name))),
            )
            for name, channel in run.channels.items()
        ),
        measured_peaks=_statistics(half_cycles_of(run, "measured")),
        predicted_peaks=_statistics(half_cycles_of(run, "predicted")),
        nominal_peaks=_statistics(half_cycles_of(run, "nominal")),
        gaps=tuple(run.gaps),
    )


def half_cycles_of(run: RunRecord, origin: Origin) -> HalfCycles | None:
    """Half cycles of one origin; None where the run lacks a contact force."""
    forces = run.contact_forces(origin)
    if forces is None:
        return None
    length = min(len(force.values) for force in forces)
    upper, lower = (force.values[:length] for force in forces)
    return half_cycles(upper, lower, forces[0].sample_rate)


def _trace_summary(tally: Tally | None) -> TraceSummary | None:
    if tally is None:
        return None
    lowest, highest = (tally.minimum, tally.maximum) if tally.finite else (math.nan, math.nan)
    return TraceSummary(
        samples=tally.samples,
        missing=max(tally.end_sample - tally.samples, 0),
        not_finite=tally.samples - tally.finite,
        rms=math.sqrt(tally.square_sum / tally.finite) if tally.finite else math.nan,
        peak=max(abs(lowest), abs(highest)),
        minimum=lowest,
        maximum=highest,
        overloaded_blocks=tally.overloaded_blocks,
    )


def _statistics(found: HalfCycles | None) -> HalfCycleStatistics | None:
    if found is None or not len(found):
        return None
    several = len(found) > 1
    return HalfCycleStatistics(
        count=len(found),
        first_mean_n=float(found.first_n.mean()),
        first_sd_n=float(np.std(found.first_n, ddof=1)) if several else math.nan,
        max_mean_n=float(found.max_n.mean()),
        max_sd_n=float(np.std(found.max_n, ddof=1)) if several else math.nan,
    )

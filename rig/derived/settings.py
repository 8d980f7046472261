"""What depends on the run: settled from the first seconds of its record, by a rule, and kept in the log.

The rule (number 3): all is settled on the first `settle_s` of the record, ten cycles as the scenario has
them, but a second at least, and at most five or three cycles; of a record that is shorter, on all of it.
Frequency and phase of a drive are those that the twin aligns to; a crank has its mean speed; each origin has
its own. Levels are those of the measurement wherever it shows a channel, so that measured and predicted
impacts count alike.

An impact is a rise by at least 15 % of what the largest force of a cycle typically is on that sensor (the
median over those cycles), quicker than the time within which its bounces come; it has ended below a fiftieth.
Neither counts from less than ten times the noise of a healthy channel, nor below four (docs/derived.md).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from math import tau
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daq.angle.cycles import WORST_RESIDUAL, AngleCycles, Cycles, DriveCycles, MarkerCycles
from daq.angle.marker import MarkTracker
from daq.log.metadata import as_table, number_in, read_json
from daq.log.reader import LogReader
from daq.quantity import Bound
from daq.signals.impacts import Levels, largest_force, levels_of
from rig.files.scenario import Scenario
from rig.rigs import RIGS, declared
from rig.twin.alignment import AS_USUAL, WORST_BY_GAUGE, Mounting, Reference, reference_among
from sim_twin.rigs.channel_table import ENCODER_ANGLE, Role

RECORD = "derived"
"""Name of the metadata record."""
RULE = "3"
STOPPED = "derived.stopped"
"""Code of the event that nothing more is derived."""

_COUNTS, _RELEASED = 0.5, 0.2
"""Ten and four times the noise of a healthy force channel (0.05 N rms) or acceleration (0.05 m/s2)."""
_BOUNCE_CYCLES, _BURST_CYCLES = 0.25, 0.15
"""On one side of a clearance, whose other side or next turn is farther away; and on a frame that rings."""
_RINGS_S = 0.01
"""Longer than half a period of the lowest frame (180 Hz) and shorter than the time between its impacts."""


@dataclass(frozen=True, slots=True)
class Settings:
    """`cycle_hz` is the rate of the cycles, None where nothing counts them; `phase_rad` that of a drive.

    `levels` of each channel that is watched, in its unit; `within_s`: what begins so soon after a contact or
    burst belongs to the same impact, and a rise that takes longer is none.
    """

    settle_s: float
    cycle_hz: float | None
    phase_rad: float
    levels: Mapping[str, Levels]
    within_s: Mapping[str, float]


def settled(
    settle_s: float,
    cycle_hz: float | None,
    phase_rad: float,
    seen: Mapping[str, NDArray[np.floating]],
    sample_rate: float,
    measured: Mapping[str, Levels],
) -> Settings:
    """Apply the rule to what was `seen` of the watched channels; `measured` levels go before their own."""
    cycle = round(sample_rate / cycle_hz) if cycle_hz else 0
    levels: dict[str, Levels] = {}
    for name, values in seen.items():
        ends = range(cycle, len(values) + 1, cycle) if 0 < cycle <= len(values) else [len(values)]
        size = np.abs(values) if rings_s(name) else values
        largest = [largest_force(size[max(end - cycle, 0) if cycle else 0 : end]) for end in ends]
        levels[name] = measured.get(name) or _levels(float(np.median(largest)))
    within_s = {name: bounces_within_s(name, cycle_hz) for name in seen}
    return Settings(settle_s, cycle_hz, phase_rad, levels, within_s)


def _levels(typical: float) -> Levels:
    share = levels_of(typical)
    return Levels(max(share.counts_from_n, _COUNTS), max(share.released_below_n, _RELEASED))


def bounces_within_s(channel: str, cycle_hz: float | None) -> float:
    """What begins so soon after a contact or burst belongs to the same impact."""
    known = declared(channel)
    if known is not None and known.bounces_s:
        return known.bounces_s
    return (_BURST_CYCLES if rings_s(channel) else _BOUNCE_CYCLES) / cycle_hz if cycle_hz else _RINGS_S


def rings_s(channel: str) -> float:
    """For how long magnitudes of a channel that rings are held; 0 of one that does not."""
    return _RINGS_S if role_of(channel) is Role.VIBRATION else 0.0


def role_of(channel: str) -> Role:
    """What a channel is to its rig; a response where no rig has it."""
    known = declared(channel)
    return Role.RESPONSE if known is None else known.role


def has_figures(channel: str) -> bool:
    """Whether there are figures of its cycles."""
    return role_of(channel) not in (Role.ANGLE, Role.MARKER)


def as_record(settings: Mapping[str, Settings]) -> dict[str, str]:
    """The metadata record: by origin, as JSON (which keeps every bit of a number)."""
    return {"rule": RULE} | {origin: json.dumps(asdict(each)) for origin, each in settings.items()}


def says_impacts(log: LogReader) -> bool:
    """Whether a log holds all its impacts, by this rule."""
    said = log.metadata.get(RECORD)
    by_this_rule = said is not None and said.get("rule", RULE) == RULE
    return by_this_rule and all(event.code != STOPPED for event in log.events())


_DURATION = Bound("s", 1e-9, 86_400.0)
_CYCLE_RATE = Bound("Hz", 1e-4, 1e5)
"""From a twentieth of a turn in the longest time that is looked at to half the rate of the fastest card."""
_PHASE = Bound("rad", -tau, tau)
_LEVELS = tuple(each.name for each in fields(Levels))
_LEVEL = Bound(low=0.0, high=1e39, above=True)
"""Up to what a sample of 32 bits can be."""


def from_record(record: Mapping[str, str]) -> dict[str, Settings]:
    """What a log says was settled, nothing by another rule; raises LogError where it cannot be read."""
    if record.get("rule", RULE) != RULE:
        return {}
    return {origin: _settings(text, origin) for origin, text in record.items() if origin != "rule"}


def _settings(text: str, origin: str) -> Settings:
    what = f"what the log says was settled of {origin} (metadata record {RECORD})"
    told = as_table(read_json(text, what), what)
    levels, within_s = (as_table(told.get(key), what) for key in ("levels", "within_s"))
    turns = told.get("cycle_hz") is not None
    return Settings(
        settle_s=number_in(told, "settle_s", _DURATION, what),
        cycle_hz=number_in(told, "cycle_hz", _CYCLE_RATE, what) if turns else None,
        phase_rad=number_in(told, "phase_rad", _PHASE, what),
        levels={
            name: Levels(*(number_in(as_table(each, what), key, _LEVEL, what) for key in _LEVELS))
            for name, each in levels.items()
        },
        within_s={name: number_in(within_s, name, _DURATION, what) for name in levels},
    )


CYCLES: Final = 3
"""Everything is settled on so many at least."""
_GOOD_CYCLES = 10
"""Of a crank each has another largest burst: three would leave its level to chance."""
_LEAST_S, _MOST_S = 1.0, 5.0
_LEAST_TURN = 0.05


def settle_s(cycle_hz: float) -> float:
    """How much of a record everything is settled on."""
    return max(_LEAST_S, min(_GOOD_CYCLES / cycle_hz, _MOST_S), CYCLES / cycle_hz)


@dataclass(frozen=True, slots=True)
class Nominal:
    """What the scenario says of the cycles: the drive, and how it is found in its channel.

    `beside` its sine may be as much else, rms as a share of its amplitude. A mark comes at crank angle
    `mark_rad`.
    """

    drive: Any
    reference: Reference
    beside: float = WORST_RESIDUAL
    mark_rad: float = 0.0

    @property
    def settle_s(self) -> float:
        """How much of a record everything is settled on."""
        return settle_s(float(self.drive.cycle_hz))


def nominal_of(scenario: Scenario, mounting: Mounting = AS_USUAL) -> Nominal:
    """What a scenario says; a gauge in the stinger shows impacts with the drive."""
    table = RIGS[scenario.rig].channels
    found = reference_among(table, (table.drive,))
    if not mounting.gauged:
        return Nominal(scenario.drive, found, mark_rad=mounting.mark_rad)
    align = partial(found.align, worst=WORST_BY_GAUGE)
    return Nominal(scenario.drive, replace(found, align=align), WORST_BY_GAUGE)


def reference_of(channels: tuple[str, ...]) -> str | None:
    """The channel that counts the cycles: the encoder rather than a marker, the drive where nothing turns."""
    # of two with one role the first counts
    by_role = {role_of(name): name for name in reversed(channels) if name != ENCODER_ANGLE.name}
    return next((by_role[role] for role in (Role.ANGLE, Role.MARKER, Role.DRIVE) if role in by_role), None)


def first_look(
    reference: str, values: NDArray[np.floating], sample_rate: float, nominal: Nominal
) -> tuple[float | None, float]:
    """Rate of the cycles in Hz, None if nothing counts them, and the drive's phase in rad (0 of a crank)."""
    if role_of(reference) is Role.DRIVE:
        found = nominal.reference.align(values, sample_rate, 0, nominal.drive)
        return (found.frequency, found.phase) if found.trusted else (None, 0.0)
    if role_of(reference) is Role.ANGLE:
        known = np.flatnonzero(np.isfinite(values))
        turned = (float(values[known[-1]]) - float(values[known[0]])) / tau if len(known) > 1 else 0.0
        if turned > _LEAST_TURN:
            return turned * sample_rate / int(known[-1] - known[0]), 0.0
    elif len(marks := MarkTracker().track(values)[0]) > 1:
        turns = int(marks.turn[-1] - marks.turn[0])
        return float(turns * sample_rate / (marks.position[-1] - marks.position[0])), 0.0
    return float(nominal.drive.cycle_hz), 0.0


def cycles_of(
    reference: str,
    settings: Settings,
    sample_rate: float,
    beside: float = WORST_RESIDUAL,
    mark_rad: float = 0.0,
) -> Cycles | None:
    """What counts the cycles by the reference channel; `beside` and `mark_rad` as in `Nominal`."""
    if settings.cycle_hz is None or 2 * settings.cycle_hz > sample_rate:  # so few samples show no cycle
        return None
    if role_of(reference) is Role.DRIVE:
        return DriveCycles(sample_rate, settings.cycle_hz, settings.phase_rad, beside)
    if role_of(reference) is Role.ANGLE:
        return AngleCycles(sample_rate)
    return MarkerCycles(sample_rate, mark_rad / tau)

"""What depends on the run: settled from the first seconds of its record, by a rule, and kept in the log.

The rule (number 1), for each origin by its own samples: all is settled on the first `settle_s` of the record,
a second or three cycles as the scenario has them, whichever is longer; of a record that is shorter, on all of
it. Frequency and phase of a drive are those that the twin aligns to; a crank has its mean speed. A contact
counts from a tenth of the largest force of its group of sensors and has ended below a fiftieth (so does
`daq.signals.levels_of`), but not from less than ten times the noise of a healthy channel, nor below four.
On a frame that rings a burst counts from a fifth of the largest magnitude and has ended below a tenth: then
the number of bursts a revolution hardly depends on either (docs/derived.md).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.angle.cycles import AngleCycles, Cycles, DriveCycles, MarkerCycles
from daq.angle.marker import MarkTracker
from daq.errors import LogError
from daq.signals.impacts import Levels, largest_force, levels_of
from rig.files.scenario import Scenario
from rig.rigs import RIGS, declared
from rig.twin.alignment import Reference, reference_among
from sim_twin.rigs.channel_table import ENCODER_ANGLE, Role

RECORD = "derived"
"""Name of the metadata record."""
RULE = "1"

_COUNTS, _RELEASED = 0.5, 0.2
"""Ten and four times the noise of a healthy force channel (0.05 N rms) or acceleration (0.05 m/s2)."""
_BURST_COUNTS, _BURST_RELEASED = 0.2, 0.1
_BOUNCE_CYCLES = 0.25
"""On one side of a clearance: the other side, or the next turn, is farther away than that."""
_RING_S = 0.01
"""Longer than half a period of the lowest frame (180 Hz) and shorter than the time between its impacts."""


@dataclass(frozen=True, slots=True)
class Settings:
    """`cycle_hz` is the rate of the cycles, None where nothing counts them; `phase_rad` that of a drive.

    `levels` of each channel that is watched, in its unit; `within_s`: what begins so soon after a contact or
    burst belongs to the same impact.
    """

    settle_s: float
    cycle_hz: float | None
    phase_rad: float
    levels: Mapping[str, Levels]
    within_s: Mapping[str, float]


def settled(
    settle_s: float, cycle_hz: float | None, phase_rad: float, seen: Mapping[str, NDArray[np.floating]]
) -> Settings:
    """Apply the rule to what was `seen` of the watched channels."""
    largest: dict[str, float] = {}
    for name, values in seen.items():
        group = _group(name)
        largest[group] = max(largest.get(group, 0.0), largest_force(magnitude(role_of(name), values)))
    levels: dict[str, Levels] = {}
    within_s: dict[str, float] = {}
    for name in seen:
        most, rings = largest[_group(name)], role_of(name) is Role.VIBRATION
        if rings:
            counts, released = _BURST_COUNTS * most, _BURST_RELEASED * most
        else:
            found = levels_of(most)
            counts, released = found.counts_from_n, found.released_below_n
        levels[name] = Levels(max(counts, _COUNTS), max(released, _RELEASED))
        within_s[name] = _RING_S if rings or cycle_hz is None else _BOUNCE_CYCLES / cycle_hz
    return Settings(settle_s, cycle_hz, phase_rad, levels, within_s)


def role_of(channel: str) -> Role:
    """What a channel is to its rig; a response where no rig has it."""
    known = declared(channel)
    return Role.RESPONSE if known is None else known.role


def has_figures(channel: str) -> bool:
    """Whether there are figures of its cycles."""
    return role_of(channel) not in (Role.ANGLE, Role.MARKER)


def _group(channel: str) -> str:
    known = declared(channel)
    return (known.group if known is not None else "") or channel


def magnitude(role: Role, values: NDArray[np.floating]) -> NDArray[np.floating]:
    """What is compared with the levels."""
    return np.abs(values) if role is Role.VIBRATION else values


def as_record(settings: Mapping[str, Settings]) -> dict[str, str]:
    """The metadata record: by origin, as JSON (which keeps every bit of a number)."""
    return {"rule": RULE} | {origin: json.dumps(asdict(each)) for origin, each in settings.items()}


def from_record(record: Mapping[str, str]) -> dict[str, Settings]:
    """What a log says was settled; raises LogError where it cannot be read."""
    found: dict[str, Settings] = {}
    try:
        for origin, fields in ((name, json.loads(text)) for name, text in record.items() if name != "rule"):
            found[origin] = Settings(
                settle_s=float(fields["settle_s"]),
                cycle_hz=None if fields["cycle_hz"] is None else float(fields["cycle_hz"]),
                phase_rad=float(fields["phase_rad"]),
                levels={name: Levels(**levels) for name, levels in fields["levels"].items()},
                within_s={name: float(within) for name, within in fields["within_s"].items()},
            )
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise LogError(f"the metadata record {RECORD} is damaged ({error})") from error
    return found


_CYCLES = 3
_LEAST_S = 1.0
_LEAST_TURN = 0.05


@dataclass(frozen=True, slots=True)
class Nominal:
    """What the scenario says of the cycles: the drive, and how it is found in its channel."""

    drive: Any
    reference: Reference

    @property
    def settle_s(self) -> float:
        """How much of a record everything is settled on."""
        return max(_LEAST_S, _CYCLES / float(self.drive.cycle_hz))


def nominal_of(scenario: Scenario) -> Nominal:
    """What a scenario says."""
    table = RIGS[scenario.rig].channels
    return Nominal(scenario.drive, reference_among(table, (table.drive,)))


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


def cycles_of(reference: str, settings: Settings, sample_rate: float) -> Cycles | None:
    """What counts the cycles by the reference channel."""
    if settings.cycle_hz is None:
        return None
    if role_of(reference) is Role.DRIVE:
        return DriveCycles(sample_rate, settings.cycle_hz, settings.phase_rad)
    return AngleCycles(sample_rate) if role_of(reference) is Role.ANGLE else MarkerCycles(sample_rate)

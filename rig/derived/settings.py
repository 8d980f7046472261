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

import numpy as np
from numpy.typing import NDArray

from daq.errors import LogError
from daq.signals.impacts import Levels, largest_force, levels_of
from rig.derived.roles import Role, Watch, role_of

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
        group = role_of(name).group or name
        largest[group] = max(largest.get(group, 0.0), largest_force(magnitude(role_of(name), values)))
    return Settings(
        settle_s,
        cycle_hz,
        phase_rad,
        {name: _levels(role_of(name), largest[role_of(name).group or name]) for name in seen},
        {name: _within(role_of(name), cycle_hz) for name in seen},
    )


def magnitude(role: Role, values: NDArray[np.floating]) -> NDArray[np.floating]:
    """What is compared with the levels."""
    return np.abs(values) if role.watch is Watch.VIBRATION else values


def _levels(role: Role, largest: float) -> Levels:
    if role.watch is Watch.VIBRATION:
        counts, released = _BURST_COUNTS * largest, _BURST_RELEASED * largest
    else:
        levels = levels_of(largest)
        counts, released = levels.counts_from_n, levels.released_below_n
    return Levels(max(counts, _COUNTS), max(released, _RELEASED))


def _within(role: Role, cycle_hz: float | None) -> float:
    return _RING_S if role.watch is Watch.VIBRATION or cycle_hz is None else _BOUNCE_CYCLES / cycle_hz


def as_record(settings: Mapping[str, Settings]) -> dict[str, str]:
    """The metadata record: by origin, as JSON (which keeps every bit of a number)."""
    return {"rule": RULE} | {origin: json.dumps(asdict(each)) for origin, each in settings.items()}


def from_record(record: Mapping[str, str]) -> dict[str, Settings]:
    """What a log says was settled; raises LogError where it cannot be read."""
    try:
        return {origin: _parsed(text) for origin, text in record.items() if origin != "rule"}
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise LogError(f"the metadata record {RECORD} is damaged ({error})") from error


def _parsed(text: str) -> Settings:
    fields = json.loads(text)
    return Settings(
        settle_s=float(fields["settle_s"]),
        cycle_hz=None if fields["cycle_hz"] is None else float(fields["cycle_hz"]),
        phase_rad=float(fields["phase_rad"]),
        levels={name: Levels(**levels) for name, levels in fields["levels"].items()},
        within_s={name: float(within) for name, within in fields["within_s"].items()},
    )

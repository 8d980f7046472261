"""Phase and mean frequency as drive or crank show them; nothing else measured reaches the twin."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daq.angle.cycles import WORST_RESIDUAL
from daq.signals.sine import fit_growing, fit_sine
from sim_twin.rigs.channel_table import ChannelTable, Role
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.model import SineDrive
from sim_twin.sensors import Encoder, SensorChain
from sim_twin.stages import Stages
from sim_twin.twin import AnyTwin

FREQUENCY_TOLERANCE = 1e-3
"""A twin follows the measured mean frequency within 0.1 % of the scenario's."""
_STARTED = 0.05
_RUNNING_SHARE = 0.5
_SAFE_CYCLES = 0.2 / FREQUENCY_TOLERANCE


@dataclass(frozen=True, slots=True)
class Alignment:
    """`frequency` in Hz and `phase` (rad) of the drive at sample 0.

    `onset` is the sample (fractional) at which the drive began from rest, None where it was running before.
    `trusted` is False where the measurement showed no usable sine and the scenario's own values stand.
    """

    frequency: float
    phase: float
    onset: float | None = None
    trusted: bool = True


@dataclass(frozen=True, slots=True)
class Mounting:
    """How what shows the cycles is mounted: `gauged` where a gauge in the stinger shows the drive; `mark_rad`
    is the crank angle at which a mark comes.
    """

    gauged: bool = False
    mark_rad: float = 0.0


AS_USUAL: Final = Mounting()
"""Where nothing is said."""


def untouched(drive: Any) -> Alignment:
    """What the scenario says of the drive of any rig, where nothing was measured."""
    return Alignment(drive.cycle_hz, 0.0, trusted=False)


def align(
    force: NDArray[np.floating],
    sample_rate: float,
    first_sample: int,
    drive: SineDrive,
    shown: Callable[[float], complex] = lambda _: 1.0,
    worst: float = WORST_RESIDUAL,
) -> Alignment:
    """Align to measured drive `force` (N, shape (n,)) that begins at sample `first_sample` of the run.

    `shown(frequency in Hz)` is what its chain makes of a sine; `worst`, as a share of that, how much else may
    be seen (rms).
    """
    finite = np.nan_to_num(np.asarray(force, dtype=float)) - drive.offset * shown(0.0).real
    response = complex(shown(drive.frequency))
    level = abs(drive.amplitude) * abs(response)
    if level == 0 or len(finite) == 0 or np.max(np.abs(finite)) < _RUNNING_SHARE * level:
        return Alignment(drive.frequency, 0.0, onset=None, trusted=False)
    begun = int(np.argmax(np.abs(finite) > _STARTED * level))
    period = sample_rate / drive.frequency
    running_before = begun < period / 8
    steady = finite if running_before else finite[begun:]
    fit = fit_growing(steady, sample_rate, drive.frequency, _SAFE_CYCLES)
    if running_before and begun > 0 and abs(np.sin(fit.phase)) > 2 * _STARTED:
        # The first samples were at rest where the sine was not: a slow drive that began just then.
        running_before, steady = False, finite[begun:]
        fit = fit_growing(steady, sample_rate, drive.frequency, _SAFE_CYCLES)
    span = FREQUENCY_TOLERANCE * drive.frequency
    frequency = float(np.clip(fit.frequency, drive.frequency - span, drive.frequency + span))
    if frequency != fit.frequency:
        fit = fit_sine(steady, sample_rate, frequency, hold_frequency=True)
    start = first_sample + (0 if running_before else begun)
    lead = float(np.angle(response))
    phase = (fit.phase - lead - 2 * np.pi * frequency * start / sample_rate) % (2 * np.pi)
    trusted = fit.residual < worst * level
    if running_before:
        return Alignment(frequency, phase, trusted=trusted)
    # the zero of the sine just before the first sample at which it was seen
    since = (phase / (2 * np.pi) + frequency / sample_rate * start) % 1.0
    onset = float(start - since / (frequency / sample_rate)) if since < 1 / 8 else float(start)
    return Alignment(frequency, phase, onset, trusted)


_FEWEST_MARKS = 2
MARKED_TURNS = 3.0
"""Turns in which a marker surely shows as many, with one lost."""
_LEAST_TURN = 0.05
"""Revolutions that a record has to show before its speed is believed."""
_ENCODER: Final = Encoder()
_FURTHEST_RAD = 1e12
"""Beyond, a double holds no phase."""


def align_angle(
    angle: NDArray[Any],
    sample_rate: float,
    first_sample: int,
    drive: SpeedDrive,
    encoder: Encoder = _ENCODER,
) -> Alignment:
    """Align to a crank angle (rad, unwrapped, shape (n,)) that `encoder` shows."""
    samples = first_sample + np.arange(len(angle))
    known = np.abs(angle) < _FURTHEST_RAD
    # a counter shows the last whole count: on average half a count less than the angle
    half = (-pi if encoder.backwards else pi) / encoder.counts
    centred = np.asarray(angle, dtype=float)[known] + half
    if len(centred) < 2 or abs(centred[-1] - centred[0]) < _LEAST_TURN * 2 * pi:
        return untouched(drive)
    return _fit(samples[known], centred, sample_rate, drive)  # whole turns stay: the prediction has them too


def align_marker(
    marker: NDArray[Any],
    sample_rate: float,
    first_sample: int,
    drive: SpeedDrive,
    at_angle: float = 0.0,
    late_s: float = 0.0,
) -> Alignment:
    """Align to a once-per-revolution marker (V, shape (n,)) that rises at crank angle `at_angle` (rad).

    It is shown by `late_s` s too late.
    """
    high = np.asarray(marker, dtype=float)
    level = (np.nanmin(high) + np.nanmax(high)) / 2 if len(high) else 0.0
    rises = np.flatnonzero((high[:-1] < level) & (high[1:] >= level))
    if len(rises) < _FEWEST_MARKS or np.nanmax(high) - np.nanmin(high) < 1.0:
        return untouched(drive)
    share = (level - high[rises]) / (high[rises + 1] - high[rises])
    period = 2 * pi * sample_rate / drive.mean_speed
    at = first_sample + rises + share - late_s * sample_rate
    turns = np.round(np.concatenate([[0.0], np.cumsum(np.diff(at) / period)]))
    fit = _fit(at, 2 * pi * turns + at_angle, sample_rate, drive)
    return replace(fit, phase=fit.phase % (2 * pi))


def _fit(
    samples: NDArray[Any], angle: NDArray[np.float64], sample_rate: float, drive: SpeedDrive
) -> Alignment:
    wanted = drive.mean_speed / (2 * pi)
    slope, _ = np.polyfit(samples - samples[0], angle, 1)
    found = float(slope) * sample_rate / (2 * pi)
    frequency = float(np.clip(found, wanted * (1 - FREQUENCY_TOLERANCE), wanted * (1 + FREQUENCY_TOLERANCE)))
    at_zero = angle - 2 * pi * frequency * samples / sample_rate
    return Alignment(frequency, float(np.mean(at_zero)), trusted=found == frequency)


Align = Callable[..., Alignment]
_ALIGNED: Final[Mapping[Role, tuple[Align, float]]] = {
    Role.ANGLE: (align_angle, 0.0),
    Role.MARKER: (align_marker, MARKED_TURNS),
    Role.DRIVE: (align, 0.0),
}
"""The best first, each with the cycles that it needs."""


@dataclass(frozen=True, slots=True)
class Reference:
    """A channel that phase and mean frequency are taken from.

    `align(values, sample rate, first sample, drive)` takes them; it needs `cycles` of the drive or turns.
    """

    channel: str
    align: Align
    cycles: float = 0.0


def reference_among(table: ChannelTable, channels: Container[str], twin: AnyTwin | None = None) -> Reference:
    """The best reference of a rig that is among `channels`; the best of all where none is.

    What it shows is taken as the sensors of `twin` show it.
    """
    names = table.with_role(*_ALIGNED)
    name = next((each for each in names if each in channels), names[0])
    align, cycles = _ALIGNED[table[name].role]
    sensor = None if twin is None else twin.sensors.get(name)
    stages = sensor.stages if isinstance(sensor, SensorChain) else None
    if isinstance(sensor, Encoder):
        align = partial(align, encoder=sensor)
    elif twin is not None and table[name].role is Role.MARKER:
        late_s = 0.0 if stages is None else stages.delay
        align = partial(align, at_angle=getattr(twin.rig, "marker_angle", 0.0), late_s=late_s)
    elif twin is not None and getattr(twin.rig, "stinger_gauge", False):
        align = partial(align, shown=partial(_by_gauge, twin, stages), worst=WORST_BY_GAUGE)
    elif stages is not None:
        align = partial(align, shown=stages.response)
    return Reference(name, align, cycles)


def nothing_tells(table: ChannelTable, channels: Container[str]) -> str:
    """What it means that none of `channels` tells where in its cycle the drive is; empty where one does."""
    names = table.with_role(*_ALIGNED)
    if any(name in channels for name in names):
        return ""
    return (
        f"no channel is {' or '.join(names)}, so nothing tells the drive's phase: the twin follows the "
        "scenario, and no run is judged or diagnosed"
    )


WORST_BY_GAUGE: Final = 2.0
"""It feels the impacts too, by the inertia of what moves with the coil."""
_GAUGE_RATE, _GAUGE_CYCLES, _GAUGE_SETTLE_S = 25_600.0, 20, 1.0


def force_shown(twin: AnyTwin, highest: float) -> Callable[[float], float]:
    """How much the channel of the drive shows of the coil's sine, by the sine's amplitude, both in N.

    As the twin has it at its frequency: less of it behind a gauge in the stinger, or a chain. A gauge feels
    the impacts as well: it is simulated at an eighth of the twin's drive, at the whole, and at `highest`.
    """
    drive, sensor = twin.drive, twin.sensors.get(twin.model.channels.drive)
    stages = sensor.stages if isinstance(sensor, SensorChain) else None
    if not getattr(twin.rig, "stinger_gauge", False):
        share = 1.0 if stages is None else abs(stages.response(drive.frequency))
        return lambda force: share * force
    forces = sorted({drive.amplitude / 8, drive.amplitude, highest})
    driven = (replace(twin, drive=replace(drive, amplitude=force)) for force in forces)
    shown = [abs(_by_gauge(each, stages, drive.frequency)) * each.drive.amplitude for each in driven]
    return lambda force: float(np.interp(force, [0.0, *forces], [0.0, *shown]))


def _by_gauge(twin: AnyTwin, stages: Stages | None, frequency: float) -> complex:
    """What a gauge in the stinger, and what is behind it, makes of the coil's sine, as the twin has it."""
    behind = 1.0 + 0.0j if stages is None else stages.response(frequency)
    if not frequency or not twin.drive.amplitude:
        return behind
    drive = replace(twin.drive, frequency=frequency, offset=0.0)
    stream = twin.model.stream(replace(twin, drive=drive, sensors={}), _GAUGE_RATE)
    stream.drive(drive)
    before = round(np.ceil(_GAUGE_SETTLE_S * frequency) / frequency * _GAUGE_RATE)
    count = round(_GAUGE_CYCLES / frequency * _GAUGE_RATE)
    row = stream.advance(before + count)[stream.channels.index(twin.model.channels.drive), before:]
    turn = np.exp(-2j * np.pi * frequency / _GAUGE_RATE * np.arange(before, before + count))
    return complex(behind * 2j * np.mean(row * turn) / drive.amplitude)

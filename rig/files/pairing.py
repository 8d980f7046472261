"""Whether a scenario can be run on a bench; checked before anything moves."""

from __future__ import annotations

import datetime
import math
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Final

from daq.errors import ConfigurationError, Problem
from daq.log.records import LEAST_FREE_BYTES
from drivers.ni_daq.channels import FASTEST_EDGES_HZ, CardChannel
from drivers.ni_daq.sensors import known_sensor
from drivers.rehearsal import ON_A_WIRE, rehearsed
from rig.files.bench import Bench
from rig.files.faults import dotted, meant
from rig.files.scenario import AcquisitionSection, Scenario
from rig.instruments import actuator_of
from rig.rigs import RIGS, declared, shaft_channel, unit_of

SOFT_START_FROM_S = 0.8
"""A settling time shorter than this has no room for a ramp: the drive starts at once, from phase zero."""
_LEAST_MOTOR_SETTLE_S = 1.0
_ROUNDING = 1e-9
BYTES_PER_SAMPLE: Final = 4.3
"""Float32, and a twentieth for what stands around it. Noise is not compressed."""
_NOTHING_SEEN: Final = (
    "none with a real actuator and an emulated card, which sees nothing of the real rig: a limit needs a "
    "real card (daq_card.emulated = false)"
)


def check_pair(
    scenario: Scenario,
    bench: Bench,
    today: datetime.date,
    free_bytes: float = math.inf,
    recorded_s: float | None = None,
) -> None:
    """Raise ConfigurationError with all that forbids this scenario on this bench.

    The drive asks for more than the bench allows or has no time to come up; a channel of the bench is none of
    the rig's, or none shows its crank turn; a chain contradicts itself, the scenario's rate or the bench's
    highest speed; a fault to rehearse is of a channel that the card has not; a limit names a channel that the
    bench lacks, lies beyond its range and could never trip, or is to guard a real rig by an emulated card; a
    calibration has run out by `today` (emulated sensors do not age); the log, as long as the scenario says or
    `recorded_s`, does not fit where `free_bytes` are left.
    """
    record = scenario.acquisition
    if recorded_s is not None:
        record = replace(record, duration=recorded_s)
    actuator = actuator_of(bench.actuator_table)
    problems = [
        *resolve_name(actuator.beyond)(scenario, bench),
        *resolve_name(actuator.hurried)(scenario),
        *_channels(scenario.rig, bench),
        *nowhere(bench),
        *_shaft(bench),
        *_chains(bench, record.sample_rate),
        *_limits(scenario, bench),
        *_calibrations(bench, today),
        *no_room(bytes_of([record], bench), free_bytes),
    ]
    if problems:
        raise ConfigurationError(f"scenario {scenario.name!r} on {bench.source}", problems)


def nowhere(bench: Bench) -> Iterator[Problem]:
    """Faults to rehearse on what is not there: a channel that shows the rig, a line of the emergency stop."""
    shown = [each for each in bench.daq_card.channels if unit_of(each.name) is not None]
    for text in bench.emulation.faults:
        fault = rehearsed(text)
        names = [each.name for each in shown if not (each.counted and fault.kind in ON_A_WIRE)]
        if "channel" in fault.known and not any(name.endswith(fault.channel) for name in names):
            allowed = f"a channel of the card ({', '.join(names)})"
            yield Problem("emulation.faults", text, allowed)
        reader = bench.instruments.get(fault.table)
        if fault.kind == "stop_pressed" and reader is not None and reader.stop_line is None:
            where = "a line of the card" if fault.table == "daq_card" else "a terminal of the inverter"
            yield Problem("emulation.faults", text, f"a bench with [emergency_stop] on {where}")


def too_late(scenario: Scenario, bench: Bench) -> Iterator[str]:
    """Say of each fault to rehearse that the record is over before it comes; of a crank, that it may be."""
    end_s = scenario.acquisition.settle + scenario.acquisition.duration
    turns = RIGS[scenario.rig].turns
    over = f"may be over ({end_s:g} s from full speed on)" if turns else f"is over ({end_s:g} s)"
    for text in bench.emulation.faults:
        if rehearsed(text).at_s >= end_s:
            yield f"{text} is for when the record {over}: on the way to rest, or never"


def check_scenario(scenario: Scenario, source: str) -> None:
    """Raise ConfigurationError with what forbids this scenario on whatever bench; `source` is its file."""
    problems = list(resolve_name(actuator_of(RIGS[scenario.rig].actuator).hurried)(scenario))
    if problems:
        raise ConfigurationError(source, problems)


def check_bench(bench: Bench, today: datetime.date) -> None:
    """Raise ConfigurationError with what forbids it for whatever scenario."""
    problems = [*_channels(bench.rig, bench), *_shaft(bench), *_chains(bench), *_calibrations(bench, today)]
    problems += nowhere(bench)
    if problems:
        raise ConfigurationError(bench.source, problems)


def unmeasured(bench: Bench) -> str:
    """What nobody sees of a real shaker on this bench; empty where it is measured, or none is there.

    No fault: what moves there is emulated for the twin's sake, or a lab has no such sensor.
    """
    shown, channels = RIGS[bench.rig].channels.drive, [each.name for each in bench.daq_card.channels]
    if not shown or bench.actuator.emulated or not (bench.unseen or shown not in channels):
        return ""
    why = "the card is emulated" if bench.unseen else f"no channel is {shown}"
    return (
        f"nothing measures what the real shaker does ({why}): maximum_amplitude bounds what is ordered, and "
        "no measured force is held to it or to the order; is force_per_volt right?"
    )


def undelayed(bench: Bench) -> str:
    """Which inputs of a real card are later than its counters, by what nobody says; empty for none."""
    card = bench.daq_card
    counters = [each.name for each in card.channels if each.counted]
    if card.emulated or not counters:
        return ""
    analog = [each for each in card.channels if not each.counted]
    fed = {each.device for each in analog if known_sensor(each).fed}
    late = [each.name for each in analog if each.device in fed and each.delay is None]
    if not late:
        return ""
    return (
        f"no delay for {', '.join(late)}: such inputs show what happens some 40 samples later than the "
        f"counter {counters[0]}, so the prediction comes that much too early. Say it by the module's data "
        'sheet: delay = "39 samples"; "0 ms" where there is none'
    )


def bytes_of(records: Iterable[AcquisitionSection], bench: Bench) -> float:
    """The most that logs of these take."""
    samples = sum(each.sample_rate * each.duration for each in records)
    names = [channel.name for channel in bench.daq_card.channels]
    predicted = sum(unit_of(name) is not None for name in names)
    return samples * (len(names) + predicted) * BYTES_PER_SAMPLE


def longest_s(wanted: AcquisitionSection, bench: Bench, free_bytes: float) -> float:
    """How long a record may be: as long as its log fits on the disk, but a day at most."""
    a_second = bytes_of([replace(wanted, duration=1.0)], bench)
    return max(1.0, min(86_400.0, math.floor((free_bytes - LEAST_FREE_BYTES) / a_second)))


def no_room(log_bytes: float, free_bytes: float) -> Iterator[Problem]:
    """Logs that do not fit on the disk."""
    needed = log_bytes + LEAST_FREE_BYTES
    if needed > free_bytes:
        allowed = f"{needed / 1e9:.1f} GB with 1 GiB to spare; make room or choose another --out"
        yield Problem("free disk space", f"{free_bytes / 1e9:.1f} GB", allowed)


def check_room(target: Path, log_bytes: float) -> None:
    """Raise ConfigurationError where a log of so many bytes, which nobody waits for, does not fit there."""
    if log_bytes > (free := free_bytes(target.parent)):
        allowed = f"{log_bytes / 1e9:.3f} GB; make room or name a file on another disk"
        raise ConfigurationError(str(target), [Problem("free disk space", f"{free / 1e9:.3f} GB", allowed)])


def free_bytes(folder: Path) -> float:
    """What is left on the disk of a folder that may not exist yet; infinite where nobody says."""
    try:
        there = next(each for each in (folder.resolve(), *folder.resolve().parents) if each.is_dir())
        return shutil.disk_usage(there).free
    except OSError:  # who makes the folder says why it cannot be
        return math.inf


def too_strong(scenario: Scenario, bench: Bench) -> Iterator[Problem]:
    """What is more force than the bench allows."""
    peak, highest = scenario.drive.peak, bench.actuator.maximum_amplitude
    if peak > highest:
        setting = f"{bench.actuator_table}.maximum_amplitude"
        allowed = f"amplitude and offset together up to {highest:g} N ({setting})"
        yield Problem("drive.amplitude", f"{peak:g} N", allowed)


def unseen_or_too_strong(scenario: Scenario, bench: Bench) -> Iterator[Problem]:
    """What a person may not set, or nobody would see."""
    yield from too_strong(scenario, bench)
    shown, channels = RIGS[bench.rig].channels.drive, [each.name for each in bench.daq_card.channels]
    if shown not in channels:
        allowed = f"{shown}: a drive that is set by hand is believed when it is measured"
        yield Problem("daq_card.channels", ", ".join(channels), allowed)
    elif bench.unseen:
        allowed = "false beside a real person: what they set would be looked for on an emulated rig"
        yield Problem("daq_card.emulated", "true", allowed)


def no_time_for_hands(scenario: Scenario) -> Iterator[Problem]:
    """A drive that a person cannot start at once from phase zero, or none that could be seen."""
    if scenario.acquisition.settle < SOFT_START_FROM_S:
        allowed = f"at least {SOFT_START_FROM_S:g} s: nobody starts a drive by hand in time with the record"
        yield Problem("acquisition.settle", f"{scenario.acquisition.settle:g} s", allowed)
    if scenario.drive.offset or not scenario.drive.amplitude:
        allowed = "an amplitude and no offset, with a drive that is set by hand"
        yield Problem("drive", f"{scenario.drive.amplitude:g} N, offset {scenario.drive.offset:g} N", allowed)


def no_soft_start(scenario: Scenario) -> Iterator[Problem]:
    """An offset without time to come up."""
    if scenario.drive.offset and scenario.acquisition.settle < SOFT_START_FROM_S:
        allowed = f"at least {SOFT_START_FROM_S:g} s with an offset, which is brought up softly"
        yield Problem("acquisition.settle", f"{scenario.acquisition.settle:g} s", allowed)


def too_fast(scenario: Scenario, bench: Bench) -> Iterator[Problem]:
    """What is faster than the bench allows."""
    speed, highest = scenario.drive.speed, bench.actuator.maximum_speed
    if speed > highest * (1 + _ROUNDING):
        allowed = f"up to {_rpm(highest)} ({bench.actuator_table}.maximum_speed)"
        yield Problem("drive.speed", _rpm(speed), allowed)


def no_ramp(scenario: Scenario) -> Iterator[Problem]:
    """No time for a motor to come up."""
    if scenario.acquisition.settle < _LEAST_MOTOR_SETTLE_S:
        allowed = f"at least {_LEAST_MOTOR_SETTLE_S:g} s: a motor comes up on its ramp and settles after it"
        yield Problem("acquisition.settle", f"{scenario.acquisition.settle:g} s", allowed)


def _rpm(speed: float) -> str:
    return f"{speed * 60 / math.tau:g} rpm"


def _channels(rig: str, bench: Bench) -> Iterator[Problem]:
    kind = RIGS[rig]
    for channel in bench.daq_card.channels:
        if kind.channels.unit(channel.name) is None and unit_of(channel.name) is not None:
            key = dotted("daq_card.channels", channel.name)
            yield Problem(key, "(here)", f"a channel of the {kind.name}: {', '.join(kind.channels.told)}")


def _shaft(bench: Bench) -> Iterator[Problem]:
    """What turns is held to its speed by a channel of the card."""
    channels = [channel.name for channel in bench.daq_card.channels]
    if RIGS[bench.rig].turns and shaft_channel(channels) is None:
        allowed = "one that shows the crank turn: its angle on a counter, or its marker"
        yield Problem("daq_card.channels", ", ".join(channels), allowed)


def _chains(bench: Bench, sample_rate: float = math.inf) -> Iterator[Problem]:
    """What the bench says of a channel's chain, and its card, or the speed that it allows, cannot be."""
    turns_hz = bench.actuator.maximum_speed / math.tau if RIGS[bench.rig].turns else 0.0
    fastest = f"at {bench.actuator_table}.maximum_speed"
    for channel in bench.daq_card.channels:
        key, mark, pulses = dotted("daq_card.channels", channel.name), channel.mark, channel.pulses
        yield from _filter(channel, f"{key}.filter.corner", sample_rate)
        if mark is not None and not channel.counted and mark.level > channel.range:
            yield Problem(f"{key}.level", f"{mark.level:g} V", f"up to {channel.range:g} V, its range")
        if pulses is not None and (edges_hz := pulses.per_revolution * turns_hz) > FASTEST_EDGES_HZ:
            told = f"{FASTEST_EDGES_HZ / 1e6:g} MHz, and these are {edges_hz / 1e6:.3g} MHz"
            most = f"up to {int(FASTEST_EDGES_HZ / turns_hz)} {fastest}: a counter follows {told}"
            yield Problem(f"{key}.pulses_per_revolution", str(pulses.per_revolution), most)
    if (encoder := bench.encoder) is not None and encoder.period_s * turns_hz >= 0.5:
        which = "from which on nobody tells which way it went"
        allowed = f"below {500 / turns_hz:.4g} ms: half a turn {fastest}, {which}"
        yield Problem("encoder.period", f"{encoder.period_s * 1e3:g} ms", allowed)


def _filter(channel: CardChannel, key: str, sample_rate: float) -> Iterator[Problem]:
    if channel.anti_alias is None:
        return
    corner, high_pass_hz = channel.anti_alias.corner_hz, getattr(channel.amplifier, "corner_hz", None) or 0.0
    if corner >= sample_rate / 2:
        why = "half of acquisition.sample_rate: from there on it keeps no alias out"
        yield Problem(key, f"{corner:g} Hz", f"below {sample_rate / 2:g} Hz, {why}")
    if corner <= high_pass_hz:
        allowed = f"above {high_pass_hz:g} Hz (amplifier.corner): else the chain passes nothing"
        yield Problem(key, f"{corner:g} Hz", allowed)


def _limits(scenario: Scenario, bench: Bench) -> Iterator[Problem]:
    channels = {channel.name: channel for channel in bench.daq_card.channels}
    for limit in scenario.limits:
        key, channel = dotted("limits", limit.channel), channels.get(limit.channel)
        if bench.unseen:
            yield Problem(key, "(here)", _NOTHING_SEEN)
        elif channel is None:
            near = "" if declared(limit.channel) else meant(limit.channel, channels)
            hint = f" (did you mean {near}?)" if near else ""
            yield Problem(key, "(here)", f"a channel of the bench: {', '.join(channels)}{hint}")
        else:
            for name, level in (("warning", limit.warning), ("abort", limit.abort)):
                allowed = ""
                if limit.unit != channel.unit:
                    allowed = f"in {channel.unit}, the channel's unit"
                elif level is not None and level >= channel.range:
                    allowed = f"below {channel.range:g} {channel.unit}, the channel's range"
                if level is not None and allowed:
                    yield Problem(f"{key}.{name}", f"{level:g} {limit.unit}", allowed)


def _calibrations(bench: Bench, today: datetime.date) -> Iterator[Problem]:
    if bench.daq_card.emulated:
        return
    for channel in bench.daq_card.channels:
        for name, day in channel.expiries.items():
            if day < today:
                key = dotted("daq_card.channels", channel.name)
                yield Problem(f"{key}.{name}", str(day), f"not before today, {today}")

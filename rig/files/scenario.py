"""The scenario file: what is run, on which rig, for how long, within which limits."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic.dataclasses import dataclass

from rig.files.faults import Faults, as_written, dotted, read_toml
from rig.files.fields import FieldError, Measured, Raw, Text, Word
from rig.files.file_kind import read_file
from rig.files.rigs import RIGS
from rig.files.rigs.kind import RigKind
from rig.files.section import SECTION, read_section, sound_values, unknown_keys

# Nyquist with the usual margin for the anti-alias filter of a vibration analyser
SAMPLES_PER_PERIOD = 2.56
_LARGEST_LIMIT = 1e6


@dataclass(frozen=True, slots=True, config=SECTION)
class AcquisitionSection:
    """Sample rate in Hz; `settle` (driven, not recorded) and `duration` (recorded) in s."""

    sample_rate: Annotated[float, Measured("Hz", 1000, 204_800)]
    duration: Annotated[float, Measured("s", 0.001, 86_400)]
    settle: Annotated[float, Measured("s", 0, 3600)] = 1.0


@dataclass(frozen=True, slots=True, config=SECTION)
class _LimitSection:
    warning: Annotated[str | float | None, Raw("a quantity in the channel's unit")] = None
    abort: Annotated[str | float | None, Raw("a quantity in the channel's unit")] = None
    hold: Annotated[float, Measured("s", 0, 60)] = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class Limit:
    """What a channel's absolute value may reach, in its `unit`: a warning, and the end of the run.

    `hold` is how long in s a level must be passed before it counts; a level is None where none was given.
    """

    channel: str
    unit: str
    warning: float | None
    abort: float | None
    hold: float


@dataclasses.dataclass(frozen=True, slots=True)
class Scenario:
    """A checked scenario in SI; `model` and `drive` are its rig's sections, `text` is the file as written."""

    name: str
    rig: str
    model: Any
    drive: Any
    acquisition: AcquisitionSection
    limits: tuple[Limit, ...]
    text: str


_NAME = Text("a text of one line, up to 200 characters")
_RIG = Word(tuple(RIGS))
_KEYS = ("name", "rig", "model", "drive", "acquisition", "limits")


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario file; raises ConfigurationError with every fault in it."""
    return parse_scenario(read_file(path, "scenario"), str(path))


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Read a scenario's text; `source` names it in the ConfigurationError, which lists every fault."""
    table = read_toml(text, source)
    faults = Faults(source)
    unknown_keys(table, _KEYS, "", faults)
    name = _read(_NAME, table, "name", faults) if "name" in table else table.get("rig")
    rig = _read(_RIG, table, "rig", faults)
    kind = RIGS.get(rig or "")
    model: Any = None
    drive: Any = None
    if kind is not None:
        model = read_section(kind.model, table.get("model", {}), "model", faults, kind.model_checks)
        drive = read_section(kind.drive, table.get("drive", {}), "drive", faults, kind.drive_checks)
    acquisition = read_section(AcquisitionSection, table.get("acquisition", {}), "acquisition", faults)
    if rig is None or kind is None:
        raise faults.error()
    limits = tuple(_limits(table.get("limits", {}), kind, faults))
    _check_rate(table, kind, faults)
    if faults or name is None or model is None or drive is None or acquisition is None:
        raise faults.error()
    return Scenario(name, rig, model, drive, acquisition, limits, text)


def _read(field: Text | Word, table: Mapping[str, object], key: str, faults: Faults) -> str | None:
    if key not in table:
        faults.missing(key, field.allowed)
        return None
    try:
        return field.read(table[key])
    except FieldError as error:
        faults.add(key, table[key], str(error))
        return None


def _check_rate(table: Mapping[str, Any], kind: RigKind, faults: Faults) -> None:
    acquisition = table.get("acquisition")
    rate = sound_values(AcquisitionSection, acquisition).get("sample_rate")
    frequency = kind.drive_frequency(sound_values(kind.drive, table.get("drive")))
    if acquisition is None or rate is None or frequency is None:
        return
    lowest = SAMPLES_PER_PERIOD * frequency
    if rate < lowest:
        allowed = f"at least {lowest:g} Hz ({SAMPLES_PER_PERIOD} times the drive's {frequency:g} Hz)"
        faults.add_from(acquisition, "sample_rate", "acquisition", allowed)


def _limits(table: object, kind: RigKind, faults: Faults) -> Iterator[Limit]:
    if not isinstance(table, dict):
        faults.add("limits", table, 'tables such as [limits."contact.force_upper"]')
        return
    for channel, entry in _by_channel(table):
        key = dotted("limits", channel)
        unit = kind.channel_unit(channel)
        if unit is None:
            faults.unknown(key, entry, channel, kind.channels)
            continue
        section = read_section(_LimitSection, entry, key, faults)
        if section is not None:
            yield from _limit(section, channel, unit, key, faults)


def _by_channel(table: dict[str, Any], before: str = "") -> Iterator[tuple[str, object]]:
    """Channels and their limits; `[limits.contact.force_upper]` without quotes means the same channel."""
    for key, entry in table.items():
        name = f"{before}.{key}" if before else key
        if isinstance(entry, dict) and entry and all(isinstance(inner, dict) for inner in entry.values()):
            yield from _by_channel(entry, name)
        else:
            yield name, entry


def _limit(section: _LimitSection, channel: str, unit: str, key: str, faults: Faults) -> Iterator[Limit]:
    level = Measured(unit, 0, _LARGEST_LIMIT, above=True)
    levels: dict[str, float | None] = {}
    sound = True
    for name, given in (("warning", section.warning), ("abort", section.abort)):
        try:
            levels[name] = None if given is None else level.read(given)
        except FieldError as error:
            faults.add(f"{key}.{name}", given, str(error))
            sound = False
    if not sound:
        return
    warning, abort = levels["warning"], levels["abort"]
    if warning is None and abort is None:
        faults.missing(key, "warning or abort, or both")
    elif warning is not None and abort is not None and warning > abort:
        faults.add(f"{key}.warning", section.warning, f"not above abort, {as_written(section.abort)}")
    else:
        yield Limit(channel, unit, warning, abort, section.hold)

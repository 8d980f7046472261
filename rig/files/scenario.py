"""The scenario file: what is run, on which rig, for how long, within which limits."""

from __future__ import annotations

import copy
import datetime
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final

from daq.quantity import REQUIRED, Depending, Quantity, Setting, Text, settings_of
from drivers.ni_daq.sensors import ANY_UP_TO
from rig.files.faults import Faults, as_written, dotted, read_toml, toml_of
from rig.files.file_kind import read_file
from rig.files.lab_tolerances import lab_tolerances
from rig.files.quantity import QuantityError, si_unit, written
from rig.files.table import (
    FieldError,
    field_of,
    read_table,
    read_values,
    sound_values,
    unknown_keys,
)
from rig.rigs import RIGS, declared
from rig.rigs.kind import RigKind
from sim_twin.healthy import Tolerance

# Nyquist with the usual margin for the anti-alias filter of a vibration analyser
SAMPLES_PER_PERIOD: Final = 2.56
LEVEL_UP_TO: Final = 1e6
"""Of a limit or a level, in the channel's unit."""


@dataclass(frozen=True, slots=True)
class AcquisitionSection:
    """Sample rate in Hz; `settle` (driven, not recorded) and `duration` (recorded) in s."""

    sample_rate: Annotated[float, Quantity("Hz", 1000, 204_800, usual=25_600)]
    duration: Annotated[float, Quantity("s", 0.001, 86_400, usual=5)]
    settle: Annotated[float, Quantity("s", 0, 3600)] = 1.0


@dataclass(frozen=True, slots=True)
class Limit:
    """What a channel's absolute value may reach, in its `unit`: a warning, and the end of the run.

    `hold` is how long in s a level must be passed before it counts; a level is None where none was given.
    """

    channel: str
    unit: str
    warning: float | None
    abort: float | None
    hold: Annotated[float, Quantity("s", 0, 60)] = 0.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """A checked scenario in SI; `text` is the file as written.

    `model` holds what the operator says of the rig, by key of [model]: what is not there is nominal. `drive`
    is what the rig's physics calls its drive. `notes` say what a run was (operator, specimen, whatever a lab
    calls it), by keys of its own; only whether runs are of one rig depends on them. `widths` and
    `besides` are those of its twin, of [tolerances].
    """

    name: str
    rig: str
    model: Mapping[str, Any]
    drive: Any
    acquisition: AcquisitionSection
    limits: tuple[Limit, ...]
    text: str
    notes: Mapping[str, str] = field(default_factory=dict)
    widths: Mapping[str, float] = field(default_factory=dict)
    besides: tuple[Tolerance, ...] = ()

    @property
    def specimen(self) -> str | None:
        """What was run, by its notes, where they say it."""
        return self.notes.get("specimen")


_LONGEST_NAME: Final = 200
_ONE_LINE: Final = Text("a text of one line, up to 200 characters", longest=_LONGEST_NAME)
_NAME: Final = field_of(Setting("name", "name", str, REQUIRED, _ONE_LINE))
_NOTE: Final = field_of(Setting("note", "note", str, REQUIRED, Text("a text of one line", longest=500)))
_NOTE_KEY: Final = re.compile(r"[\w-]{1,60}")
_KEYS: Final = ("name", "rig", "model", "drive", "acquisition", "limits", "notes", "tolerances")


def load_scenario(path: str | Path, settings: Mapping[str, object] | None = None) -> Scenario:
    """Read a scenario file, some keys with other values; raises ConfigurationError with every fault in it."""
    text, source = read_file(path, "scenario"), str(path)
    if not settings:
        return parse_scenario(text, source)
    table = with_values(read_toml(text, source), settings)
    said = ", ".join(f"{key} = {as_written(value)}" for key, value in settings.items())
    if isinstance(name := table.get("name", table.get("rig")), str) and "name" not in settings:
        table["name"] = ", ".join([name, *_of_its_rig(settings)])[:_LONGEST_NAME]
    return scenario_of(table, f"{source} with {said}", f"# {Path(path).name} with {said}\n{toml_of(table)}")


def _of_its_rig(settings: Mapping[str, object]) -> Iterator[str]:
    """Those that make it another scenario, in words for its name."""
    for key, value in settings.items():
        section, _, name = key.partition(".")
        if section in ("model", "drive"):
            yield f"{name.replace('_', ' ')} {str(value).strip()}"


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Read a scenario's text; `source` names it in the ConfigurationError, which lists every fault."""
    return scenario_of(read_toml(text, source), source, text)


def scenario_of(table: Mapping[str, Any], source: str, text: str | None = None) -> Scenario:
    """The scenario that a file's table holds; its text is written anew where none is given.

    Raises ConfigurationError with every fault.
    """
    faults = Faults(source)
    unknown_keys(table, _KEYS, "", faults)
    name = rig = table.get("rig")
    if "name" in table:
        try:
            name = _NAME.read(table["name"])
        except FieldError as error:
            faults.add("name", table["name"], str(error))
    kind = RIGS[rig] if isinstance(rig, str) and rig in RIGS else None
    if kind is None:
        faults.add_from(table, "rig", "", " or ".join(f'"{name}"' for name in RIGS))
    model: Any = None
    drive: Any = None
    if kind is not None:
        model = read_values(kind.model, table.get("model", {}), "model", faults, kind.checks)
        drive = read_table(kind.drive, table.get("drive", {}), "drive", faults)
    acquisition = read_table(AcquisitionSection, table.get("acquisition", {}), "acquisition", faults)
    if kind is None:
        raise faults.error()
    limits = tuple(_limits(table.get("limits", {}), kind, faults))
    notes = dict(_notes(table.get("notes", {}), faults))
    differing = {} if model is None else table.get("tolerances", {})
    widths, besides = lab_tolerances(kind, model, differing, faults)
    given = table.get("acquisition")
    rate = sound_values(settings_of(AcquisitionSection), given).get("sample_rate")
    frequency = kind.cycle_hz(sound_values(settings_of(kind.drive), table.get("drive")))
    if given is not None and rate is not None and frequency is not None:
        lowest = SAMPLES_PER_PERIOD * frequency
        if rate < lowest:
            allowed = f"at least {lowest:g} Hz ({SAMPLES_PER_PERIOD} times the drive's {frequency:g} Hz)"
            faults.add_from(given, "sample_rate", "acquisition", allowed)
    if faults or name is None or acquisition is None:
        raise faults.error()
    return Scenario(
        name, kind.name, model, drive, acquisition, limits, text or toml_of(table), notes, widths, besides
    )


def edited(scenario: Scenario, settings: Mapping[str, object], source: str) -> Scenario:
    """The scenario with other values behind some keys, such as drive.frequency; raises like `scenario_of`."""
    return scenario_of(with_values(read_toml(scenario.text, scenario.name), settings), source)


def with_values(table: Mapping[str, Any], settings: Mapping[str, object]) -> dict[str, Any]:
    """A scenario's table with the values of `settings` (by key, such as drive.frequency) in it."""
    changed: dict[str, Any] = copy.deepcopy(dict(table))
    for key, value in settings.items():
        held, name = changed, key
        while "." in name and isinstance(held, dict):  # anything else is told as a fault
            # a channel with limits may stand there as one key, dots and all
            inner = max((each for each in held if name.startswith(f"{each}.")), key=len, default="")
            section = inner or name.partition(".")[0]
            held, name = held.setdefault(section, {}), name.removeprefix(f"{section}.")
        if isinstance(held, dict):
            held[name] = value
    return changed


def _notes(table: object, faults: Faults) -> Iterator[tuple[str, str]]:
    if not isinstance(table, dict):
        faults.add("notes", table, 'a table such as operator = "Ada"')
        return
    for key, value in table.items():
        if not _NOTE_KEY.fullmatch(key):
            faults.add(dotted("notes", key), value, "a key of letters, digits, _ and -, up to 60 of them")
            continue
        plain = isinstance(value, str | int | float | datetime.date | datetime.time)
        try:
            yield key, _NOTE.read(str(value) if plain else value)
        except FieldError as error:
            faults.add(dotted("notes", key), value, str(error))


def _limits(table: object, kind: RigKind, faults: Faults) -> Iterator[Limit]:
    if not isinstance(table, dict):
        faults.add("limits", table, 'tables such as [limits."contact.force_upper"]')
        return
    for channel, entry in _by_channel(table):
        key = dotted("limits", channel)
        unit, known = kind.channels.unit(channel), declared(channel) is not None
        why = "" if known else _OF_ITS_OWN
        if not known:
            try:
                unit = _unit_of_its_own(entry)
            except (QuantityError, OverflowError) as error:
                why = f"{_OF_ITS_OWN} ({error})"
        if unit is None:
            faults.unknown(key, entry, channel, kind.channels.told, more=why)
        else:
            yield from _limit(channel, unit, entry, key, faults, LEVEL_UP_TO if known else ANY_UP_TO)


_OF_ITS_OWN: Final = '; of a channel that no rig has, a level with its unit, such as "94 Pa"'


def _unit_of_its_own(entry: object) -> str:
    """The unit of a level of a channel that only a bench knows; raises QuantityError."""
    levels = entry if isinstance(entry, dict) else {}
    return si_unit(written(levels.get("abort", levels.get("warning", "")))[1])


def _by_channel(table: dict[str, Any], before: str = "") -> Iterator[tuple[str, object]]:
    """Channels and their limits; `[limits.contact.force_upper]` without quotes means the same channel."""
    for key, entry in table.items():
        name = f"{before}.{key}" if before else key
        if isinstance(entry, dict) and entry and all(isinstance(inner, dict) for inner in entry.values()):
            yield from _by_channel(entry, name)
        else:
            yield name, entry


def _limit(channel: str, unit: str, entry: object, key: str, faults: Faults, up_to: float) -> Iterator[Limit]:
    level = Depending("a quantity in the channel's unit", lambda _: Quantity(unit, 0, up_to, above=True))
    levels = {name: Setting(name, name, float | None, None, level) for name in ("warning", "abort")}
    values = read_values({**levels, **settings_of(Limit)}, entry, key, faults)
    if values is None:
        return
    warning, abort = values.get("warning"), values.get("abort")
    if warning is None and abort is None:
        faults.missing(key, "warning or abort, or both")
    elif warning is not None and abort is not None and warning > abort:
        written: Any = entry
        faults.add(f"{key}.warning", written["warning"], f"not above abort, {as_written(written['abort'])}")
    else:
        yield Limit(channel, unit, warning, abort, values.get("hold", 0.0))

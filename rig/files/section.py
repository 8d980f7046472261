"""Reads one table of a file into its section class and notes every fault in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError

from rig.files.faults import Faults, dotted
from rig.files.fields import Field, FieldError

SECTION = ConfigDict(extra="forbid")
Section = TypeVar("Section")


@dataclasses.dataclass(frozen=True, slots=True)
class Check:
    """A check over several keys of one table.

    `find` gets the table's sound values in SI by key, and is called only where all of `keys` are among them.
    It yields the key at fault within the table, and what may stand there.
    """

    keys: tuple[str, ...]
    find: Callable[[Mapping[str, Any]], Iterator[tuple[str, str]]]


def read_section(
    section: type[Section], table: object, key: str, faults: Faults, checks: Iterable[Check] = ()
) -> Section | None:
    """Return the section, or None after noting in `faults` all that is wrong with it under the full `key`."""
    if not isinstance(table, dict):
        faults.add(key, table, f"a table [{key}]")
        return None
    read = None
    try:
        read = _adapter(section).validate_python(table)
    except ValidationError as error:
        for fault in error.errors(include_url=False):
            _note(section, fault, key, faults)
    crossed = list(_cross_problems(section, table, checks))
    for name, allowed in crossed:
        faults.add_from(table, name, key, allowed)
    return None if crossed else read


def sound_values(section: type[Any], table: object) -> dict[str, Any]:
    """Values in SI of the keys of a table that are right, defaults included, whatever the others hold."""
    values: dict[str, Any] = {}
    given = table if isinstance(table, dict) else {}
    for entry in dataclasses.fields(section):
        if entry.name not in given:
            if entry.default is not dataclasses.MISSING:
                values[entry.name] = entry.default
            continue
        try:
            values[entry.name] = field_of(section, entry.name).read(given[entry.name])
        except FieldError:
            continue
    return values


def unknown_keys(table: dict[str, Any], known: Iterable[str], key: str, faults: Faults) -> None:
    """Note every key of `table` that is not known."""
    names = list(known)
    for name in table:
        if name not in names:
            faults.unknown(dotted(key, name), table[name], name, names)


def _adapter(section: type[Section]) -> TypeAdapter[Section]:
    return TypeAdapter(section)


def field_of(section: type[Any], name: str) -> Field:
    """What may stand behind a key of a section."""
    hint = get_type_hints(section, include_extras=True)[name]
    return next(entry for entry in hint.__metadata__ if isinstance(entry, Field))


def _cross_problems(
    section: type[Any], table: dict[str, Any], checks: Iterable[Check]
) -> Iterator[tuple[str, str]]:
    values = sound_values(section, table) if checks else {}
    for check in checks:
        if values.keys() >= set(check.keys):
            yield from check.find(values)


def _note(section: type[Any], fault: Any, key: str, faults: Faults) -> None:
    name = str(fault["loc"][0])
    full = dotted(key, name)
    known = [field.name for field in dataclasses.fields(section)]
    if name not in known:
        faults.unknown(full, fault["input"], name, known)
    elif fault["type"].startswith("missing"):
        faults.missing(full, field_of(section, name).allowed)
    else:
        faults.add(full, fault["input"], fault["msg"])

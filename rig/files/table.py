"""Reads one table of a file into the class that its settings are declared in, and notes every fault in it."""

from __future__ import annotations

import datetime
import functools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, TypeVar, Union, get_args, get_origin

from annotated_types import Ge, Le
from pydantic import AfterValidator, PlainValidator, Strict, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from daq.quantity import (
    REQUIRED,
    Check,
    Depending,
    Quantity,
    Samples,
    Setting,
    Text,
    Whole,
    Words,
    members,
    settings_of,
)
from rig.files.faults import Faults, dotted
from rig.files.quantity import QuantityError, si_factor, si_value, written

Section = TypeVar("Section")
NOTHING: Final[Mapping[str, Any]] = MappingProxyType({})
_ROUNDING: Final = 1e-9  # "10 mm" must pass a limit of 0.01 m
_KEPT_DIGITS: Final = 9  # so that the way through SI adds nothing that a limit would be short of
_EXPLAINED: Final = "explained"
_BY_TYPE: Final[Mapping[Any, str]] = {
    bool: "true or false",
    datetime.date: "a date without quotes, such as 2026-05-04",
}


class FieldError(ValueError):
    """The value may not stand there; the text says what may."""


@dataclass(frozen=True, slots=True)
class Field:
    """How one setting is read: `allowed` is what may stand there, in the operator's words."""

    allowed: str
    adapter: TypeAdapter[Any]
    meaning: object = None

    def read(self, value: object) -> Any:
        try:
            return self.adapter.validate_python(value)
        except ValidationError as error:
            faults = error.errors(include_url=False)
            explained = len(faults) == 1 and faults[0]["type"] == _EXPLAINED
            raise FieldError(faults[0]["msg"] if explained else self.allowed) from error


@functools.cache
def field_of(setting: Setting) -> Field:
    """The reader of a setting, made from its declaration."""
    meaning, kinds = setting.meaning, members(setting.type)
    said = [
        " or ".join(f'"{word}"' for word in get_args(kind))
        if get_origin(kind) is Literal
        else str(_in_samples(meaning))
        if kind is Samples
        else _BY_TYPE.get(kind, str(meaning))
        for kind in kinds
    ]
    allowed = meaning.meaning if isinstance(meaning, Text | Depending) else ", or ".join(said)
    readable: Any = Union[tuple(_readable(kind, meaning) for kind in kinds)]  # noqa: UP007 - made of a tuple
    return Field(allowed, TypeAdapter(readable), meaning)


def quantity_field(quantity: Quantity) -> Field:
    """The reader of a quantity whose unit came up only now."""
    return field_of(Setting("", "", float, REQUIRED, quantity))


def _readable(kind: Any, meaning: object) -> Any:
    """A type that pydantic checks as the declaration says."""
    match meaning:
        case Quantity() if kind is float:
            return Annotated[float, PlainValidator(functools.partial(_in_si, meaning))]
        case Quantity() if kind is Samples:
            return Annotated[Samples, PlainValidator(functools.partial(_samples, _in_samples(meaning)))]
        case Quantity() if get_origin(kind) is tuple:
            count = None if Ellipsis in get_args(kind) else len(get_args(kind))
            return Annotated[Any, PlainValidator(functools.partial(_each_in_si, meaning, count))]
        case Words():
            return Annotated[Any, PlainValidator(functools.partial(_word, meaning))]
        case Depending():
            return Annotated[Any, PlainValidator(functools.partial(_raw, meaning))]
        case Whole() if kind is int:
            return Annotated[int, Strict(), Ge(meaning.low), Le(meaning.high)]
        case Text() if kind in (str, Path):
            matching = AfterValidator(functools.partial(_matching, meaning))
            return Annotated[str, Strict(), matching, AfterValidator(lambda text: kind(text))]
    if get_origin(kind) is tuple:
        inner = get_args(kind)[0]
        return tuple[Annotated[inner, Strict()], ...]  # type: ignore[valid-type]
    return kind if get_origin(kind) is Literal else Annotated[kind, Strict()]


def _explained(text: str) -> PydanticCustomError:
    return PydanticCustomError(_EXPLAINED, "{text}", {"text": text})


def _in_si(quantity: Quantity, value: object) -> float:
    """Return the value in SI, or in the quantity's unit where it is kept so."""
    try:
        match value:
            case bool():
                raise QuantityError("not a number")
            case int() | float() if units := quantity.two_units:
                raise QuantityError(f"the unit is missing: {units}")
            case int() | float():
                si = float(value)
            case str():
                si = si_value(value, quantity.unit)
            case _:
                raise QuantityError("not a number with a unit")
    except QuantityError as error:
        raise _explained(f"{quantity} ({error})") from error
    except OverflowError as error:
        raise _explained(str(quantity)) from error
    scale = si_factor(quantity.unit)
    low, high = quantity.low * scale, quantity.high * scale
    slack = _ROUNDING * max(abs(low), abs(high))
    inside = low - (0.0 if quantity.above else slack) <= si <= high + slack
    if not inside or (quantity.above and si <= low):
        raise _explained(str(quantity))
    return round(si / scale, _KEPT_DIGITS) if quantity.kept else si


def _in_samples(quantity: Any) -> Quantity:
    """What the same setting may be, counted in samples."""
    return Quantity("samples", 0, quantity.samples)


def _samples(quantity: Quantity, value: object) -> Samples:
    """So many "39 samples"; no unit of a kind that any other is of."""
    try:
        count, unit = written(value) if isinstance(value, str) else (math.nan, "")
    except QuantityError as error:
        raise _explained(str(quantity)) from error
    if unit not in ("samples", "sample") or not quantity.low <= count <= quantity.high:
        raise _explained(str(quantity))
    return Samples(count)


def _each_in_si(quantity: Quantity, count: int | None, values: object) -> tuple[float, ...]:
    """So many of them, or any number, in SI."""
    if not isinstance(values, list) or count not in (None, len(values)):
        raise _explained(f"a list{'' if count is None else f' of {count}'}, each {quantity}")
    return tuple(_in_si(quantity, value) for value in values)


def _raw(meaning: Depending, value: object) -> object:
    """A text or number as written, until its unit is known."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if number or isinstance(value, str):
        return value
    raise _explained(meaning.meaning)


def _word(words: Words, value: object) -> Any:
    if not isinstance(value, str) or value not in words.values:
        raise _explained(str(words))
    return words.values[value] if isinstance(words.values, Mapping) else value


def _matching(text: Text, value: str) -> str:
    if len(value) > text.longest or not re.fullmatch(text.pattern, value):
        raise ValueError(text.meaning)
    return value


def read_table(
    owner: Callable[..., Section], table: object, key: str, faults: Faults, more: Mapping[str, Any] = NOTHING
) -> Section | None:
    """What `owner` makes of a table; None after noting in `faults` all that is wrong with it.

    `key` is the table's full name. `more` are settings that no file gives, which checks and units hang on.
    """
    known = settings_of(owner)
    values = read_values(known, table, key, faults, getattr(owner, "CHECKS", ()), more)
    if values is None:
        return None
    meant = {
        each.name: each.default
        for each in known.values()
        if each.default is not REQUIRED and each.part is None and not isinstance(each.meaning, Depending)
    }
    given = {known[name].name: value for name, value in values.items()}
    made = {name: value for name, value in given.items() if "." not in name}
    parts = {each.name.partition(".")[0]: each.part for each in known.values() if each.part is not None}
    for name, part in parts.items():
        of_part = {
            full.partition(".")[2]: value for full, value in given.items() if full.startswith(f"{name}.")
        }
        if of_part:
            made[name] = part(**of_part)
    return owner(**meant | made | dict(more))


def read_values(
    known: Mapping[str, Setting],
    table: object,
    key: str,
    faults: Faults,
    checks: Iterable[Check] = (),
    more: Mapping[str, Any] = NOTHING,
) -> dict[str, Any] | None:
    """The values that a table gives, by key; None after noting in `faults` all that is wrong with it."""
    if not isinstance(table, dict):
        faults.add(key, table, f"a table [{key}]")
        return None
    before, values = len(faults), dict[str, Any]()
    for name, setting in known.items():
        full, field = dotted(key, name), None if is_dataclass(members(setting.type)[0]) else field_of(setting)
        if name not in table:
            if setting.default is REQUIRED:
                faults.missing(full, "" if field is None else field.allowed)
        elif field is None:
            values[name] = None
            if isinstance(table[name], dict):
                values[name] = read_table(members(setting.type)[0], table[name], full, faults)
            else:
                faults.add(full, table[name], str(setting.meaning) or f"a table [{full}]")
        else:
            try:
                values[name] = field.read(table[name])
            except FieldError as error:
                faults.add(full, table[name], str(error))
    unknown_keys(table, known, key, faults)
    for name, allowed in _cross_problems(_with_defaults(known, values, table) | dict(more), table, checks):
        faults.add_from(table, name, key, allowed)
    if len(faults) == before:
        _read_depending(known, values, table, key, faults, more)
    return values if len(faults) == before else None


def _cross_problems(
    sound: Mapping[str, Any], table: Mapping[str, Any], checks: Iterable[Check]
) -> Iterator[tuple[str, str]]:
    for check in checks:
        if sound.keys() >= set(check.keys):
            for at, allowed in check.find(sound):
                keys = (at,) if isinstance(at, str) else at
                yield next((key for key in keys if key in table), keys[0]), allowed


def _with_defaults(
    known: Mapping[str, Setting], values: Mapping[str, Any], table: Mapping[str, Any]
) -> dict[str, Any]:
    left = {
        key: None if isinstance(each.meaning, Depending) else each.default
        for key, each in known.items()
        if key not in table
    }
    return {key: value for key, value in left.items() if value is not REQUIRED} | dict(values)


def _read_depending(
    known: Mapping[str, Setting],
    values: dict[str, Any],
    table: Mapping[str, Any],
    key: str,
    faults: Faults,
    more: Mapping[str, Any],
) -> None:
    """Give those quantities their units that hang on the other settings, all of which are sound."""
    sound = _with_defaults(known, values, table) | dict(more)
    for name, setting in known.items():
        if name not in values or not isinstance(setting.meaning, Depending):
            continue
        quantity = setting.meaning.quantity(sound)
        try:
            raw = values.pop(name)
            if quantity is not None:
                values[name] = quantity_field(quantity).read(raw)
        except FieldError as error:
            faults.add(dotted(key, name), table[name], str(error))


def sound_values(known: Mapping[str, Setting], table: object) -> dict[str, Any]:
    """Values by key of what is right in a table, defaults included, whatever the others hold."""
    given = table if isinstance(table, dict) else {}
    values: dict[str, Any] = {}
    read_into = Faults("")
    for name in known.keys() & given.keys():
        one = read_values({name: known[name]}, {name: given[name]}, "", read_into)
        values |= one or {}
    return _with_defaults(known, values, given)


def unknown_keys(table: Mapping[str, Any], known: Iterable[str], key: str, faults: Faults) -> None:
    """Note every key of `table` that is not known."""
    names = list(known)
    for name in table:
        if name not in names:
            faults.unknown(dotted(key, name), table[name], name, names)

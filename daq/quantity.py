"""What may stand for a setting: metadata of its annotation, written once beside its type and its default.

    clearance: Annotated[float, Quantity("mm", 0.001, 10), Bound("m", 0.0)] = 0.127e-3

Readers of files, checks of parameters and pages read it there. A file may give what has one of the meanings
below, and nothing else of a class.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterator, KeysView, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from inspect import Parameter, signature
from types import NoneType, UnionType
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")
REQUIRED: Final = MISSING
"""The default of a setting that has none."""


_TWO_UNITS: Final = {"rpm or rad/s": "rpm|rad/s", "deg or rad": "^(deg|rad)$", "m/s2 or g": "m/s2"}
"""Of a speed and an acceleration also where something is for each of them, such as the volts of a sensor."""


@dataclass(frozen=True, slots=True)
class Samples:
    """A time as so many periods of the sample clock, which are as many whatever its rate."""

    count: float


def seconds(time: float | Samples | None, rate_hz: float) -> float:
    """A time in s where the clock goes at `rate_hz`; 0 for none."""
    return time.count / rate_hz if isinstance(time, Samples) else time or 0.0


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a person may ask for: a number from `low` to `high` in `unit`; `above` leaves `low` itself out.

    The setting itself is in SI, or in `unit` where its name ends with it (`kept`). `key` is its name in a
    file, if that is another one; `default` what a file that lacks it means, where the class has no default of
    its own. `usual`, in `unit`, is what a file that shows every key has for one without a default. A time
    whose type has `Samples` too may be up to `samples` of them instead. `means` says what it is, where its
    name leaves that open.
    """

    unit: str
    low: float
    high: float
    above: bool = False
    kept: bool = False
    key: str = ""
    default: float | None = None
    usual: float | None = None
    samples: float = 0.0
    means: str = ""

    @property
    def two_units(self) -> str:
        """The two usual units of its kind, so that a bare number is an error; empty where there is one."""
        unit = self.unit.replace("^", "")
        return next((told for told, known in _TWO_UNITS.items() if re.search(known, unit)), "")

    def __str__(self) -> str:
        low, high = (f"{bound:g} {self.unit}".strip() for bound in (self.low, self.high))
        return f"above {low}, up to {high}" if self.above else f"{low} to {high}"


@dataclass(frozen=True, slots=True)
class Bound:
    """What a part can be at all, whoever asks: from `low` to `high` in `unit` (SI); `above` leaves out `low`.

    Wider than what a file may ask for, since effects and tolerances move a parameter.
    """

    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    above: bool = False

    def holds(self, value: float) -> bool:
        """Whether a part can be so."""
        return (
            math.isfinite(value) and self.low <= value <= self.high and not (self.above and value == self.low)
        )

    def __str__(self) -> str:
        first = f"{'above' if self.above else 'at least'} {self.low:g}"
        last = "" if math.isinf(self.high) else f", at most {self.high:g}"
        return f"{first}{last} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Whole:
    """A whole number from `low` to `high`; `key` as that of a Quantity."""

    low: int
    high: int
    key: str = ""

    def __str__(self) -> str:
        return f"a whole number from {self.low} to {self.high}"


@dataclass(frozen=True, slots=True)
class Text:
    """What is said of a setting; a text has to match `pattern` and be no longer than `longest`."""

    meaning: str
    pattern: str = r"[^\x00-\x1f\x7f]*"
    longest: int = 200
    key: str = ""
    default: str | None = None

    def __str__(self) -> str:
        return self.meaning


@dataclass(frozen=True, slots=True)
class Depending:
    """A quantity whose unit hangs on other settings of its table; `meaning` says it while they are not known.

    `quantity(sound values of the table)` is what it may be, None where it is not looked at. While its unit is
    not known it has no default either.
    """

    meaning: str
    quantity: Callable[[Mapping[str, Any]], Quantity | None]
    key: str = ""

    def __str__(self) -> str:
        return self.meaning


@dataclass(frozen=True, slots=True)
class Key:
    """A setting whose type says all: a `Literal`, a bool, a date, a table; `key` as that of a Quantity."""

    key: str = ""

    def __str__(self) -> str:
        return ""


@dataclass(frozen=True, slots=True)
class Words:
    """One of a few words, each with the value that it stands for; `key` as that of a Quantity.

    The keys of a table stand for themselves, those that are added to it later too.
    """

    values: Mapping[str, Any] | KeysView[str]
    key: str = ""

    def __str__(self) -> str:
        return " or ".join(f'"{word}"' for word in self.values)

    def __hash__(self) -> int:
        return hash((tuple(self.values), self.key))


@dataclass(frozen=True, slots=True)
class Flat:
    """A part whose settings stand in the table of the whole, their keys behind `prefix`.

    It is there where any of them is given. `part` is its class, where the field may be several; `source` is
    that of what says none of its own.
    """

    prefix: str = ""
    part: type[Any] | None = None
    source: str = ""
    key: str = ""


@dataclass(frozen=True, slots=True)
class Each:
    """Parts of one class in a mapping: for each key of `prefixes` in it those settings, behind its prefix."""

    prefixes: Mapping[str, str]
    key: str = ""

    def __hash__(self) -> int:
        return hash(tuple(self.prefixes.items()))


@dataclass(frozen=True, slots=True)
class Source:
    """Where the default of a setting is from, for people."""

    text: str


Meaning = Quantity | Whole | Text | Depending | Key | Words | Flat | Each


@dataclass(frozen=True, slots=True)
class Check:
    """A check over several settings of one table; a class has its own in a class variable `CHECKS`.

    `find` gets the table's sound values by key, defaults included, and is called only where all of `keys` are
    among them. It yields the key at fault (of several the first that the file gives), and what may stand
    there.
    """

    keys: tuple[str, ...]
    find: Callable[[Mapping[str, Any]], Iterator[tuple[str | tuple[str, ...], str]]]


def rule(
    keys: tuple[str, ...],
    sound: Callable[[Mapping[str, Any]], bool],
    fault: str | tuple[str, ...],
    allowed: str | Callable[[Mapping[str, Any]], str],
) -> Check:
    """The check that the values are `sound`; else `fault` is the key at fault, and `allowed` may stand there.

    A key in braces in `allowed` is that setting's value; it may also be made from all of them.
    """

    def find(values: Mapping[str, Any]) -> Iterator[tuple[str | tuple[str, ...], str]]:
        if not sound(values):
            yield fault, allowed.format_map(values) if isinstance(allowed, str) else allowed(values)

    return Check(keys, find)


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting of a class or function: its `name` there, its `key` in a file, `type`, default, meaning.

    That of a flat `part` has the part's name and a dot before its own. `place` leads to it, step by step;
    `source` is where its default is from, empty where nobody says.
    """

    name: str
    key: str
    type: Any
    default: Any
    meaning: Meaning
    part: type[Any] | None = None
    place: tuple[str, ...] = ()
    source: str = ""


def _cached(function: Callable[[Any], T]) -> Callable[[Any], T]:
    """`functools.cache` for any argument; to mypy a `type[Any]` is not hashable."""
    return functools.cache(function)


@_cached
def settings_of(owner: Any) -> Mapping[str, Setting]:
    """What a file may give of a dataclass or a function's parameters, by key, required ones first."""
    hints = get_type_hints(owner, include_extras=True)
    found: list[Setting] = []
    for name, default in _defaults(owner).items():
        hint, meaning = hints[name], _metadata(hints[name], Meaning)
        if isinstance(meaning, Flat):
            part = meaning.part or members(hint.__origin__)[0]
            found += _inner(part, meaning.prefix, (name,), meaning.source)
        elif isinstance(meaning, Each):
            part = get_args(hint.__origin__)[1]
            for held, prefix in meaning.prefixes.items():
                found += _inner(part, prefix, (name, held), "")
        elif meaning is not None:
            own, source = getattr(meaning, "default", None), _metadata(hint, Source)
            found.append(
                Setting(
                    name,
                    meaning.key or name,
                    hint.__origin__,
                    default if own is None else own,
                    meaning,
                    place=(name,),
                    source="" if source is None else source.text,
                )
            )
    return {each.key: each for each in sorted(found, key=lambda each: each.default is not REQUIRED)}


def _inner(part: Any, prefix: str, place: tuple[str, ...], source: str) -> Iterator[Setting]:
    """The settings of a part that lies at a place of the whole."""
    for each in settings_of(part).values():
        yield replace(
            each,
            name=f"{place[0]}.{each.name}",
            key=prefix + each.key,
            default=None,
            part=part,
            place=(*place, *each.place),
            source=each.source or source,
        )


def part_checks(owner: Any, prefix: str, word: str, without: str) -> tuple[Check, ...]:
    """That the keys of a part, behind `prefix`, are given only where `word` is another than `without`."""

    def has(key: str, values: Mapping[str, Any]) -> bool:
        return values[key] is None or values[word] != without

    allowed = f"none, or with another {word} than {without}, which has none"
    keys = (key for key in settings_of(owner) if key.startswith(prefix))
    return tuple(rule((word, key), functools.partial(has, key), key, allowed) for key in keys)


@_cached
def bounds_of(owner: Any) -> Mapping[str, Bound]:
    """What the fields of a dataclass can be at all, by name."""
    hints = get_type_hints(owner, include_extras=True)
    found = {name: _metadata(hint, Bound) for name, hint in hints.items()}
    return {name: bound for name, bound in found.items() if bound is not None}


def _defaults(owner: Callable[..., Any]) -> dict[str, Any]:
    if is_dataclass(owner):
        made = {each.name: each.default_factory for each in fields(owner) if each.init}
        plain = {each.name: each.default for each in fields(owner) if each.init}
        return {
            name: REQUIRED if default is REQUIRED and made[name] is REQUIRED else default
            for name, default in plain.items()
        }
    return {
        each.name: REQUIRED if each.default is Parameter.empty else each.default
        for each in signature(owner).parameters.values()
    }


def _metadata(hint: Any, kind: Any) -> Any:
    """The metadata of an annotation that is of a kind; None without."""
    held = hint.__metadata__ if get_origin(hint) is Annotated else ()
    return next((each for each in held if isinstance(each, kind)), None)


def members(plain: Any) -> tuple[Any, ...]:
    """The types of a union but None; a type by itself is its only one."""
    if get_origin(plain) in (Union, UnionType):
        return tuple(each for each in get_args(plain) if each is not NoneType)
    return (plain,)

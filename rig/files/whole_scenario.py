"""A scenario with every key of a rig: its default, unit, range and source, as a file that can be run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from inspect import signature
from itertools import product
from typing import Any, Final, Literal, get_args, get_origin

from daq.errors import UnphysicalParameter
from daq.quantity import REQUIRED, Quantity, Setting, members, settings_of
from rig.files.faults import as_written, toml_key
from rig.files.quantity import si_factor, si_value
from rig.files.scenario import AcquisitionSection
from rig.files.table import field_of
from rig.rigs.kind import RigKind, at

_COLUMN: Final = 44
_MOST_DIGITS: Final = 16
_SPARED: Final = 3
_HEAD: Final = """\
# Every key of a scenario of the {rig}. What stands here is the default: a scenario needs
# only what is to be otherwise. Behind each: what may stand there; where the default is from. A key that
# another one decides is commented out, with what decides it; give it, and it stands whatever the other says.
"""
_TOLERANCES: Final = """\
# How far healthy rigs differ, as standard deviations, where this lab's do so by more or less than these
# (assumed, a good workshop's; up to fifty times as much). Besides them may stand any other number of a part
# of the rig: with a share of it (up to 30 %); an angle, and what is 0 or may lie to either side, in its unit.
# [tolerances]"""
_LIMITS: Final = """\
# Limits, for each of its channels that shall have some: {channels}
# [limits."{channel}"]
# warning = "..."                           # a quantity in the channel's unit: told once it is passed
# abort = "..."                             # and this ends the run
# hold = "0 s"                              # for how long it must be passed
"""
_NOTES: Final = """\
# What was run, in words and under keys of the lab's own (also --note KEY=VALUE); they stand in the log.
# [notes]
# operator = "..."
# specimen = "..."                          # runs of two specimens are no campaign
"""


def whole_scenario(kind: RigKind) -> str:
    """The text; what it holds is read as the scenario of the rig as its source has it."""
    lines = [_HEAD.format(rig=kind.name), f'name = "{kind.name}"', f'rig = "{kind.name}"', "", "[model]"]
    alternatives = _alternatives(kind)
    for key, setting in kind.keys.items():
        if key in signature(kind.nominal).parameters:
            usual, off = _usual(setting), setting.default is None
            lines.append(_line(setting, usual, _with_words(kind, key, usual, alternatives), off))
        else:
            lines.append(_of_a_field(setting, alternatives))
    sections = {"drive": settings_of(kind.drive), "acquisition": settings_of(AcquisitionSection)}
    for section, settings in sections.items():
        lines += ["", f"[{section}]", *(_line(each, _usual(each)) for each in settings.values())]
    told = kind.channels.told
    lines += ["", _TOLERANCES]
    for name, each in kind.tolerances({}).items():
        size = f"{100 * each.deviation:g} %" if each.relative else f"{each.deviation:g} {each.unit}".strip()
        lines.append(f"#   {toml_key(name)} = {as_written(size) if each.relative or each.unit else size}")
    limits = _LIMITS.format(channel=told[0], channels=", ".join(told))
    return "\n".join([*lines, "", limits, _NOTES])


@dataclass(frozen=True, slots=True)
class _Alternative:
    """The rig of a scenario with these words in [model] that are not the defaults."""

    words: Mapping[str, Any]
    rig: Any


def _alternatives(kind: RigKind) -> list[_Alternative]:
    """The nominal rigs of all choices of words, the defaults' first, then those nearer to it."""
    choices = {key: _choices(each) for key, each in settings_of(kind.nominal).items()}
    found = []
    for chosen in product(*choices.values()):
        words = dict(zip(choices, chosen, strict=True))
        other = {key: word for key, word in words.items() if word != choices[key][0]}
        with suppress(UnphysicalParameter, KeyError):
            found.append(_Alternative(other, kind.nominal(**words)))
    return sorted(found, key=lambda each: len(each.words))


def _with_words(kind: RigKind, key: str, value: Any, alternatives: list[_Alternative]) -> str:
    """The words without which no such value may stand under a key; empty for none."""
    defaults = {name: each.default for name, each in kind.model.items()}
    for other in alternatives:
        values = {**defaults, **other.words, key: value}
        checks = (check for check in kind.checks if values.keys() >= set(check.keys))
        if not any(fault for check in checks for fault in check.find(values)):
            return _together(other.words)
    return ""


def _together(words: Mapping[str, Any]) -> str:
    return f"with {', '.join(f'{key} = {as_written(word)}' for key, word in words.items())}" if words else ""


def _choices(setting: Setting) -> tuple[Any, ...]:
    """The default, and whatever else a word may be; of a number one other."""
    (plain,) = members(setting.type)
    if get_origin(plain) is Literal:
        return (setting.default, *(word for word in get_args(plain) if word != setting.default))
    if plain is bool:
        return setting.default, not setting.default
    return (setting.default, 2 * _usual(setting)) if plain is float else (setting.default,)


def _of_a_field(setting: Setting, alternatives: list[_Alternative]) -> str:
    """The line of a key whose default the words may decide."""
    here, *others = alternatives
    default = at(here.rig, setting.place)
    if default is None:
        there = next((each for each in others if at(each.rig, setting.place) is not None), None)
        if there is None:
            return f"# {setting.key} = ...  # {_told(setting)}; none"
        return _line(setting, at(there.rig, setting.place), _together(there.words), off=True)
    single = [each for each in others if len(each.words) == 1]
    deciding = [
        key for each in single for key in each.words if at(each.rig, setting.place) not in (default, None)
    ]
    said = f"decided by {' and '.join(dict.fromkeys(deciding))}" if deciding else ""
    return _line(setting, default, said, off=bool(deciding))


def _usual(setting: Setting) -> Any:
    """The default, or what is usual where there is none."""
    meaning: Any = setting.meaning
    usual = getattr(meaning, "usual", None)
    if usual is None or setting.default not in (REQUIRED, None):
        return setting.default
    return usual * si_factor(meaning.unit)


def _line(setting: Setting, value: Any, decided: str = "", off: bool = False) -> str:
    head = f"{'# ' if off else ''}{setting.key} = {_written(setting, value)}"
    source = "to be given" if setting.default is REQUIRED else setting.source or "assumed"
    said = [_told(setting), *([decided] if decided else []), source]
    return f"{head:{_COLUMN - 1}} # {'; '.join(text for text in said if text)}"


def _told(setting: Setting) -> str:
    means = getattr(setting.meaning, "means", "")
    return f"{means}; {field_of(setting).allowed}" if means else field_of(setting).allowed


def _written(setting: Setting, value: Any) -> str:
    meaning = setting.meaning
    if not isinstance(meaning, Quantity) or value is None:
        return as_written(value)
    if isinstance(value, tuple):
        return f"[{', '.join(_quantity(meaning, each) for each in value)}]"
    return _quantity(meaning, value)


def _quantity(meaning: Quantity, value: float) -> str:
    """A number in SI in the unit that it is usually given in, with no more digits than it needs."""
    for number in _shorter(value / si_factor(meaning.unit)):
        text = f"{number} {meaning.unit}".strip()
        if si_value(text, meaning.unit) == value:
            break
    return f'"{text}"' if meaning.unit else text


def _shorter(number: float) -> Iterator[str]:
    """With ever more digits; with a power of ten where it spares some."""
    for digits in range(1, _MOST_DIGITS + 1):
        rounded = float(f"{number:.{digits}g}")
        plain, power = repr(rounded).removesuffix(".0"), f"{rounded:.{digits - 1}e}"
        yield power if len(power) + _SPARED <= len(plain) else plain

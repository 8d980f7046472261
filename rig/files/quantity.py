"""Numbers with a unit, as an operator writes them ("0.127 mm", "10 mV/g"), turned into SI."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from typing import Final, cast

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-zµμΩ°%]+(?:_[A-Za-z0-9]+)*)(?:(?:\^|\*\*)?(?P<power>-?\d)|(?P<raised>[²³]))?"
    r"|(?P<mark>[*·/()]))"
)
_RAISED = {"²": 2, "³": 3}
_LONGEST = 80
_BASE: Final = ("kilogram", "meter", "second", "ampere", "radian")
_USUAL: Final[dict[str, tuple[float, tuple[int, ...]]]] = {
    "kg": (1.0, (1, 0, 0, 0, 0)),
    "g": (0.001, (1, 0, 0, 0, 0)),
    "m": (1.0, (0, 1, 0, 0, 0)),
    "mm": (0.001, (0, 1, 0, 0, 0)),
    "s": (1.0, (0, 0, 1, 0, 0)),
    "ms": (0.001, (0, 0, 1, 0, 0)),
    "Hz": (1.0, (0, 0, -1, 0, 0)),
    "kHz": (1000.0, (0, 0, -1, 0, 0)),
    "N": (1.0, (1, 1, -2, 0, 0)),
    "Pa": (1.0, (1, -1, -2, 0, 0)),
    "GPa": (1e9, (1, -1, -2, 0, 0)),
    "kN": (1000.0, (1, 1, -2, 0, 0)),
    "g_0": (9.80665, (0, 1, -2, 0, 0)),
    "V": (1.0, (1, 2, -3, -1, 0)),
    "mV": (0.001, (1, 2, -3, -1, 0)),
    "pC": (1e-12, (0, 0, 1, 1, 0)),
    "rad": (1.0, (0, 0, 0, 0, 1)),
    "deg": (0.017453292519943295, (0, 0, 0, 0, 1)),
    "rpm": (0.10471975511965977, (0, 0, -1, 0, 1)),
}
"""What Pint says of the usual units, factor and powers of the base: loading it is a third of a check."""
_CELSIUS: Final = ("degC", "°C")
"""Alone it is of a kind of its own, for its zero is not that of K; in a product it is a difference, in K."""
_SI: Final = (
    *("m", "kg", "s", "Hz", "N", "Pa", "V", "A", "K", "degC", "rad", "W", "C", "T", "N m", "J"),
    *("m/s", "m/s2", "rad/s", "rad/s2", "m2", "m3", "m3/s"),
)
"""As logs name them, of each kind the usual one first."""


class QuantityError(ValueError):
    """The text is no quantity, or one of another kind than asked for; says which."""


def written(value: object) -> tuple[float, str]:
    """Number and unit of a quantity as it stands in a file; raises QuantityError where it is none."""
    text = str(value)
    match = None if len(text) > _LONGEST else _QUANTITY.fullmatch(text.rstrip())
    if match is None:
        raise QuantityError("not a number with a unit")
    return float(match[1]), match[2]


def si_value(text: str, unit: str) -> float:
    """Return the quantity in `text` in the SI unit of the kind that `unit` is of ("mm" gives m).

    Hertz and rpm are not converted into each other (one of them is an angular speed). `g` is standard gravity
    wherever an acceleration is asked for. Raises QuantityError.
    """
    number, given = written(text)
    _, wanted_base = _in_si(unit, gravity=False)
    if not given and wanted_base != {}:
        raise QuantityError("the unit is missing")
    if not wanted_base and given not in ("", "%", "percent"):
        raise QuantityError(f"{given} is not a plain ratio or %")
    scale, base = _in_si(given, gravity="m/s2" in unit.replace("^", ""))
    if base != wanted_base:
        raise QuantityError(f"{given} is not a unit of this kind")
    return number * scale


def si_factor(unit: str) -> float:
    """How many SI units one `unit` is; raises QuantityError for an unknown unit."""
    return _in_si(unit, gravity=False)[0]


def si_unit(unit: str) -> str:
    """The SI unit of the kind that `unit` is of, as logs name it ("kPa" gives Pa); raises QuantityError.

    `g` is standard gravity: what is weighed is in kg.
    """
    if unit in _SI:
        return unit
    if not unit:
        raise QuantityError("the unit is missing")
    _, base = _in_si(unit, gravity=unit == "g")
    found = next((name for name in _SI if base and _in_si(name, gravity=False) == (1.0, base)), None)
    if found is None:
        raise QuantityError(f"{unit} is not a unit that a channel can be in")
    return found


@functools.lru_cache(maxsize=256)
def _in_si(unit: str, *, gravity: bool) -> tuple[float, dict[str, float]]:
    """Return factor and powers of the SI base units (radian counted as one) of a product such as "mV/N"."""
    if unit.strip() in _CELSIUS:
        return 1.0, {_CELSIUS[0]: 1.0}
    factor, powers = 1.0, dict[str, float]()
    for name, power in _terms(unit):
        name = "kelvin" if name in _CELSIUS else name
        one, base = _named("g_0" if gravity and name == "g" else name)
        factor *= one**power
        for key, exponent in base.items():
            powers[key] = powers.get(key, 0.0) + exponent * power
    return factor, {key: exponent for key, exponent in powers.items() if exponent}


def _terms(unit: str) -> Iterator[tuple[str, int]]:
    """Units and powers of a product such as "N s/m" or "mV/(m/s^2)".

    The grammar is our own because Pint evaluates the text that it parses.
    """
    signs, sign, wants_unit = [1], 1, bool(unit)
    position = 0
    while position < len(unit):
        token = _TOKEN.match(unit, position)
        if token is None:
            raise QuantityError(f"{unit} is not a unit")
        position = token.end()
        mark = token["mark"]
        if mark is None:
            yield token["name"], sign * signs[-1] * int(token["power"] or _RAISED.get(token["raised"], 1))
            sign, wants_unit = 1, False
        elif mark == "(":
            signs.append(sign * signs[-1])
            sign, wants_unit = 1, True
        elif wants_unit or (mark == ")" and len(signs) == 1):
            raise QuantityError(f"{unit} is not a unit")
        elif mark == ")":
            signs.pop()
        else:
            sign, wants_unit = -1 if mark == "/" else 1, True
    if wants_unit or len(signs) > 1:
        raise QuantityError(f"{unit} is not a unit")


def _named(name: str) -> tuple[float, dict[str, float]]:
    if name in _USUAL:
        factor, powers = _USUAL[name]
        return factor, {key: power for key, power in zip(_BASE, powers, strict=True) if power}
    return _by_pint(name)


def _by_pint(name: str) -> tuple[float, dict[str, float]]:
    import pint  # half a second, which commands that read no file need not pay

    try:
        one, two = (pint.Quantity(number, name).to_base_units() for number in (1.0, 2.0))
    except (pint.PintError, ValueError, AttributeError) as error:
        raise QuantityError(f"{name} is not a known unit") from error
    if two.magnitude != 2.0 * one.magnitude:  # it has another zero, or counts powers of ten
        raise QuantityError(f"{name} is no multiple of a unit")
    return float(one.magnitude), {str(key): cast(float, power) for key, power in one.unit_items()}

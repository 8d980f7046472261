"""Numbers with a unit, as an operator writes them ("0.127 mm", "10 mV/g"), turned into SI."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    import pint

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-zµμΩ°%]+(?:_[A-Za-z0-9]+)*)(?:(?:\^|\*\*)?(?P<power>-?\d)|(?P<raised>[²³]))?"
    r"|(?P<mark>[*·/()]))"
)
_RAISED = {"²": 2, "³": 3}
_LONGEST = 80


class QuantityError(ValueError):
    """The text is no quantity, or one of another kind than asked for; says which."""


@functools.cache
def _registry() -> pint.UnitRegistry[float]:
    import pint  # half a second, which commands that read no file need not pay

    return pint.UnitRegistry()


def si_value(text: str, unit: str) -> float:
    """Return the quantity in `text` in the SI unit of the kind that `unit` is of ("mm" gives m).

    Hertz and rpm are not converted into each other (one of them is an angular speed). `g` is standard gravity
    wherever an acceleration is asked for. Raises QuantityError.
    """
    match = _QUANTITY.fullmatch(text.rstrip())
    if match is None or len(text) > _LONGEST:
        raise QuantityError("not a number with a unit")
    number, given = float(match[1]), match[2]
    _, wanted_base = _in_si(unit, gravity=False)
    if not given and wanted_base != {}:
        raise QuantityError("the unit is missing")
    if not wanted_base and given not in ("", "%", "percent"):
        raise QuantityError(f"{given} is not a plain ratio or %")
    scale, base = _in_si(given, gravity=_names_acceleration(unit))
    if base != wanted_base:
        raise QuantityError(f"{given} is not a unit of this kind")
    return number * scale


def _names_acceleration(unit: str) -> bool:
    return "m/s2" in unit.replace("^", "")


def si_factor(unit: str) -> float:
    """How many SI units one `unit` is; raises QuantityError for an unknown unit."""
    return _in_si(unit, gravity=False)[0]


@functools.lru_cache(maxsize=256)
def _in_si(unit: str, *, gravity: bool) -> tuple[float, dict[str, float]]:
    """Return factor and powers of the SI base units (radian counted as one) of a product such as "mV/N"."""
    factor, powers = 1.0, dict[str, float]()
    for name, power in _terms(unit):
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
    import pint

    try:
        one = _registry().Quantity(1.0, name).to_base_units()
    except (pint.PintError, ValueError, AttributeError) as error:
        raise QuantityError(f"{name} is not a known unit") from error
    return float(one.magnitude), {str(key): cast(float, power) for key, power in one.unit_items()}

"""What may stand behind one key of a file: the annotations of the section classes."""

from __future__ import annotations

import datetime
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, get_args

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from rig.files.quantity import QuantityError, si_factor, si_value

NOT_ALLOWED: Final = "not_allowed"
_ROUNDING = 1e-9  # "10 mm" must pass a limit of 0.01 m


class FieldError(ValueError):
    """The value may not stand there; the text says what may."""


class Field(ABC):
    """Reads one value; used as `Annotated[float | None, Measured("mm", 0.001, 10)]`."""

    @property
    @abstractmethod
    def allowed(self) -> str:
        """What may stand there, in the operator's words."""

    @abstractmethod
    def read(self, value: object) -> object:
        """Return the value as the program uses it; raises FieldError."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Tell pydantic how to read such a field; None passes where the annotation allows it."""
        schema = core_schema.no_info_plain_validator_function(self._validated)
        return core_schema.nullable_schema(schema) if type(None) in get_args(source) else schema

    def _validated(self, value: object) -> object:
        try:
            return self.read(value)
        except FieldError as error:
            raise PydanticCustomError(NOT_ALLOWED, "{allowed}", {"allowed": str(error)}) from error


@dataclass(frozen=True, slots=True)
class Measured(Field):
    """A quantity between `low` and `high` (in `unit`), read into SI; `above` leaves `low` itself out."""

    unit: str
    low: float
    high: float
    above: bool = False

    @property
    def allowed(self) -> str:
        """The range with its unit."""
        low, high = (f"{bound:g} {self.unit}".strip() for bound in (self.low, self.high))
        return f"above {low}, up to {high}" if self.above else f"{low} to {high}"

    def read(self, value: object) -> float:
        """Return the value in SI."""
        si = self._in_si(value)
        scale = si_factor(self.unit)
        low, high = self.low * scale, self.high * scale
        slack = _ROUNDING * max(abs(low), abs(high))
        inside = low - (0.0 if self.above else slack) <= si <= high + slack
        if not inside or (self.above and si <= low):
            raise FieldError(self.allowed)
        return si

    def _in_si(self, value: object) -> float:
        try:
            match value:
                case bool():
                    raise FieldError(self._explained("not a number"))
                case int() | float():
                    return float(value)
                case str():
                    return si_value(value, self.unit)
        except QuantityError as error:
            raise FieldError(self._explained(str(error))) from error
        except OverflowError as error:
            raise FieldError(self.allowed) from error
        raise FieldError(self._explained("not a number with a unit"))

    def _explained(self, reason: str) -> str:
        return f"{self.allowed} ({reason})"


@dataclass(frozen=True, slots=True)
class Whole(Field):
    """A whole number from `low` to `high`."""

    low: int
    high: int

    @property
    def allowed(self) -> str:
        """The range."""
        return f"a whole number from {self.low} to {self.high}"

    def read(self, value: object) -> int:
        """Return the number."""
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            raise FieldError(self.allowed)
        return value


@dataclass(frozen=True, slots=True)
class Word(Field):
    """One word of a few; `later` holds words that the interface knows and this version does not."""

    words: tuple[str, ...]
    later: Mapping[str, str] = field(default_factory=dict)

    @property
    def allowed(self) -> str:
        """The words."""
        return " or ".join(f'"{word}"' for word in self.words)

    def read(self, value: object) -> str:
        """Return the word."""
        if isinstance(value, str) and value in self.later:
            raise FieldError(f"{self.allowed} ({self.later[value]})")
        if not isinstance(value, str) or value not in self.words:
            raise FieldError(self.allowed)
        return value


@dataclass(frozen=True, slots=True)
class Text(Field):
    """A text that matches `pattern`; `meaning` says it in words, with an example."""

    meaning: str
    pattern: str = r"[^\x00-\x1f\x7f]*"
    longest: int = 200

    @property
    def allowed(self) -> str:
        """The meaning."""
        return self.meaning

    def read(self, value: object) -> str:
        """Return the text."""
        if not isinstance(value, str) or len(value) > self.longest or not re.fullmatch(self.pattern, value):
            raise FieldError(self.allowed)
        return value


@dataclass(frozen=True, slots=True)
class Switch(Field):
    """True or false."""

    @property
    def allowed(self) -> str:
        """The two."""
        return "true or false"

    def read(self, value: object) -> bool:
        """Return it."""
        if not isinstance(value, bool):
            raise FieldError(self.allowed)
        return value


@dataclass(frozen=True, slots=True)
class Day(Field):
    """A date, which TOML writes without quotes."""

    @property
    def allowed(self) -> str:
        """An example."""
        return "a date without quotes, such as 2026-05-04"

    def read(self, value: object) -> datetime.date:
        """Return it."""
        if not isinstance(value, datetime.date) or isinstance(value, datetime.datetime):
            raise FieldError(self.allowed)
        return value


@dataclass(frozen=True, slots=True)
class Raw(Field):
    """A quantity whose unit hangs on another key; kept as written until both are known."""

    meaning: str

    @property
    def allowed(self) -> str:
        """The meaning."""
        return self.meaning

    def read(self, value: object) -> str | float:
        """Return the text or the number."""
        if isinstance(value, str):
            return value
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            return value
        raise FieldError(self.allowed)


@dataclass(frozen=True, slots=True)
class Table(Field):
    """A table within a table, read by its own section class."""

    meaning: str

    @property
    def allowed(self) -> str:
        """The meaning."""
        return self.meaning

    def read(self, value: object) -> dict[str, Any]:
        """Return the table."""
        if not isinstance(value, dict):
            raise FieldError(self.allowed)
        return value

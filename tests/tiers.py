"""Which cases of a test every change must pass, and which are left to `scripts/test --all`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first_short(cases: Iterable[Any]) -> list[Any]:
    """The same cases to parametrize a test by; all but the first are long."""
    first, *others = cases
    several = [each if isinstance(each, tuple) else (each,) for each in others]
    return [first, *(pytest.param(*each, marks=pytest.mark.long) for each in several)]

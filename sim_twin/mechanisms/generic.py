"""Compilation of kernels that take other kernels as arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
T = TypeVar("T")

_OPTIONS: dict[str, Any] = {"fastmath": True, "_nrt": False, "forceinline": True}


def generic(function: Callable[P, T]) -> Callable[P, T]:
    """Compile anew into every caller, for the functions that it passes, without reference counting.

    Not cached itself: what a rig compiles with its own functions is. Nothing in it may allocate.
    """
    return cast(Callable[P, T], njit(**_OPTIONS)(function))

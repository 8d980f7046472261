"""Compilation of the integrator and of the mechanisms that it is given.

A division by zero gives an infinity, which ends as a status, and no exception. Nothing here may allocate.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
T = TypeVar("T")

# All of fast arithmetic but the promises that there is no infinity and no NaN: the integrator looks for them.
_ARITHMETIC = {"reassoc", "contract", "arcp", "nsz", "afn"}
_OPTIONS: dict[str, Any] = {"fastmath": _ARITHMETIC, "_nrt": False, "error_model": "numpy"}


def mechanical(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel without reference counting or exceptions."""
    return cast(Callable[P, T], njit(**_OPTIONS, cache=True)(function))


def generic(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel that takes other kernels anew into every caller.

    Not cached itself: what a rig compiles with its own functions is.
    """
    return cast(Callable[P, T], njit(**_OPTIONS, forceinline=True)(function))

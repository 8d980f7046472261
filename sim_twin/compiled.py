"""Compilation of kernels, with a cache on disk that notices a change in any source of the twin.

numba's own cache looks at the file of the outermost function only, and a kernel is built from several files.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit
from numba.core import config
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

P = ParamSpec("P")
T = TypeVar("T")
_OPTIONS: dict[str, Any] = {"cache": True, "fastmath": True}
_UNCOUNTED: dict[str, Any] = {**_OPTIONS, "_nrt": False}


@cache
def _sources_digest() -> str:
    digest = hashlib.sha256()
    for source in _python_files(files("sim_twin")):
        digest.update(source.read_bytes())
    return digest.hexdigest()


def _python_files(folder: Traversable) -> list[Traversable]:
    found: list[Traversable] = []
    for entry in sorted(folder.iterdir(), key=lambda each: each.name):
        if entry.is_dir():
            found += _python_files(entry)
        elif entry.name.endswith(".py"):
            found.append(entry)
    return found


class _StampedByAllSources:
    def get_source_stamp(self) -> str:
        return _sources_digest()

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        if not py_func.__module__.startswith("sim_twin."):
            return None
        return super().from_function(py_func, py_file)  # type: ignore[misc]


class InAGivenFolder(_StampedByAllSources, UserProvidedCacheLocator):
    """Keeps the machine code where NUMBA_CACHE_DIR says."""


class BesideTheSource(_StampedByAllSources, InTreeCacheLocator):
    """Keeps the machine code in __pycache__."""


class InTheUsersCache(_StampedByAllSources, UserWideCacheLocator):
    """Keeps the machine code in the user's cache folder, where the sources may not be written to."""


def _locators() -> str:
    ours = [f"{__name__}.{kind.__name__}" for kind in (InAGivenFolder, BesideTheSource, InTheUsersCache)]
    numbas = ("UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator", "IPythonCacheLocator")
    return ",".join([*ours, *numbas])


if not getattr(config, "CACHE_LOCATOR_CLASSES", ""):
    setattr(config, "CACHE_LOCATOR_CLASSES", _locators())  # noqa: B010 - not in its stubs


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel, to be called from Python or from other kernels."""
    return cast(Callable[P, T], njit(**_OPTIONS)(function))


def inlined(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a piece of a kernel into whatever calls it."""
    return cast(Callable[P, T], njit(**_OPTIONS, inline="always")(function))


def allocation_free(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel without reference counting, which would cost more than its arithmetic.

    Nothing in it may allocate.
    """
    return cast(Callable[P, T], njit(**_UNCOUNTED)(function))


def allocation_free_inlined(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a piece of such a kernel into whatever calls it."""
    return cast(Callable[P, T], njit(**_UNCOUNTED, inline="always")(function))

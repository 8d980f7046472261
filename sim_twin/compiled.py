"""Compilation of kernels, cached on disk until any source that a kernel is built from changes.

numba's own cache looks at the file of the outermost function only, and a kernel is built from several files.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit
from numba.core import config
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator
from numba.extending import overload

from sim_twin.vector import VECTOR

P = ParamSpec("P")
T = TypeVar("T")
_OPTIONS: dict[str, Any] = {"cache": True, "fastmath": True, "nogil": True}
_UNCOUNTED: dict[str, Any] = {**_OPTIONS, "_nrt": False}
_STRICT: dict[str, Any] = {**_UNCOUNTED, "fastmath": False}
_IMPORT = re.compile(r"^\s*(?:from|import) (sim_twin[\w.]*)", re.MULTILINE)


@cache
def _digest_of(module: str) -> str:
    """Digest of a module of the twin and of all the modules of the twin that it builds on."""
    digest, seen, waiting = hashlib.sha256(), set[str](), [module]
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        source = _source_of(name)
        digest.update(source.encode())
        waiting += sorted(_IMPORT.findall(source), reverse=True)
    return digest.hexdigest()


def _source_of(module: str) -> str:
    *folders, name = module.split(".")[1:] or ["__init__"]
    place = files("sim_twin").joinpath(*folders)
    # as an import would: a folder of that name may be what an older version left behind
    alone = place / f"{name}.py"
    return (alone if alone.is_file() else place / name / "__init__.py").read_text("utf-8")


class _StampedByItsSources:
    _module: str

    def get_source_stamp(self) -> str:
        return _digest_of(self._module)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        if not py_func.__module__.startswith("sim_twin."):
            return None
        locator = super().from_function(py_func, py_file)  # type: ignore[misc]
        if locator is not None:
            locator._module = py_func.__module__
        return locator


class InAGivenFolder(_StampedByItsSources, UserProvidedCacheLocator):
    """Keeps the machine code where NUMBA_CACHE_DIR says."""


class BesideTheSource(_StampedByItsSources, InTreeCacheLocator):
    """Keeps the machine code in __pycache__."""


class InTheUsersCache(_StampedByItsSources, UserWideCacheLocator):
    """Keeps the machine code in the user's cache folder, where the sources may not be written to."""


if not getattr(config, "CACHE_LOCATOR_CLASSES", ""):
    _ours = [f"{__name__}.{kind.__name__}" for kind in (InAGivenFolder, BesideTheSource, InTheUsersCache)]
    _numbas = "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator"
    setattr(config, "CACHE_LOCATOR_CLASSES", ",".join([*_ours, _numbas]))  # noqa: B010 - not in its stubs


def _kept(kernel: Callable[P, T]) -> Callable[P, T]:
    """A kernel whose index of machine code is read only if it is of these sources.

    numba reads all of an index before it looks at its stamp, and fails where that names a class that is gone.
    """
    cache: Any = getattr(kernel, "_cache", None)
    file = getattr(cache, "_cache_file", None)
    if file is not None:
        file._version = f"{file._version} {cache._impl.locator.get_source_stamp()}"
    return kernel


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel, to be called from Python or from other kernels."""
    return _kept(njit(**_OPTIONS)(function))


def strict(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel that rounds just as it is written. Nothing in it may allocate."""
    return _kept(njit(**_STRICT)(function))


def strict_inlined(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a piece of such a kernel into whatever calls it."""
    return _kept(njit(**_STRICT, inline="always")(function))


def inlined(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a piece of a kernel into whatever calls it."""
    return _kept(njit(**_OPTIONS, inline="always")(function))


def allocation_free(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel without reference counting, which would cost more than its arithmetic.

    Nothing in it may allocate.
    """
    return _kept(njit(**_UNCOUNTED)(function))


def allocation_free_inlined(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a piece of such a kernel into whatever calls it."""
    return _kept(njit(**_UNCOUNTED, inline="always")(function))


# All of fast arithmetic but the promises that there is no infinity and no NaN: the integrator looks for them.
_ARITHMETIC = {"reassoc", "contract", "arcp", "nsz", "afn"}
_UNCHECKED: dict[str, Any] = {
    "fastmath": _ARITHMETIC,
    "_nrt": False,
    "error_model": "numpy",
    "nogil": True,
}


def mechanical(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel without reference counting or exceptions."""
    return _kept(njit(**_UNCHECKED, cache=True)(function))


def generic(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a kernel that takes other kernels anew into every caller.

    Not cached itself: what a rig compiles with its own functions is.
    """
    return _kept(njit(**_UNCHECKED, forceinline=True)(function))


def written_twice(numbers: Callable[P, T], vectors: Callable[..., Any]) -> Callable[P, T]:
    """A piece of a mechanical kernel that takes another way where it is given vectors."""

    def piece(*given: Any) -> Any:
        raise TypeError("only for kernels")

    options: Any = _UNCHECKED
    overload(piece, jit_options=options, strict=False)(lambda *given: vectors if VECTOR in given else numbers)
    return cast(Callable[P, T], piece)

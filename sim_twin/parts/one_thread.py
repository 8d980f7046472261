"""Linear algebra by one thread: the last bits of its sums would hang on how many share the work."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

import scipy.linalg  # noqa: F401 - a controller finds only the libraries that are loaded
from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")


def by_one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Let what is computed once and kept be the same bits in every process; goes below a cache."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        with _blas().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()

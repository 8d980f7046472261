"""Work that is not given up half way when whoever waits for it gives up."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

_T = TypeVar("_T")


class CarriedThrough:
    """Coroutines of one event loop that run to their end, though their caller is cancelled or times out."""

    def __init__(self) -> None:
        self._under_way: set[asyncio.Task[Any]] = set()  # a loop alone keeps no task alive

    async def do(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Run it and return what it returns; where the wait is cancelled it goes on."""
        task = asyncio.create_task(work)
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)
        return await asyncio.shield(task)

    async def ended(self) -> None:
        """Wait until nothing is under way; raises nothing of what went wrong with it."""
        await asyncio.gather(*self._under_way, return_exceptions=True)

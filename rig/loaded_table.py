"""Tables of what is there once, by name: a module is imported when its entry is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, Generic, TypeVar, cast

T = TypeVar("T")


def loaded(place: str) -> Any:
    """What stands at `place`, such as rig.rigs.impact_beam:KIND."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


class LoadedTable(Mapping[str, T], Generic[T]):
    """Entries by name, each given by its place; the names are known without importing anything."""

    def __init__(self, places: Mapping[str, str]) -> None:
        self._places = places

    def __getitem__(self, name: str) -> T:
        return cast(T, loaded(self._places[name]))

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

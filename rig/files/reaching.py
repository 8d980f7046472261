"""The bench file by which instruments that somebody else has started are reached."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rig.files.bench import Bench, tables_of
from rig.files.toml_text import toml_of
from rig.instruments import INSTRUMENTS
from rig.loaded_table import loaded

_FIRST: Final = ("driver", "interface")


def bench_reaching(bench: Bench, addresses: Mapping[str, str]) -> str:
    """A bench file in which the emulated instruments of `bench` are real ones at these addresses, by table.

    What the bench says of the others stays as it is.
    """
    tables = tables_of(bench)
    reached = {}
    for name in bench.instruments:
        here = addresses.get(name)
        place = None if here is None else loaded(INSTRUMENTS[name].settings).place(here)
        reached[name] = tables[name] if place is None else _at(tables[name], place)
    return toml_of(reached)


def _at(table: Mapping[str, Any], place: Mapping[str, Any]) -> dict[str, Any]:
    """The table with the place before its settings, where a reader looks for it."""
    kept = {key: value for key, value in table.items() if key != "emulated"}
    head: dict[str, Any] = {key: kept.pop(key) for key in _FIRST if key in kept}
    return {**head, **place, **{key: value for key, value in kept.items() if key not in place}}

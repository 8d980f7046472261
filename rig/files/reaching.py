"""The bench file by which instruments that somebody else has started are reached."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from drivers.canopen_cia406.settings import EncoderSettings
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.scpi.settings import GeneratorSettings
from rig.files.bench import Bench, tables_of
from rig.files.toml_text import toml_of

_ADDRESSED: Final[Mapping[str, Callable[[str], Mapping[str, Any]]]] = {
    "signal_generator": GeneratorSettings.place,
    "inverter": InverterSettings.place,
    "daq_card": lambda address: {"grpc": address},
    "encoder": EncoderSettings.place,
}
"""How the table of each instrument says where it is."""
_FIRST: Final = ("driver", "interface")


def bench_reaching(bench: Bench, addresses: Mapping[str, str]) -> str:
    """A bench file in which the emulated instruments of `bench` are real ones at these addresses, by table.

    What the bench says of the others stays as it is.
    """
    tables = tables_of(bench)
    reached = {
        name: _at(tables[name], _ADDRESSED[name](addresses[name])) if name in addresses else tables[name]
        for name in bench.instruments
    }
    return toml_of(reached)


def _at(table: Mapping[str, Any], place: Mapping[str, Any]) -> dict[str, Any]:
    """The table with the place before its settings, where a reader looks for it."""
    kept = {key: value for key, value in table.items() if key != "emulated"}
    head: dict[str, Any] = {key: kept.pop(key) for key in _FIRST if key in kept}
    return {**head, **place, **{key: value for key, value in kept.items() if key not in place}}

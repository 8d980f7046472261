"""Starts the emulated instruments of a bench, and says where they listen and how they are reached."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Final, Protocol, Self, TypeVar

from drivers.emulator_process import DriveLink, EmulatedInstrument
from rig.emulated_rig import EmulatedRig, drawn_rig
from rig.files.bench import Bench, tables_of
from rig.files.faults import toml_of
from rig.files.scenario import Scenario
from rig.instruments import INSTRUMENTS
from rig.loaded_table import loaded
from rig.rigs import RIGS
from rig.session.progress import FIRST_START

_COMPILED_S: Final = 300.0
"""A plant may have to be compiled first: the spatial crank takes minutes on a slow machine."""


class InstrumentSettings(Protocol):
    """What a bench says of an instrument."""

    def at(self, address: str) -> Self:
        """The same one, at `address`."""


_Settings = TypeVar("_Settings", bound=InstrumentSettings)


@dataclass(frozen=True, slots=True)
class Emulated:
    """The emulated instruments of a bench, by its tables. `seed` drew the rig.

    `drive_follows_scenario` where the actuator is a real one, which an emulated rig cannot hear.
    """

    instruments: Mapping[str, EmulatedInstrument]
    seed: int
    drive_follows_scenario: bool

    def reached(self, table: str, settings: _Settings) -> _Settings:
        """The settings of the instrument of a table, at its emulator's place if it is emulated."""
        emulator = self.instruments.get(table)
        return settings if emulator is None else settings.at(emulator.address)


NOTHING_EMULATED: Final = Emulated({}, 0, drive_follows_scenario=False)


def starting(bench: Bench) -> str:
    """What a person is told while the emulated instruments of a bench start."""
    simulates = "daq_card" in bench.emulated
    return f"starting the emulated instruments{f' ({FIRST_START})' if simulates else ''}"


class EmulatedBench:
    """The emulators that a bench asks for, in processes of their own, for as long as the context lasts."""

    def __init__(self, scenario: Scenario, bench: Bench) -> None:
        self._scenario, self._bench = scenario, bench
        self._stack = ExitStack()

    def __enter__(self) -> Emulated:
        with ExitStack() as starting:
            scenario, bench = self._scenario, self._bench
            hears, emulation = bench.actuator.emulated, bench.emulation
            seed = secrets.randbits(32) if emulation.seed is None else emulation.seed
            rig = drawn_rig(scenario, bench, seed, secrets.randbits(32))
            started: dict[str, EmulatedInstrument] = {}
            with ExitStack() as links:
                shown = [table for table in bench.emulated if INSTRUMENTS[table].emulator]
                hearing = [table for table in shown if not INSTRUMENTS[table].logs]
                ways = {table: links.enter_context(DriveLink.new()) for table in hearing if hears}
                if hears:
                    sinks = [way.sender for way in ways.values()]
                    started[RIGS[scenario.rig].actuator] = rig.start_actuator(sinks)
                    starting.callback(started[RIGS[scenario.rig].actuator].close)
                for table in shown:
                    way = ways.get(table)
                    heard = Heard(way.receiver, None) if way else Heard(None, rig.scenario_output)
                    started[table] = loaded(INSTRUMENTS[table].emulator)(bench, rig, seed, heard)
                    starting.callback(started[table].close)
            emulated = Emulated(started, seed, bool(hearing) and not hears)
            self._stack = starting.pop_all()
        return emulated

    def __exit__(self, *error: object) -> None:
        self._stack.close()


@dataclass(frozen=True, slots=True)
class Heard:
    """What an instrument hears of the actuator: its outputs, or once for all what it would put out."""

    outputs: Connection | None
    initial: Any


def card(bench: Bench, rig: EmulatedRig, seed: int, heard: Heard) -> EmulatedInstrument:
    """An emulated card on the rig."""
    from drivers.ni_daq.emulator.process import start_daq_card
    from rig.card_wiring import wiring_of

    return start_daq_card(rig.plant, wiring_of(bench), heard.outputs, heard.initial, deadline_s=_COMPILED_S)


def encoder(bench: Bench, rig: EmulatedRig, seed: int, heard: Heard) -> EmulatedInstrument:
    """An emulated encoder on the shaft of the rig."""
    from drivers.canopen_cia406.emulator.process import start_encoder
    from rig.shaft_wiring import encoder_setup
    from rig.twin.shaft import ShaftFactory

    if rig.motor is None or bench.encoder is None:
        raise LookupError("an encoder needs a shaft")
    setup = encoder_setup(bench.encoder, seed, bench.emulation)
    return start_encoder(ShaftFactory(rig.motor, heard.outputs, heard.initial), setup)


_FIRST: Final = ("driver", "interface")


def bench_reaching(bench: Bench, addresses: Mapping[str, str]) -> str:
    """A bench file in which the emulated instruments of `bench` are real ones at these addresses, by table.

    What the bench says of the others stays as it is.
    """
    tables = tables_of(bench)
    reached = {}
    for name in bench.instruments:
        table, here = tables[name], addresses.get(name)
        if here is not None:
            # the place before the settings, where a reader looks for it
            place = loaded(INSTRUMENTS[name].settings).place(here)
            kept = {key: value for key, value in table.items() if key != "emulated"}
            head: dict[str, Any] = {key: kept.pop(key) for key in _FIRST if key in kept}
            table = {**head, **place, **{key: value for key, value in kept.items() if key not in place}}
        reached[name] = table
    return toml_of(reached)

"""Starts the emulated instruments of a bench, and says where they listen and how they are reached."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, TypeVar

from drivers.canopen_cia406.settings import EncoderSettings
from drivers.emulator_process import DriveLink, EmulatedInstrument
from drivers.ni_daq.channels import INPUT_RANGES_V, input_range_v
from drivers.ni_daq.emulator.wiring import (
    CardWiring,
    ChargeStage,
    CounterWire,
    LowPassStage,
    MarkStage,
    ResonanceStage,
    Wire,
)
from drivers.protocols.emergency_stop import STOP_TABLE
from rig.emulated_rig import EmulatedRig, drawn_rig
from rig.files.bench import Bench, Emulation, tables_of
from rig.files.faults import toml_of
from rig.files.scenario import Scenario
from rig.instruments import INSTRUMENTS
from rig.rigs import unit_of
from rig.session.progress import FIRST_START

if TYPE_CHECKING:
    from drivers.canopen_cia406.emulator.process import EncoderSetup

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


STARTING: Final = "starting the emulated instruments"


def first_start(bench: Bench) -> str:
    """What a person is told of it where nobody knows how long that takes."""
    return FIRST_START if "daq_card" in bench.emulated else ""


@contextmanager
def emulated_bench(scenario: Scenario, bench: Bench) -> Iterator[Emulated]:
    """The emulators that a bench asks for, in processes of their own, for as long as the context lasts."""
    hears, emulation = bench.actuator.emulated, bench.emulation
    seed = secrets.randbits(32) if emulation.seed is None else emulation.seed
    rig = drawn_rig(scenario, bench, seed, secrets.randbits(32))
    started: dict[str, EmulatedInstrument] = {}
    with ExitStack() as running:
        with ExitStack() as links:
            shown = [table for table in bench.emulated if INSTRUMENTS[table].emulator]
            hearing = [table for table in shown if not INSTRUMENTS[table].logs]
            ways = {table: links.enter_context(DriveLink.new()) for table in hearing if hears}
            if hears:
                sinks = [way.sender for way in ways.values()]
                started[bench.actuator_table] = rig.start_actuator(sinks)
                running.callback(started[bench.actuator_table].close)
            for table in shown:
                way = ways.get(table)
                heard = Heard(way.receiver, None) if way else Heard(None, rig.scenario_output)
                started[table] = resolve_name(INSTRUMENTS[table].emulator)(bench, rig, seed, heard)
                running.callback(started[table].close)
        yield Emulated(started, seed, bool(hearing) and not hears)


@dataclass(frozen=True, slots=True)
class Heard:
    """What an instrument hears of the actuator: its outputs, or once for all what it would put out."""

    outputs: Connection | None
    initial: Any


def card(bench: Bench, rig: EmulatedRig, seed: int, heard: Heard) -> EmulatedInstrument:
    """An emulated card on the rig."""
    from drivers.ni_daq.emulator.process import start_daq_card

    wiring = replace(wiring_of(bench), faults=bench.emulation.rehearsed("daq_card"), seed=seed)
    return start_daq_card(rig.plant, wiring, heard.outputs, heard.initial, deadline_s=_COMPILED_S)


def wiring_of(bench: Bench) -> CardWiring:
    """The emulated card's inputs: each channel of the bench with the chain that the bench states."""
    wires: dict[str, Wire] = {}
    counters: dict[str, CounterWire] = {}
    for channel in bench.daq_card.channels:
        amplifier, low_pass, pulses, mark = (
            channel.amplifier,
            channel.anti_alias,
            channel.pulses,
            channel.mark,
        )
        if channel.counted:
            counters[channel.physical] = (
                CounterWire(channel.name, threshold_v=channel.range / 2.0)
                if pulses is None
                else CounterWire(
                    channel.name,
                    pulses.per_revolution,
                    backwards=pulses.backwards,
                    index_at=pulses.initial_angle,
                )
            )
        else:
            wires[channel.physical] = Wire(
                "" if unit_of(channel.name) is None else channel.name,
                -channel.volts_per_unit if channel.inverted else channel.volts_per_unit,
                range_v=input_range_v(channel.full_scale_v),
                charge=None
                if amplifier is None
                else ChargeStage(amplifier.corner_hz, amplifier.output_v or INPUT_RANGES_V[-1]),
                low_pass=None if low_pass is None else LowPassStage(low_pass.corner_hz, low_pass.order),
                corner_hz=channel.corner_hz,
                resonance=None
                if channel.resonance is None
                else ResonanceStage(channel.resonance.frequency_hz, channel.resonance.damping_ratio),
                delay=channel.delay or 0.0,
                mark=None if mark is None else MarkStage(mark.level, mark.falling),
            )
    line = bench.daq_card.stop_line
    return CardWiring(wires, counters=counters, lines={} if line is None else {line.line: line.healthy})


def encoder(bench: Bench, rig: EmulatedRig, seed: int, heard: Heard) -> EmulatedInstrument:
    """An emulated encoder on the shaft of the rig."""
    from drivers.canopen_cia406.emulator.process import start_encoder
    from rig.twin.shaft import LinkedShaft

    if rig.motor is None or bench.encoder is None:
        raise LookupError("an encoder needs a shaft")
    setup = encoder_setup(bench.encoder, seed, bench.emulation)
    return start_encoder(partial(LinkedShaft, rig.motor, heard.outputs, heard.initial), setup)


_COUNTS: Final = 4096
_CLOCK_PPM: Final = 20.0
"""Standard deviation of a crystal from its rate."""


def encoder_setup(encoder: EncoderSettings, seed: int, emulation: Emulation) -> EncoderSetup:
    """An emulated encoder as the bench wants it.

    Its zero lies anywhere and its clocks are off, by `seed`, unless it is to be nothing but nominal.
    """
    import numpy as np

    from drivers.canopen_cia406.emulator.process import EncoderSetup
    from drivers.canopen_cia406.objects import SCALING

    wanted = {name: value for name, value in asdict(encoder.identity).items() if value is not None}
    counts = wanted.pop("counts_per_revolution", _COUNTS)
    revolutions = max(wanted.pop("total_range", counts) // counts, 1)
    scaling = bool(wanted.pop("operating_parameters", SCALING) & SCALING)
    draw = np.random.default_rng([seed, 4])
    zero = int(draw.integers(counts))
    period_ppm, clock_ppm = (float(off) for off in draw.normal(0.0, _CLOCK_PPM, 2))
    return EncoderSetup(
        node=encoder.node,
        channel=str(encoder.options["channel"]),
        counts_per_revolution=counts,
        revolutions=revolutions,
        scaling=scaling,
        offset_counts=zero if emulation.healthy else 0,
        period_ppm=period_ppm if emulation.healthy else 0.0,
        clock_ppm=clock_ppm if emulation.healthy else 0.0,
        lag_s=emulation.encoder_lag,
        faults=emulation.rehearsed("encoder"),
        **wanted,
    )


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
            place = resolve_name(INSTRUMENTS[name].settings).place(here)
            kept = {key: value for key, value in table.items() if key != "emulated"}
            head: dict[str, Any] = {key: kept.pop(key) for key in _FIRST if key in kept}
            table = {**head, **place, **{key: value for key, value in kept.items() if key not in place}}
        reached[name] = table
    return toml_of(reached | {name: tables[name] for name in (STOP_TABLE,) if name in tables})

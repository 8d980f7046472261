"""Starts the emulated instruments of a bench and says where they listen."""

from __future__ import annotations

import secrets
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType

from daq.clock import SystemClock
from drivers.emulator_process import DriveLink, EmulatedInstrument
from drivers.ni_daq.emulator import start_daq_card
from drivers.protocols import DriveSettings
from drivers.scpi.emulator import start_function_generator
from rig.card_wiring import wiring_of
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.twin.plant import BeamPlantFactory
from rig.twin.scenario_twin import twin_of, with_effects


@dataclass(frozen=True, slots=True)
class Emulated:
    """Where the emulated instruments of a bench listen; None for those that are real. `seed` drew the rig."""

    generator: EmulatedInstrument | None
    card: EmulatedInstrument | None
    seed: int
    drive_follows_scenario: bool


class EmulatedBench:
    """The emulators that a bench asks for, in processes of their own, for as long as the context lasts."""

    def __init__(self, scenario: Scenario, bench: Bench) -> None:
        self._scenario, self._bench = scenario, bench
        self._stack = ExitStack()

    def __enter__(self) -> Emulated:
        with ExitStack() as starting:
            emulated = self._start(starting)
            self._stack = starting.pop_all()
        return emulated

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _start(self, stack: ExitStack) -> Emulated:
        bench, generator, card = self._bench, None, None
        seed = secrets.randbits(32) if bench.emulation.seed is None else bench.emulation.seed
        follows = bench.daq_card.emulated and not bench.signal_generator.emulated
        with DriveLink.new() as link:
            if bench.signal_generator.emulated:
                generator = start_function_generator(link.sender)
                stack.callback(generator.close)
            if bench.daq_card.emulated:
                initial = self._scenario_drive() if follows else None
                card = start_daq_card(
                    self._plant(seed), wiring_of(bench), None if follows else link.receiver, initial
                )
                stack.callback(card.close)
        return Emulated(generator, card, seed, follows)

    def _plant(self, seed: int) -> BeamPlantFactory:
        bench = self._bench
        twin = twin_of(self._scenario, (channel.name for channel in bench.daq_card.channels))
        if bench.emulation.effects is not None:
            twin = with_effects(twin, bench.emulation.effects)
        per_volt = bench.signal_generator.force_per_volt
        return BeamPlantFactory(twin, per_volt, seed, secrets.randbits(32), bench.emulation.healthy)

    def _scenario_drive(self) -> DriveSettings:
        """What an emulated card hears while the generator is a real one that it cannot hear."""
        drive, per_volt = self._scenario.drive, self._bench.signal_generator.force_per_volt
        return DriveSettings(
            on=True,
            frequency_hz=drive.frequency,
            amplitude_v=drive.amplitude / per_volt,
            offset_v=drive.offset / per_volt,
            started_s=SystemClock().monotonic_s(),
        )

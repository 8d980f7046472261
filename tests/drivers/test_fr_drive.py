"""The emulated drive by itself: registers, ramps, communication watchdog, trips; time is in our hands."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from pymodbus.constants import ExcCodes

from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.emulator.drive import (
    RUNNING_FREQUENCY_EEPROM,
    DriveFaults,
    EmulatedDrive,
    InverterSetup,
    Unanswered,
)
from drivers.mitsubishi_fr.registers import Command, Register, Status
from tests.drivers.fr_bench import RecordedMotor

WATCHDOG_S = 1.0  # Pr.122 = 10


@dataclass
class Rig:
    """A drive that ramps by 10 Hz a second."""

    setup: InverterSetup = field(default_factory=lambda: InverterSetup({7: 60, 8: 60, 122: 10}))
    now_s: float = 100.0

    def __post_init__(self) -> None:
        self.load = RecordedMotor()
        self.drive = EmulatedDrive(self.setup, self.load, lambda: self.now_s)

    def read(self, register: Register) -> float:
        values = self.drive.access(register.number, 1, None)
        assert isinstance(values, list)
        return register.value(values[0])

    @property
    def status(self) -> Status:
        return Status(int(self.read(fr.STATUS_AND_COMMAND)))

    def write(self, register: Register, raw: int) -> ExcCodes | None:
        answer = self.drive.access(register.number, 1, [raw])
        return answer if isinstance(answer, ExcCodes) else None

    def run(self, hz: float) -> None:
        self.drive.heard_frame()
        assert self.write(fr.RUNNING_FREQUENCY, fr.RUNNING_FREQUENCY.raw(hz)) is None
        assert self.write(fr.STATUS_AND_COMMAND, Command.FORWARD) is None

    def later(self, seconds: float, talking: bool = True) -> None:
        """Let time pass in steps; with a master that talks, or in silence."""
        for _ in range(round(seconds / 0.01)):
            self.now_s += 0.01
            self.drive.heard_frame() if talking else self.drive.settle()


def with_parameters(**parameters: int) -> Rig:
    numbers = {int(name.removeprefix("pr")): raw for name, raw in parameters.items()}
    return Rig(InverterSetup({7: 60, 8: 60, 122: 10} | numbers))


def test_ramps_take_their_time_to_the_reference_frequency() -> None:
    """Pr.7 and Pr.8 are the times between 0 and Pr.20: here 6 s for 60 Hz."""
    rig = Rig()
    rig.run(8.0)
    rig.later(0.4)
    assert rig.read(fr.OUTPUT_FREQUENCY) == pytest.approx(4.0, abs=0.011)
    rig.later(0.5)
    assert rig.read(fr.OUTPUT_FREQUENCY) == 8.0
    assert rig.status == Status.RUNNING | Status.FORWARD | Status.UP_TO_FREQUENCY
    rig.write(fr.STATUS_AND_COMMAND, Command.STOP)
    rig.later(0.4)
    assert rig.read(fr.OUTPUT_FREQUENCY) == pytest.approx(4.0, abs=0.011)
    assert rig.status == Status.RUNNING | Status.FORWARD
    rig.later(0.5)
    assert rig.status == 0


def test_what_goes_to_the_load_is_what_the_registers_say() -> None:
    rig = Rig()
    rig.run(8.0)
    for _ in range(30):
        rig.later(0.05)
        assert rig.load.at(rig.now_s) == pytest.approx(rig.read(fr.OUTPUT_FREQUENCY), abs=0.0051)
    assert rig.read(fr.OUTPUT_CURRENT) == pytest.approx(rig.load.current_a(), abs=0.0051)


def test_output_stays_below_the_maximum_frequency() -> None:
    rig = with_parameters(pr1=500)
    rig.run(8.0)
    rig.later(2.0)
    assert rig.read(fr.OUTPUT_FREQUENCY) == 5.0


@pytest.mark.parametrize("raw", [5, 10, 20])
def test_the_watchdog_trips_in_time_and_only_in_silence(raw: int) -> None:
    rig = with_parameters(pr122=raw, pr502=0)
    rig.run(8.0)
    rig.later(3.0)
    last_frame_s = rig.now_s
    rig.later(0.1 * raw - 0.1, talking=False)
    assert Status.FAULT not in rig.status
    rig.later(0.2, talking=False)
    assert Status.FAULT in rig.status
    assert rig.load.outputs[-1].started_s - last_frame_s == pytest.approx(0.1 * raw, abs=1e-9)


def test_any_frame_keeps_it_quiet() -> None:
    rig = Rig()
    rig.drive.heard_frame()
    rig.later(5.0)
    assert Status.FAULT not in rig.status


def test_the_watchdog_waits_for_a_first_frame_in_network_operation() -> None:
    rig = Rig()
    rig.later(5.0, talking=False)
    assert Status.FAULT not in rig.status
    rig.drive.heard_frame()
    rig.write(fr.OPERATION_MODE, fr.CHOOSE_PANEL)
    rig.later(5.0, talking=False)
    assert Status.FAULT not in rig.status
    rig.write(fr.OPERATION_MODE, fr.CHOOSE_NETWORK)
    rig.drive.heard_frame()
    rig.later(1.5, talking=False)
    assert rig.read(fr.FAULTS[0]) == fr.COMMUNICATION_FAULT


def test_9999_never_trips_and_0_trips_at_once() -> None:
    """FR-A700 manual p. 347, Pr.539 with the "same specifications as Pr. 122"."""
    never, at_once = with_parameters(pr122=9999), with_parameters(pr122=0)
    for rig in (never, at_once):
        rig.drive.heard_frame()
        rig.later(20.0, talking=False)
    assert never.read(fr.FAULTS[0]) == 0
    assert at_once.read(fr.FAULTS[0]) == fr.COMMUNICATION_FAULT


def test_after_silence_it_coasts_with_502_at_0() -> None:
    rig = with_parameters(pr502=0)
    rig.run(8.0)
    rig.later(2.0)
    rig.later(1.1, talking=False)
    assert not rig.load.outputs[-1].on
    assert rig.read(fr.OUTPUT_FREQUENCY) == 0.0
    assert rig.read(fr.FAULTS[0]) == fr.COMMUNICATION_FAULT


def test_after_silence_it_ramps_with_502_at_1_and_shows_the_fault_at_rest() -> None:
    rig = with_parameters(pr502=1)
    rig.run(8.0)
    rig.later(2.0)
    rig.later(1.4, talking=False)
    assert rig.read(fr.OUTPUT_FREQUENCY) == pytest.approx(4.0, abs=0.011)
    assert rig.read(fr.FAULTS[0]) == 0
    rig.later(0.5, talking=False)
    assert rig.read(fr.OUTPUT_FREQUENCY) == 0.0
    assert rig.read(fr.FAULTS[0]) == fr.COMMUNICATION_FAULT


def test_a_master_that_comes_back_does_not_stop_a_trip() -> None:
    rig = with_parameters(pr502=1)
    rig.run(8.0)
    rig.later(2.0)
    rig.later(1.2, talking=False)
    rig.write(fr.STATUS_AND_COMMAND, Command.FORWARD)
    rig.later(2.0)
    assert rig.read(fr.OUTPUT_FREQUENCY) == 0.0
    assert Status.FAULT in rig.status


def test_faults_are_kept_newest_first_and_outlive_a_reset() -> None:
    rig = Rig()
    for code in (0x10, 0x30):
        rig.drive.trip(code)
        with pytest.raises(Unanswered):
            rig.write(fr.INVERTER_RESET, 0)
    assert rig.drive.access(fr.FAULTS[0].number, 3, None) == [0x30, 0x10, 0]
    assert Status.FAULT not in rig.status


def test_a_tripped_drive_does_not_run() -> None:
    rig = Rig()
    rig.drive.trip(0x10)
    rig.run(8.0)
    rig.later(1.0)
    assert rig.read(fr.OUTPUT_FREQUENCY) == 0.0


def test_a_read_across_a_hole_gives_zeros_and_no_error() -> None:
    """800-series manual 4.5.15: why `Block` forbids it."""
    rig = Rig()
    assert rig.drive.access(41008, 13, None) == [60, *[0] * 11, 6000]  # Pr.8, none of Pr.9 to 19, Pr.20


def test_the_manuals_example() -> None:
    assert Rig().drive.access(41004, 3, None) == [6000, 3000, 1000]


@pytest.mark.parametrize(
    ("number", "values"),
    [(40100, None), (41300, None), (40100, [1]), (fr.OUTPUT_FREQUENCY.number, [1]), (40501, [0])],
)
def test_registers_that_are_not_there_or_not_to_be_written(number: int, values: list[int] | None) -> None:
    assert Rig().drive.access(number, 1, values) is ExcCodes.ILLEGAL_ADDRESS


def test_values_that_it_refuses() -> None:
    rig = Rig()
    assert rig.write(fr.RUNNING_FREQUENCY, 40001) is ExcCodes.ILLEGAL_VALUE
    assert rig.write(fr.OPERATION_MODE, 0x55) is ExcCodes.ILLEGAL_VALUE
    rig.write(fr.OPERATION_MODE, fr.CHOOSE_PANEL)
    for register, raw in ((fr.RUNNING_FREQUENCY, 100), (fr.STATUS_AND_COMMAND, 2), (fr.WATCHDOG, 20)):
        assert rig.write(register, raw) is ExcCodes.ILLEGAL_VALUE


def test_the_mode_stays_while_it_turns() -> None:
    rig = Rig()
    rig.run(8.0)
    rig.later(1.0)
    assert rig.write(fr.OPERATION_MODE, fr.CHOOSE_PANEL) is ExcCodes.ILLEGAL_VALUE


def test_only_the_eeprom_outlives_a_reset() -> None:
    rig = Rig()
    rig.write(fr.RUNNING_FREQUENCY, 700)
    assert rig.drive.access(RUNNING_FREQUENCY_EEPROM, 1, [300]) == []
    rig.write(fr.RUNNING_FREQUENCY, 800)
    with pytest.raises(Unanswered):
        rig.write(fr.INVERTER_RESET, 0)
    assert rig.read(fr.RUNNING_FREQUENCY) == 3.0


def test_faults_to_rehearse() -> None:
    forgets = {fr.RUNNING_FREQUENCY.number}
    rig = Rig(InverterSetup({}, DriveFaults(not_obeyed=frozenset(forgets), exceptions={40201: (4, 1)})))
    assert rig.write(fr.RUNNING_FREQUENCY, 800) is None
    assert rig.read(fr.RUNNING_FREQUENCY) == 0.0
    assert rig.drive.access(40201, 1, None) is ExcCodes.DEVICE_FAILURE
    assert rig.drive.access(40201, 1, None) == [0]

"""The shaker's moves, heard by a generator that writes down what it is told."""

from __future__ import annotations

from io import StringIO
from itertools import pairwise

import numpy as np
import pytest
from rich.console import Console

from daq.errors import InstrumentSilent
from rig.session.drive import RAMP_S, Shaker, drive_off_after
from rig.session.progress import Screen
from sim_twin.rigs.impact_beam.model import SineDrive
from tests.rig.session.fakes import RecordingGenerator, silent_screen

FORCE_PER_VOLT = 3.6
FULL_V = 9.0 / FORCE_PER_VOLT


def shaker(generator: RecordingGenerator, waits: list[float], amplitude: float = 9.0) -> Shaker:
    drive = SineDrive(frequency=20.0, amplitude=amplitude, offset=0.5)
    return Shaker(generator, drive, FORCE_PER_VOLT, waits.append)


def test_a_soft_start_begins_at_the_least_amplitude_and_ends_at_the_full_one() -> None:
    generator, waits = RecordingGenerator(), list[float]()
    moved = shaker(generator, waits)
    moved.arm(soft=True)
    moved.start(soft=True)
    assert generator.told[0] == ("arm_sine", 20.0, 0.01, 0.0, False)
    assert generator.told[1] == ("start",)
    volts = generator.amplitudes()
    assert volts == sorted(volts)
    assert volts[-1] == pytest.approx(FULL_V)
    assert max(b - a for a, b in zip([0.0, *volts], volts, strict=False)) < FULL_V / 10
    assert sum(waits) == pytest.approx(RAMP_S)
    offsets = [float(str(each[1])) for each in generator.told if each[0] == "set_offset"]
    assert offsets == sorted(offsets)
    assert offsets[-1] == pytest.approx(0.5 / FORCE_PER_VOLT)


@pytest.mark.parametrize("soft", [False, True])
def test_a_drive_is_held_once_it_is_as_ordered_and_not_while_that_changes(soft: bool) -> None:
    generator, told = RecordingGenerator(), list[object]()
    drive = SineDrive(frequency=20.0, amplitude=9.0)
    held = lambda ordered: told.append((len(generator.told), ordered))  # noqa: E731
    moved = Shaker(generator, drive, FORCE_PER_VOLT, lambda seconds: None, hold=held)
    moved.arm(soft)
    moved.start(soft)
    started = len(generator.told)
    pushed = moved.shake(4.0).push(-1.0)
    assert pushed.drive == SineDrive(frequency=20.0, amplitude=4.0, offset=-1.0)
    assert generator.told[started:] == [
        ("set_amplitude", 4.0 / FORCE_PER_VOLT),
        ("set_offset", -1.0 / FORCE_PER_VOLT),
    ]
    assert told == [
        (started, drive),
        (started, None),
        (started + 1, SineDrive(frequency=20.0, amplitude=4.0)),
        (started + 1, None),
        (started + 2, pushed.drive),
    ]


def test_a_start_comes_through_the_drives_of_its_path_without_a_rest() -> None:
    generator, waits = RecordingGenerator(), list[float]()
    moved = shaker(generator, waits)
    path = (SineDrive(frequency=19.0, amplitude=9.0), SineDrive(frequency=22.0, amplitude=7.2))
    moved.arm(soft=True, path=path)
    moved.start(soft=True, path=path)
    assert generator.told[0] == ("arm_sine", 19.0, 0.01, 0.0, False)
    assert "off" not in [each[0] for each in generator.told]
    hertz = [float(str(each[1])) for each in generator.told if each[0] == "set_frequency"]
    top = hertz.index(22.0)
    assert hertz[: top + 1] == sorted(hertz[: top + 1])
    assert hertz[top:] == sorted(hertz[top:], reverse=True)
    # 16 steps from one drive to the next
    assert max(abs(b - a) for a, b in pairwise([19.0, *hertz])) == pytest.approx(3.0 / 16)
    assert hertz[-1] == 20.0
    assert generator.amplitudes()[31] == pytest.approx(7.2 / FORCE_PER_VOLT)
    assert generator.amplitudes()[-1] == pytest.approx(FULL_V)
    assert sum(waits) == pytest.approx(3 * RAMP_S)


def test_somebody_looks_between_any_two_orders_on_a_way() -> None:
    """Each answer may take half a second, and who looks at nothing for 0.6 s is taken for dead."""
    generator, heard = RecordingGenerator(), list[int]()

    def wait(seconds: float) -> None:
        heard.append(len(generator.told))

    drive = SineDrive(frequency=20.0, amplitude=9.0, offset=0.5)
    moved, path = Shaker(generator, drive, FORCE_PER_VOLT, wait), (SineDrive(frequency=22.0, amplitude=7.2),)
    moved.arm(soft=True, path=path)
    moved.start(soft=True, path=path)
    wait(0.0)
    moved.ramp_down()
    assert max(np.diff([*heard, len(generator.told) - 1])) == 1  # the last is off


def test_a_start_from_rest_is_armed_at_the_full_amplitude_and_triggered() -> None:
    generator, waits = RecordingGenerator(), list[float]()
    moved = shaker(generator, waits)
    moved.arm(soft=False)
    moved.start(soft=False)
    assert generator.told == [("arm_sine", 20.0, FULL_V, 0.0, True), ("start",)]
    assert waits == []


def test_a_ramp_down_falls_to_off() -> None:
    generator, waits = RecordingGenerator(), list[float]()
    shaker(generator, waits).ramp_down()
    volts = generator.amplitudes()
    assert volts == sorted(volts, reverse=True)
    assert volts[0] < FULL_V
    assert generator.told[-1] == ("off",)
    assert sum(waits) <= RAMP_S


@pytest.mark.parametrize("amplitude", [0.0, 0.01])
def test_a_drive_below_what_a_generator_can_do_is_left_as_it_was_armed(amplitude: float) -> None:
    generator = RecordingGenerator()
    moved = shaker(generator, [], amplitude)
    moved.arm(soft=True)
    moved.start(soft=True)
    moved.ramp_down()
    assert generator.amplitudes() == []
    assert generator.told[0][2] == pytest.approx(amplitude / FORCE_PER_VOLT)


def test_off_comes_first_on_every_way_out() -> None:
    generator = RecordingGenerator()
    with (
        pytest.raises(ZeroDivisionError, match="a fault"),
        drive_off_after(generator, RecordingGenerator, silent_screen()),
    ):
        raise ZeroDivisionError("a fault")
    assert generator.told == [("off",)]
    with drive_off_after(generator, RecordingGenerator, silent_screen()):
        pass
    assert generator.told == [("off",), ("off",)]


def test_a_generator_that_does_not_go_off_does_not_hide_why_the_run_ended() -> None:
    generator = RecordingGenerator(fails_at="off")
    screen = silent_screen()
    with (
        pytest.raises(ZeroDivisionError, match="a fault"),
        drive_off_after(generator, lambda: RecordingGenerator(fails_at="open"), screen),
    ):
        raise ZeroDivisionError("a fault")
    assert "THE DRIVE MAY STILL BE ON" in screen.console.export_text()


@pytest.mark.parametrize(
    ("fails_at", "spare_fails_at", "left"),
    [
        ("", "", "the motor is off"),
        ("off", "", "the motor is off, by a new connection"),
        ("off", "open", "THE DRIVE MAY STILL BE ON: switch it off by hand"),
    ],
)
def test_what_ended_a_run_says_how_its_drive_is_left(fails_at: str, spare_fails_at: str, left: str) -> None:
    generator, heard = RecordingGenerator(fails_at=fails_at), list[str]()
    spare = RecordingGenerator(fails_at=spare_fails_at)
    with (
        pytest.raises(ZeroDivisionError, match="a fault") as ending,
        drive_off_after(generator, lambda: spare, silent_screen(), moved="the motor", not_off=heard.append),
    ):
        raise ZeroDivisionError("a fault")
    assert ending.value.__notes__ == [left]
    assert len(heard) == ("MAY STILL" in left)


class Unwritable(Screen):
    def warn(self, text: str) -> None:
        raise ValueError("I/O operation on closed file")


def test_words_that_cannot_be_said_hide_neither_why_it_ended_nor_how_it_is_left() -> None:
    heard = list[str]()
    with (
        pytest.raises(ZeroDivisionError, match="a fault") as ending,
        drive_off_after(
            RecordingGenerator(fails_at="off"),
            lambda: RecordingGenerator(fails_at="open"),
            Unwritable(Console(file=StringIO())),
            moved="the drive",
            not_off=heard.append,
        ),
    ):
        raise ZeroDivisionError("a fault")
    assert ending.value.__notes__ == ["THE DRIVE MAY STILL BE ON: switch it off by hand"]
    assert len(heard) == 1


def test_a_person_hears_before_a_log_that_may_hang() -> None:
    screen, said = silent_screen(), list[str]()
    with (
        pytest.raises(ZeroDivisionError),
        drive_off_after(
            RecordingGenerator(fails_at="off"),
            lambda: RecordingGenerator(fails_at="open"),
            screen,
            not_off=lambda _: said.append(screen.console.export_text()),
        ),
    ):
        raise ZeroDivisionError("a fault")
    assert "MAY STILL BE ON" in said[0]


def test_where_nothing_moved_what_ended_it_says_nothing_of_the_drive() -> None:
    with (
        pytest.raises(ZeroDivisionError) as ending,
        drive_off_after(RecordingGenerator(), RecordingGenerator, silent_screen()),
    ):
        raise ZeroDivisionError("a fault")
    assert not hasattr(ending.value, "__notes__")


def test_where_the_old_connection_fails_a_new_one_switches_off() -> None:
    generator, spare, screen = RecordingGenerator(fails_at="off"), RecordingGenerator(), silent_screen()
    with (
        pytest.raises(ZeroDivisionError, match="a fault"),
        drive_off_after(generator, lambda: spare, screen),
    ):
        raise ZeroDivisionError("a fault")
    assert spare.told == [("open",), ("off",), ("close",)]
    assert "THE DRIVE MAY STILL BE ON" not in screen.console.export_text()


class HungUpGenerator(RecordingGenerator):
    """Its off fails as long as it is open."""

    def off(self) -> None:
        if ("close",) not in self.told:
            self._note("off")
            raise InstrumentSilent(self.name, self.address, "no answer")


@pytest.mark.parametrize("obeys", [True, False])
def test_what_a_new_connection_or_the_supervisor_has_taken_over_nobody_switches_off_again(
    obeys: bool,
) -> None:
    spares, said, handed = list[RecordingGenerator](), silent_screen(), list[str]()

    class Taker:
        def take_over(self) -> None:
            assert "BE ON" not in said.console.export_text(clear=False), "a terminal may hang"
            handed.append("taken over")

        def go_on(self) -> str:
            assert "BE ON" in said.console.export_text(clear=False), "it may take its time"
            return "process 1 goes on"

    def spare() -> RecordingGenerator:
        spares.append(RecordingGenerator(fails_at="" if obeys and not spares else "open"))
        return spares[-1]

    generator = HungUpGenerator()
    with (
        pytest.raises(ZeroDivisionError, match="a fault"),
        drive_off_after(generator, spare, said),
        drive_off_after(generator, spare, said, Taker()),
        drive_off_after(generator, spare, said, Taker()),
    ):
        raise ZeroDivisionError("a fault")
    assert (len(spares), len(handed)) == (1, 0 if obeys else 1)
    text = said.console.export_text()
    assert text.count("THE DRIVE MAY STILL BE ON") == text.count("! process 1 goes on") == len(handed)
    assert generator.told.count(("off",)) == 1


class BrokenGenerator(RecordingGenerator):
    """Its driver has a fault of its own."""

    def off(self) -> None:
        raise RuntimeError("a fault in the driver")


class GoneTerminal(Screen):
    """Nobody reads it any more."""

    def warn(self, text: str) -> None:
        raise OSError("the terminal is gone")


def test_whatever_goes_wrong_with_the_old_connection_the_new_one_is_tried_before_a_word_is_said() -> None:
    spare = RecordingGenerator()
    with (
        pytest.raises(RuntimeError, match="a fault in the driver"),
        drive_off_after(BrokenGenerator(), lambda: spare, GoneTerminal(Console(file=StringIO()))),
    ):
        pass
    assert spare.told == [("open",), ("off",), ("close",)]


def test_a_spare_that_cannot_even_be_made_is_said_to_have_failed() -> None:
    screen = silent_screen()

    def none() -> RecordingGenerator:
        raise ZeroDivisionError

    with (
        pytest.raises(RuntimeError, match="a fault in the driver"),
        drive_off_after(BrokenGenerator(), none, screen),
    ):
        pass
    assert "THE DRIVE MAY STILL BE ON" in screen.console.export_text()


def test_a_drive_that_does_not_go_off_after_a_good_run_is_switched_off_by_a_new_connection() -> None:
    generator, spare = RecordingGenerator(fails_at="off"), RecordingGenerator()
    with (
        pytest.raises(InstrumentSilent, match="no answer"),
        drive_off_after(generator, lambda: spare, silent_screen()),
    ):
        pass
    assert spare.told == [("open",), ("off",), ("close",)]


def test_a_motor_has_no_second_connection_and_the_words_say_what_has_to_stop_it() -> None:
    screen = silent_screen()
    with (
        pytest.raises(InstrumentSilent, match="no answer"),
        drive_off_after(RecordingGenerator(fails_at="off"), None, screen),
    ):
        pass
    assert "THE MOTOR MAY STILL TURN" in screen.console.export_text()


def test_a_trim_corrects_the_frequency_by_what_it_was_measured_to_be_off() -> None:
    generator = RecordingGenerator()
    shaker(generator, []).trim(2e-4)
    assert generator.told == [("set_frequency", pytest.approx(20.0 * (1 - 2e-4), rel=1e-7))]

"""A few seeds of the benchmark of the inverter on a bad line, and that it would notice."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from dataclasses import replace

import pytest

from benchmarks.modbus_noise import LINES, MUST_HOLD, Outcome, Truth, differences, one
from drivers.protocols.speed_drive import MotorOutput, MotorState

PATIENCE = 2.5  # a stall of this machine is no silence of the drive
RIGHT = MotorState(10.0, True, 200.1, 200.1, 6.67, 0.6, 22.2)


@pytest.mark.parametrize(("name", "seed"), list(zip(LINES, (1, 2, 3), strict=True)))
def test_a_bad_line_holds_the_speed_or_stops_the_motor(name: str, seed: int) -> None:
    outcome = one(seed, *LINES[name], seconds=3.0, patience=PATIENCE)
    assert outcome.held or (outcome.stopped_safely and name != MUST_HOLD)
    assert outcome.wrong == ()
    assert outcome.believed > 2
    assert outcome.unanswered > 0 or name == MUST_HOLD


@pytest.fixture
def truth() -> Iterator[Truth]:
    """Return a drive that has run at 6.67 Hz since 1 s and is stopped at 20 s, with a ramp of 1 s."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    with ours, theirs:
        theirs.send(MotorOutput(True, 6.67, 6.67, 10.0, 1.0))
        theirs.send(MotorOutput(True, 6.67, 0.0, 6.67, 20.0))
        yield Truth(ours)


def test_a_right_state_differs_in_nothing(truth: Truth) -> None:
    assert differences(RIGHT, truth, 1.0, 20.0) == []
    on_the_ramp = replace(RIGHT, at_s=20.5, set_rpm=0.0, speed_rpm=100.2, output_frequency_hz=3.34)
    assert differences(replace(on_the_ramp, output_voltage_v=11.1), truth, 1.0, 20.0) == []
    at_rest = replace(RIGHT, at_s=30.0, running=False, set_rpm=0.0, speed_rpm=0.0, output_frequency_hz=0.0)
    assert differences(replace(at_rest, output_voltage_v=0.0, output_current_a=0.0), truth, 1.0, 20.0) == []


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("running", False, "running"),
        ("set_rpm", 0.0, "set value"),
        ("speed_rpm", 200.4, "speed"),
        ("output_frequency_hz", 6.68, "output frequency"),
        ("output_current_a", 0.61, "current"),
        ("output_voltage_v", 22.3, "voltage"),
        ("fault", "E.OC1", "fault"),
    ],
)
def test_one_wrong_value_is_found(truth: Truth, field: str, value: object, told: str) -> None:
    found = differences(replace(RIGHT, **{field: value}), truth, 1.0, 20.0)  # type: ignore[arg-type]
    assert [text.split(" of ")[0] for text in found] == [told]


def test_what_counts_as_held_and_as_stopped() -> None:
    held = Outcome(0, 0.0005, "", True, 10, (), 10, 0)
    assert (held.held, held.stopped_safely) == (True, False)
    for other in (replace(held, error=0.011), replace(held, at_rest=False)):
        assert (other.held, other.stopped_safely) == (False, False)
    stopped = replace(held, reason="no answer", error=1.0)
    assert (stopped.held, stopped.stopped_safely) == (False, True)
    assert not replace(stopped, at_rest=False).stopped_safely

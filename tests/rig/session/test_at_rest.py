"""What is seen of sensors at rest, and what taps and turns by hand say against a bench."""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.block import Flag
from drivers.ni_daq.channels import CardChannel, Mark, Pulses
from drivers.ni_daq.emulator.wiring import CardWiring, CounterWire, MarkStage, Wire
from drivers.ni_daq.sensors import described
from drivers.protocols.card import CardReading
from rig.files.bench import Bench, embedded_bench
from rig.session.at_rest import Sensors, Shaft
from rig.session.set_up import Findings, Question, answered, changes, questions
from tests.drivers.in_process import RowsPlant, opened

RATE = 6400.0
BLOCK = 480
UPPER = CardChannel("contact.force_upper", "cDAQ1Mod1/ai0", "voltage", 0.02, 200.0, unit="N")
LOWER = CardChannel("contact.force_lower", "cDAQ1Mod1/ai1", "voltage", 0.02, 200.0, unit="N")
YOKE = CardChannel("yoke.force", "cDAQ1Mod1/ai2", "force_iepe", 0.02, 200.0, unit="N")
BASE = CardChannel("base.acceleration", "cDAQ1Mod1/ai3", "acceleration_iepe", 0.01, 400.0, unit="m/s2")
FORCES = (UPPER, LOWER, YOKE)
ANGLE = CardChannel(
    "crank.angle", "cDAQ1Mod3/ctr0", "encoder", pulses=Pulses(1024, 4), unit="rad", range=math.inf
)
MARKER = CardChannel("crank.marker", "cDAQ1Mod1/ai3", "marker", 1.0, 10.0, unit="V", mark=Mark())
MARKED_RAD = math.radians(37.0)
MARK_RAD = math.radians(10.0)

Array = NDArray[Any]


def sensors(*channels: CardChannel) -> Sensors:
    return Sensors(channels, [described(each) for each in channels], RATE, {})


def show(watched: Sensors, rows: Array, *flags: Flag) -> list[str]:
    """Show samples in readings; the taps among them, in words."""
    told = []
    for first in range(0, rows.shape[1], BLOCK):
        values = rows[:, first : first + BLOCK]
        reading = CardReading(first, values, flags or (Flag.GOOD,) * len(rows), 0.0)
        tap = watched.take(reading)
        told += [] if tap is None else [watched.tapped(tap)]
    return told


def noise(rows: int, seconds: float, spread: float = 0.05) -> Array:
    return np.random.default_rng(5).normal(0.0, spread, (rows, round(seconds * RATE)))


def struck(at_s: float, height: float, seconds: float = 3.0) -> Array:
    since = np.arange(round(seconds * RATE)) / RATE - at_s
    return height * np.exp(-200.0 * np.maximum(since, 0.0)) * (since >= 0)


def words(watched: Sensors, name: str) -> dict[str, str]:
    return next(each for each in watched.shown() if each.name == name).words


def test_level_noise_mains_and_drift_of_each_channel() -> None:
    watched = sensors(UPPER, BASE)
    rows = noise(2, 12.0)
    times = np.arange(rows.shape[1]) / RATE
    rows[0] += 3.0 + 0.02 * times + 0.4 * np.sin(math.tau * 60.0 * times)
    show(watched, rows)
    told = words(watched, "contact.force_upper")
    level, noise_n, drift = (float(told[key].split()[0]) for key in ("level", "noise", "drift"))
    assert level == pytest.approx(3.0 + 0.02 * 11.5, abs=2e-3)  # of the last second
    assert noise_n == pytest.approx(0.05, rel=0.05)
    assert drift == pytest.approx(1.2, rel=0.02)
    assert told["mains"].startswith("60 Hz ")
    assert float(told["mains"].split()[2]) == pytest.approx(0.4, rel=0.02)
    still = words(watched, "base.acceleration")
    assert (still["mains"], still["drift"]) == ("", "")
    assert still["noise"].endswith("m/s²")


def test_what_is_wrong_with_a_sensor_is_said() -> None:
    watched = sensors(UPPER, YOKE, BASE)
    show(watched, noise(3, 0.2), Flag.OVERLOAD, Flag.OPEN_SENSOR, Flag.GOOD)
    assert [each.state for each in watched.shown()] == ["overload", "open sensor", ""]


def test_a_tap_is_told_by_the_farthest_swing_in_each_unit_with_its_sign() -> None:
    watched = sensors(UPPER, LOWER, BASE)
    rows = noise(3, 3.0)
    rows[1] += struck(2.0, -20.0)
    rows[0] += struck(2.0, 5.0)
    rows[2] += struck(2.0, 30.0)
    (told,) = show(watched, rows)
    assert told.startswith("contact.force_lower -20")
    assert "base.acceleration +30" in told
    assert "upper" not in told


def asked_for_taps(shown: dict[str, tuple[str, float]], channels: tuple[CardChannel, ...]) -> Any:
    """Findings of taps: which input shows it, and how far it swings, by the channel that was asked for."""
    findings, watched = Findings(), sensors(*channels)
    names = [each.name for each in channels]
    for asked, (on, height) in shown.items():
        watched = sensors(*channels)
        rows = noise(len(channels), 3.0)
        rows[names.index(on)] += struck(2.0, height)
        tap = None
        for first in range(0, rows.shape[1], BLOCK):
            reading = CardReading(first, rows[:, first : first + BLOCK], (Flag.GOOD,) * len(rows), 0.0)
            tap = watched.take(reading) or tap
        assert answered(Question("", asked), watched, tap, findings)
    found, doubts = changes(findings, watched, embedded_bench())
    return [str(each) for each in found], doubts


def test_taps_where_and_as_the_bench_says_change_nothing() -> None:
    as_said = {each.name: (each.name, 20.0) for each in FORCES}
    assert asked_for_taps(as_said, FORCES) == ([], [])


def test_swapped_cables_and_a_sensor_upside_down_are_told() -> None:
    found, doubts = asked_for_taps(
        {
            "contact.force_upper": ("contact.force_lower", 20.0),
            "contact.force_lower": ("contact.force_upper", -20.0),
            "yoke.force": ("yoke.force", -20.0),
        },
        FORCES,
    )
    assert found == [
        'contact.force_upper: physical = "cDAQ1Mod1/ai1"',
        'contact.force_lower: physical = "cDAQ1Mod1/ai0"',
        "contact.force_lower: inverted = true",
        "yoke.force: inverted = true",
    ]
    assert doubts == []


def test_a_sensor_that_is_declared_inverted_and_is_not_is_told() -> None:
    channels = (replace(UPPER, inverted=True), LOWER)
    found, _ = asked_for_taps({"contact.force_upper": ("contact.force_upper", -20.0)}, channels)
    assert found == ["contact.force_upper: inverted = false"]


def test_what_no_tap_shows_is_said_and_nothing_is_made_of_it() -> None:
    found, doubts = asked_for_taps({"contact.force_upper": ("yoke.force", 20.0)}, FORCES)
    assert found == []
    assert doubts == [
        "contact.force_upper shows on the input of yoke.force, of which no tap shows where it hangs",
        "contact.force_lower was not tapped",
        "yoke.force was not tapped",
    ]


@contextmanager
def turned(
    angle: Array, counter: CounterWire, mark: MarkStage, *channels: CardChannel
) -> Iterator[tuple[Sensors, Any]]:
    """A shaft on the emulated card; what is given reads on to a share of what it shows."""
    marks = np.where((angle - MARKED_RAD) % math.tau < MARK_RAD, 5.0, 0.0)
    wiring = CardWiring(
        {"cDAQ1Mod1/ai3": Wire("crank.marker", 1.0, 10.0, mark=mark)}, counters={"cDAQ1Mod3/ctr0": counter}
    )
    plant = RowsPlant({"crank.angle": angle, "crank.marker": marks})
    seconds = len(angle) / RATE
    with opened(plant, wiring, *channels, rate=RATE, seconds=seconds) as card:
        watched = Sensors(channels, card.channels, card.sample_rate, {})

        def on(share: float) -> None:
            while watched.end_s < share * seconds:
                watched.take(card.read(BLOCK))

        yield watched, on


def turn_and_zero(
    counter: CounterWire, mark: MarkStage, *channels: CardChannel, bench: Bench | None = None
) -> tuple[list[str], list[str], list[str]]:
    """From somewhere two and a half turns forwards, and on to angle 0; what is to change, doubts, answers."""
    ends = 3.0 * math.tau
    rises = np.linspace(0.3, ends, round(2.0 * RATE))
    angle = np.concatenate([np.full(round(0.2 * RATE), 0.3), rises, np.full(round(0.3 * RATE), ends)])
    findings = Findings()
    with turned(angle, counter, mark, *channels) as (watched, on):
        told = []
        for question, share in zip(questions(watched, bench or embedded_bench("planar_slider_crank")),
                                   (0.85, 1.0), strict=True):  # fmt: skip
            watched.shaft.begin()
            on(share)
            told.append(answered(question, watched, None, findings))
        found, doubts = changes(findings, watched, bench or embedded_bench("planar_slider_crank"))
    return [str(each) for each in found], doubts, told


def marker_angle(found: list[str]) -> float:
    (line,) = [each for each in found if each.startswith("crank.marker: angle")]
    return float(line.split('"')[1].removesuffix(" deg"))


@pytest.mark.parametrize("backwards", [False, True])
def test_a_turn_shows_which_way_an_encoder_counts_and_where_the_mark_is(backwards: bool) -> None:
    counter = CounterWire("crank.angle", 1024, backwards=backwards)
    found, doubts, told = turn_and_zero(counter, MarkStage(), ANGLE, MARKER)
    assert doubts == []
    assert ('crank.angle: direction = "backwards"' in found) is backwards
    assert marker_angle(found) == pytest.approx(37.0, abs=0.3)
    assert len(found) == 1 + backwards
    assert "crank.angle turned by" in told[0]


def test_a_bench_that_says_how_it_is_changes_nothing() -> None:
    pulses = Pulses(1024, 4, index=True, backwards=True, initial_angle=math.radians(90.0))
    counter = CounterWire("crank.angle", 1024, backwards=True, index_at=math.radians(90.0))
    marker = replace(MARKER, mark=Mark(MARKED_RAD, 12.0, falling=True), range=15.0, sensitivity=0.66)
    found = turn_and_zero(
        counter, MarkStage(12.0 * 0.66, falling=True), replace(ANGLE, pulses=pulses), marker
    )
    assert found[:2] == ([], [])


def test_an_index_somewhere_else_is_told() -> None:
    counter = CounterWire("crank.angle", 1024, index_at=math.radians(90.0))
    indexed = replace(ANGLE, pulses=Pulses(1024, 4, index=True))
    found, doubts, _ = turn_and_zero(counter, MarkStage(), indexed, replace(MARKER, mark=Mark(MARKED_RAD)))
    assert found == ['crank.angle: initial_angle = "90.0 deg"']
    assert doubts == []


@pytest.mark.parametrize("declared", [False, True])
@pytest.mark.parametrize("index_deg", [0.0, 90.0])
def test_an_encoder_with_an_index_that_counts_the_other_way_is_told_both(
    declared: bool, index_deg: float
) -> None:
    """Which way it counts hides nothing of where its index sits: what is written is right at once."""
    counter = CounterWire("crank.angle", 1024, backwards=not declared, index_at=math.radians(index_deg))
    said = Pulses(1024, 4, index=True, backwards=declared, initial_angle=math.radians(30.0))
    marker = replace(MARKER, mark=Mark(MARKED_RAD))
    found, doubts, _ = turn_and_zero(counter, MarkStage(), replace(ANGLE, pulses=said), marker)
    way = "forwards" if declared else "backwards"
    assert found == [
        f'crank.angle: direction = "{way}"',
        f'crank.angle: initial_angle = "{index_deg:.1f} deg"',
    ]
    assert doubts == []
    written = replace(said, backwards=not declared, initial_angle=math.radians(index_deg))
    again = turn_and_zero(counter, MarkStage(), replace(ANGLE, pulses=written), marker)
    assert again[:2] == ([], [])


def marked(
    typed: str, marker: CardChannel = MARKER, from_rad: float = 0.0, high: float = 5.0
) -> tuple[list[str], list[str], list[str]]:
    """A shaft with only a marker that stands, then turns twice; what is to change, doubts, answers.

    The mark is `high`, V, and all else 5 V less or more.
    """
    bench, findings, watched = embedded_bench("planar_slider_crank"), Findings(), sensors(marker)
    turns = from_rad + np.linspace(0.0, 2.0 * math.tau, round(3.0 * RATE))
    angle = np.concatenate([np.full(round(9.0 * RATE), from_rad), turns, np.full(round(RATE), turns[-1])])
    asked = list(questions(watched, bench))
    show(watched, np.where((angle - MARKED_RAD) % math.tau < MARK_RAD, high, 5.0 - high)[None, :])
    told = [answered(each, watched, None, findings, typed) for each in asked]
    found, doubts = changes(findings, watched, bench)
    return [str(each) for each in found], doubts, told


@pytest.mark.parametrize("typed", ["211.5 deg", "211.5", " 211.5 ", "3.6914 rad"])
def test_without_an_encoder_a_person_says_where_the_mark_is(typed: str) -> None:
    found, doubts, told = marked(typed)
    assert (found, doubts) == (['crank.marker: angle = "211.5 deg"'], [])
    assert told == ["2 marks; no encoder shows an angle", "crank.marker begins at 211.5°"]


def test_where_nothing_and_nobody_says_where_the_mark_is_it_is_said_so() -> None:
    for typed, last in (("", ""), ("400", "not 400: 0 deg to 359.999 deg"), ("left", "not left: 0 deg to")):
        found, doubts, told = marked(typed, replace(MARKER, mark=Mark(MARKED_RAD)))
        assert found == []
        assert told[1].startswith(last)
        assert doubts == [
            "without an encoder nothing shows where crank.marker begins: its angle stays 37.0 deg"
        ]


@pytest.mark.parametrize("from_rad", [MARKED_RAD + MARK_RAD / 2, MARKED_RAD + 3.0])
@pytest.mark.parametrize("high", [5.0, 0.0])
def test_where_a_shaft_stands_says_nothing_of_a_marks_polarity(from_rad: float, high: float) -> None:
    found, _, _ = marked("0", from_rad=from_rad, high=high)
    assert found == ([] if high else ['crank.marker: polarity = "falling"'])


def test_a_turn_without_an_encoder_is_told_by_its_marks() -> None:
    watched = sensors(MARKER)
    angle = np.concatenate([np.linspace(0.0, 2.0 * math.tau, round(3.0 * RATE)), np.zeros(round(3.0 * RATE))])
    marks = np.where((angle - MARKED_RAD) % math.tau < MARK_RAD, 5.0, 0.0)[None, :]
    told = []
    for first in range(0, marks.shape[1], BLOCK):
        watched.take(CardReading(first, marks[:, first : first + BLOCK], (Flag.GOOD,), 0.0))
        told.append(watched.shaft.rested(watched.end_s))
    assert [str(turn) for turn in told if turn] == ["2 marks; no encoder shows an angle"]


def test_a_mark_that_falls_is_told_before_its_angle() -> None:
    counter = CounterWire("crank.angle", 1024)
    found, doubts, _ = turn_and_zero(counter, MarkStage(falling=True), ANGLE, MARKER)
    assert found == ['crank.marker: polarity = "falling"']
    assert "ask again" in doubts[0]


def test_too_little_of_a_turn_says_nothing() -> None:
    angle = np.linspace(0.0, 3.0, round(2.0 * RATE))
    counter = CounterWire("crank.angle", 1024)
    with turned(angle, counter, MarkStage(), ANGLE, MARKER) as (watched, on):
        on(0.9)
        asked = next(questions(watched, embedded_bench("planar_slider_crank")))
        assert answered(asked, watched, None, findings := Findings()) == ""
    assert findings.turn is None


def test_a_turn_that_has_come_to_its_end_is_told_once() -> None:
    angle = np.concatenate([np.linspace(0.0, 4.0, round(1.0 * RATE)), np.full(round(1.5 * RATE), 4.0)])
    with turned(angle, CounterWire("crank.angle", 1024), MarkStage(), ANGLE, MARKER) as (watched, on):
        on(0.4)
        assert watched.shaft.rested(watched.end_s) is None
        on(1.0)
        assert str(watched.shaft.rested(watched.end_s)).startswith(
            "crank.angle turned by +229°; 1 mark, the last at 37."
        )
        assert watched.shaft.rested(watched.end_s) is None


@pytest.mark.parametrize("turning", [False, True])
def test_a_shaft_is_watched_for_hours_in_little_memory(turning: bool) -> None:
    shaft = Shaft([ANGLE], 51_200.0)
    sizes = []
    for number in range(3 * 8192):
        angle = np.full((1, 3840), 0.3 + turning * number)
        angle[0, 1920:] += turning * 0.5
        shaft.take(CardReading(number * 3840, angle, (Flag.GOOD,), 0.0))
        assert shaft.rested(number * 0.075) is None
        if number in (8200, 3 * 8192 - 1):
            sizes.append(len(pickle.dumps(shaft)))
    assert sizes[1] < 1.01 * sizes[0]
    assert sizes[0] < (20e6 if turning else 1e4)


def test_an_encoder_on_the_bus_tells_its_direction_and_mounting(tmp_path: Path) -> None:
    from rig.files.bench import parse_bench

    text = embedded_bench("planar_slider_crank").text
    bus = "[encoder]\nemulated = true\n"
    bench = parse_bench(f"{text}\n{bus}", "bench", tmp_path, "planar_slider_crank")
    findings, watched = Findings(), sensors(MARKER)
    times = np.arange(round(3.0 * RATE)) / RATE
    angle = math.tau * times / 1.2 + 0.1
    marks = np.where((angle - MARKED_RAD) % math.tau < MARK_RAD, 5.0, 0.0)
    show(watched, marks[None, :])
    watched.shaft.beside("encoder.angle", times, 50.0 - angle)
    turn, zero = questions(watched, bench)
    assert answered(turn, watched, None, findings)
    watched.shaft.begin()
    times += times[-1] + 1.0 / RATE
    watched.shaft.beside("encoder.angle", times, np.full(len(times), 50.0 - 3.0 * math.tau))
    assert answered(zero, watched, None, findings).startswith("encoder.angle ")
    found, doubts = changes(findings, watched, bench)
    assert doubts == []
    assert str(found[0]) == '[encoder]: direction = "backwards"'
    shown = {each.key: float(str(each.value).removesuffix(" deg")) for each in found[1:]}
    assert shown == {
        "mounting": pytest.approx(math.degrees(50.0 - MARKED_RAD) % 360.0, abs=0.3),
        "angle": pytest.approx(37.0, abs=0.3),
    }


def test_a_turn_that_only_an_encoder_on_the_bus_shows_is_told_once() -> None:
    """Of its last half minute, over and over; a count that flickers turns no shaft."""
    watched, told = sensors(MARKER), []
    times = np.arange(0.0, 6.0, 1e-3)
    angle = 4.0 * np.clip(times - 1.0, 0.0, 1.0) + 1e-3 * (np.arange(len(times)) % 2)
    for end in range(100, len(times) + 1, 100):
        watched.shaft.beside("encoder.angle", times[:end], angle[:end])
        told.append(watched.shaft.rested(float(times[end - 1])))
    assert [str(turn) for turn in told if turn] == ["encoder.angle turned by +229°"]

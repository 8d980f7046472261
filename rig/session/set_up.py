"""A bench set up by hand: a person is asked to tap one sensor after the other and to turn the shaft. Where
the bench file says otherwise than that shows, it may be changed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from daq.quantity import settings_of
from daq.signals.at_rest import Tap
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.ni_daq.channels import CardChannel, Mark
from rig.files.bench import Bench
from rig.files.bench_edit import Change
from rig.files.table import FieldError, field_of
from rig.session.at_rest import Sensors, Turn
from rig.session.encoder_record import ENCODER_CHANNEL

_WHOLE_TURN: Final = math.radians(350.0)
_OFF: Final = math.radians(0.5)
"""How far an angle may be off what the bench file says before that is worth another text."""
_MOSTLY: Final = 0.6
"""Of a turn: a mark is that long at no shaft, and what lies between two marks is."""


@dataclass
class Findings:
    """What was shown: `taps` by the channel that was asked for, with that which swung farthest, and how; what
    the encoders showed in a turn, and at the shaft's angle 0; where (rad) the mark `begins`, by a person.
    """

    taps: dict[str, tuple[CardChannel, float]] = field(default_factory=dict)
    turn: Turn | None = None
    zero: Mapping[str, float] = field(default_factory=dict)
    begins: float | None = None


@dataclass(frozen=True, slots=True)
class Question:
    """What a person is asked to do, and for which channel; empty for the shaft. Or to type an angle."""

    text: str
    channel: str = ""
    zero: bool = False
    typed: bool = False


def questions(sensors: Sensors, bench: Bench) -> Iterator[Question]:
    """In the order in which they are asked; each goes on with Enter."""
    for channel in sensors.tappable:
        way = "press or tap" if channel.unit == "N" else "tap the rig"
        yield Question(f"{channel.name}: {way} there, the way that it is to count positive", channel.name)
    marker, card = _marker(sensors), any(name != ENCODER_CHANNEL for name in sensors.shaft.names)
    if sensors.shaft.there or bench.encoder is not None:
        yield Question("turn the shaft forwards by hand, two turns at least, slowly")
        if card or (bench.encoder is not None and marker is not None):
            yield Question("turn it on to its angle 0 and leave it there", zero=True)
        elif marker is not None:
            do = "turn it on until the mark begins and type the shaft's angle there, in degrees"
            yield Question(f"{marker.name}: {do}; Enter alone where nobody knows", typed=True)


def _marker(sensors: Sensors) -> CardChannel | None:
    return next((each for each in sensors.channels if each.kind == "marker"), None)


def answered(
    question: Question, sensors: Sensors, tap: Tap | None, findings: Findings, typed: str = ""
) -> str:
    """Note what came after a question, or was `typed`; in words, nothing where that is too little."""
    if question.channel:
        unit = next(each.unit for each in sensors.channels if each.name == question.channel)
        swung = None if tap is None else sensors.swing(tap, unit)
        if swung is None:
            return ""
        findings.taps[question.channel] = swung
        channel, swing = swung
        where = "here" if channel.name == question.channel else f"on {channel.name} ({channel.physical})"
        return f"shows {where}, {'positive' if swing > 0 else 'negative'}"
    if question.typed:
        return _typed(typed, sensors, findings)
    turn = sensors.shaft.turned()
    if question.zero:
        findings.zero = turn.last
        return ", ".join(f"{name} {math.degrees(angle):.1f}°" for name, angle in findings.zero.items())
    if max((abs(by) for by in turn.turned.values()), default=math.tau * turn.marks) < _WHOLE_TURN:
        return ""
    findings.turn = turn
    return str(turn)


def _typed(text: str, sensors: Sensors, findings: Findings) -> str:
    """Note where a person says that the mark begins: degrees, or with a unit."""
    if not (text := text.strip()):
        return ""
    angle = field_of(settings_of(Mark)["angle"])
    try:
        findings.begins = float(angle.read(f"{text} deg" if text[-1].isdigit() else text))
    except FieldError as error:
        return f"not {text}: {error}"
    marker = _marker(sensors)
    return f"{'' if marker is None else marker.name} begins at {math.degrees(findings.begins):.1f}°"


def changes(findings: Findings, sensors: Sensors, bench: Bench) -> tuple[list[Change], list[str]]:
    """What of the bench file is to be otherwise, and what could not be told, in words."""
    found, doubts = list(_of_taps(findings, sensors)), list(_untold(findings, sensors))
    if findings.turn is not None:
        found += _of_the_turn(findings.turn, findings.zero, sensors, bench.encoder, doubts)
    marker = _marker(sensors)
    if marker is not None and not sensors.shaft.names and bench.encoder is None:
        found += _begins(marker, findings.begins)
        if findings.begins is None:
            stays = f"its angle stays {_degrees((marker.mark or Mark()).angle)}"
            doubts.append(f"without an encoder nothing shows where {marker.name} begins: {stays}")
    return found, doubts


def _begins(marker: CardChannel, angle: float | None) -> Iterator[Change]:
    if angle is not None and _apart(angle, (marker.mark or Mark()).angle) > _OFF:
        yield Change(marker.name, "angle", _degrees(angle))


def _moved(findings: Findings) -> dict[str, CardChannel]:
    """What hangs on another channel's input, by its name; those alone that only change places."""
    moved = {name: on for name, (on, _) in findings.taps.items() if on.name != name}
    while True:
        taken = [on.name for on in moved.values()]
        closed = {name: on for name, on in moved.items() if on.name in moved and taken.count(on.name) == 1}
        if len(closed) == len(moved):
            return closed
        moved = closed


def _untold(findings: Findings, sensors: Sensors) -> Iterator[str]:
    moved = _moved(findings)
    for channel in sensors.tappable:
        name = channel.name
        if name not in findings.taps:
            yield f"{name} was not tapped"
        elif (on := findings.taps[name][0]).name != name and name not in moved:
            yield f"{name} shows on the input of {on.name}, of which no tap shows where it hangs"


def _of_taps(findings: Findings, sensors: Sensors) -> Iterator[Change]:
    moved = _moved(findings)
    for channel in sensors.tappable:
        name = channel.name
        if name not in findings.taps or (findings.taps[name][0].name != name and name not in moved):
            continue
        on, swing = findings.taps[name]
        if name in moved:
            yield Change(name, "physical", on.physical)
        inverted = (swing < 0) != bool(on.inverted)  # as it arrives at the card
        if inverted != bool(channel.inverted):
            yield Change(name, "inverted", inverted)


def _of_the_turn(
    turn: Turn,
    zero: Mapping[str, float],
    sensors: Sensors,
    encoder: EncoderSettings | None,
    doubts: list[str],
) -> Iterator[Change]:
    named, marker, begins = {each.name: each for each in sensors.channels}, _marker(sensors), None
    if turn.high > _MOSTLY and marker is not None:
        falling = marker.mark is not None and marker.mark.falling
        yield Change(marker.name, "polarity", "rising" if falling else "falling")
        doubts.append(f"where {marker.name} begins shows once its polarity is right: ask again then")
    for name, by in turn.turned.items():
        if abs(by) < _WHOLE_TURN:
            doubts.append(f"{name} turned by {math.degrees(by):.0f}° while the shaft was to turn twice")
            continue
        marks = turn.at_marks[name]
        mark = None if turn.high > _MOSTLY or not len(marks) else float(marks[-1])
        if name in named:
            yield from _of_an_encoder(named[name], by, zero.get(name))
        elif encoder is not None:
            yield from _of_the_bus(encoder, by, mark)
        if begins is None and mark is not None and name in zero:
            begins = math.copysign(1.0, by) * (mark - zero[name])
    if marker is not None:
        yield from _begins(marker, begins)


def _of_the_bus(encoder: EncoderSettings, turned: float, at_mark: float | None) -> Iterator[Change]:
    if (turned < 0) != encoder.backwards:
        yield Change("", "direction", "backwards" if turned < 0 else "forwards")
    if at_mark is not None and (encoder.mounting is None or _apart(at_mark, encoder.mounting) > _OFF):
        yield Change("", "mounting", _degrees(at_mark))


def _of_an_encoder(channel: CardChannel, turned: float, at_zero: float | None) -> Iterator[Change]:
    pulses = channel.pulses
    if pulses is None:
        return
    if turned < 0:
        yield Change(channel.name, "direction", "forwards" if pulses.backwards else "backwards")
    if pulses.index and at_zero is not None:
        # the index sets what is read to the declared angle, and from there it goes up or, the wrong way, down
        at_index = math.copysign(1.0, turned) * (pulses.initial_angle - at_zero)
        if _apart(at_index, pulses.initial_angle) > _OFF:
            yield Change(channel.name, "initial_angle", _degrees(at_index))


def _apart(one: float, other: float) -> float:
    return float(abs(np.angle(np.exp(1j * (one - other)))))


def _degrees(angle: float) -> str:
    return f"{round(math.degrees(angle), 1) % 360.0:.1f} deg"

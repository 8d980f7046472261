"""What a sweep would do: every move in order, what guards it, how long it takes and how much it writes."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from daq.errors import ConfigurationError, Problem
from rig.files.bench import Bench
from rig.files.faults import raised_by
from rig.files.pairing import SOFT_START_FROM_S, bytes_of, check_pair, check_scenario, no_room
from rig.files.sweep import Point, Sweep, told_once
from rig.files.sweep_axes import Value
from rig.instruments import actuator_of
from rig.rigs import RIGS
from rig.session.centring import check_centring
from rig.session.centring import plan_of as centring_plan
from rig.session.drive import RAMP_S
from rig.session.interlock import SPEED_GUARDED
from rig.session.pace import Paces, Work, lasting
from rig.session.run import starts_softly
from rig.twin.scenario_twin import check_twin

_WALK_S: Final = {False: RAMP_S, True: 3.0}
"""From one value to the next on a point's path, where nothing turns and where a motor does."""
AROUND_S: Final = 3.0
"""Of each point beside settling and recording, where nothing is known of this machine: ramps, the end of the
prediction, closing the log."""
CONNECTING_S: Final = 15.0
"""Before the first point, and where the rig was set otherwise, if nothing is known: instruments, twin."""


@dataclass(frozen=True, slots=True)
class Move:
    """A key that changes `before` (None: whatever it is now) to `after`; `by_hand`: what a person does."""

    key: str
    before: Value | None
    after: Value
    by_hand: str

    def __str__(self) -> str:
        way = f"-> {self.after}" if self.before is None else f"{self.before} -> {self.after}"
        return f"{self.key} {way}"


@dataclass(frozen=True, slots=True)
class Step:
    """A point and the moves that lead to it."""

    point: Point
    moves: tuple[Move, ...]


def steps_of(sweep: Sweep) -> tuple[Step, ...]:
    """Every point in order with the moves from the one before."""
    now: dict[str, Value] = {}
    steps = []
    for point in sweep.points:
        moves = tuple(
            Move(axis.key, now.get(axis.key), point.settings[axis.key], axis.by_hand)
            for axis in sweep.axes
            if now.get(axis.key) != point.settings[axis.key]
        )
        now |= point.settings
        steps.append(Step(point, moves))
    return tuple(steps)


def check_points(
    sweep: Sweep, bench: Bench | None, today: datetime.date, free_bytes: float = float("inf")
) -> None:
    """Raise ConfigurationError with all that forbids any point of the sweep on this bench, all at once.

    Without a bench: what forbids it on any.
    """
    found: dict[Problem, list[int]] = {}
    for point in sweep.points:
        for problem in dict.fromkeys(_faults(point, bench, today, sweep.centre)):
            found.setdefault(problem, []).append(point.number)
    problems, source = told_once(found), sweep.source
    if bench is not None:
        needed = bytes_of((point.scenario.acquisition for point in sweep.points), bench)
        problems += [*_counting(sweep, bench), *no_room(needed, free_bytes)]
        source = f"{sweep.source} on {bench.source}"
    if problems:
        raise ConfigurationError(source, problems)


def _faults(point: Point, bench: Bench | None, today: datetime.date, centre: bool) -> Iterator[Problem]:
    scenario = point.scenario
    if bench is not None:
        yield from raised_by(lambda: check_pair(scenario, bench, today))
    if point.path and not starts_softly(scenario.acquisition):
        allowed = (
            f"at least {SOFT_START_FROM_S:g} s with up_and_down: the drive comes through the values before"
        )
        yield Problem("acquisition.settle", f"{scenario.acquisition.settle:g} s", allowed)
    yield from raised_by(lambda: check_scenario(scenario, scenario.name), lambda: check_twin(scenario))
    if centre:
        yield from raised_by(lambda: check_centring(scenario))
    if centre and bench is not None:
        yield from raised_by(lambda: centring_plan(scenario, bench))


def _counting(sweep: Sweep, bench: Bench) -> list[Problem]:
    """Impacts are counted on channels that the bench has, from a level within their range."""
    if sweep.until is None:
        return []
    ranges = {channel.name: channel.range for channel in bench.daq_card.channels}
    missing = [channel for channel in sweep.until.channels if channel not in ranges]
    if missing:
        allowed = f"channels of the bench: {', '.join(ranges)}"
        return [Problem("sweep.until.channels", ", ".join(missing), allowed)]
    least = min(ranges[channel] for channel in sweep.until.channels)
    if sweep.until.above is not None and sweep.until.above >= least:
        allowed = f"below {least:g}, the channel's range"
        return [Problem("sweep.until.above", f"{sweep.until.above:g}", allowed)]
    return []


def seconds_of(points: Iterable[Point]) -> float:
    """The longest that points take, without what moves by hand and connecting take."""
    return sum(
        AROUND_S
        + len(point.path) * _WALK_S[RIGS[point.scenario.rig].turns]
        + point.scenario.acquisition.settle
        + point.scenario.acquisition.duration
        for point in points
    )


def work_of(sweep: Sweep, bench: Bench, before: Point | None, point: Point) -> Work:
    """A point as work after the point `before`, in seconds: those that its record is told to take.

    Where impacts end the record, so many cycles. The first on a rig that is connected anew, and maybe
    centred, is work of another kind.
    """
    wanted, until = point.scenario.acquisition, sweep.until
    record_s = wanted.duration
    kind = f"point of {sweep.rig} on {'real' if real_instruments(bench) else 'emulated'} instruments"
    if until is not None:
        record_s = min(record_s, until.impacts / point.scenario.drive.cycle_hz)
        kind += " until enough impacts"
    if connects(sweep, before, point):
        kind = f"first {kind}{', centred' if sweep.centre else ''}"
    return Work(kind, seconds_of([point]) - wanted.duration + record_s)


def connects(sweep: Sweep, before: Point | None, point: Point) -> bool:
    """Whether the rig has to be connected anew after the point `before`."""
    if before is None or before.scenario.model != point.scenario.model:
        return True
    return any(before.settings[axis.key] != point.settings[axis.key] for axis in sweep.axes if axis.by_hand)


def left(
    sweep: Sweep, bench: Bench, points: Sequence[Point], paces: Paces, before: Point | None = None
) -> str:
    """How long points of a sweep take after the point `before`, in words.

    By what such points took on this machine; else at most, where records may end with enough impacts.
    """
    lasts_s, at_most = 0.0, False
    for earlier, point in zip([before, *points], points, strict=False):
        known_s = paces.expected_s(work_of(sweep, bench, earlier, point))
        at_most = at_most or (known_s is None and sweep.until is not None)
        if known_s is None:
            known_s = seconds_of([point]) + connects(sweep, earlier, point) * CONNECTING_S
        lasts_s += known_s
    return f"{'at most' if at_most else 'about'} {lasting(lasts_s)}"


def real_instruments(bench: Bench) -> tuple[str, ...]:
    """Tables of the bench that stand for real instruments."""
    return tuple(table for table in bench.instruments if table not in bench.emulated)


def listing(
    sweep: Sweep, bench: Bench, set_by_hand: Mapping[str, Value], ended: Mapping[int, str], paces: Paces
) -> Iterator[str]:
    """The plan in lines; `set_by_hand` is how the rig stands already, `ended` how points ended before."""
    steps = steps_of(sweep)
    hands = sum(bool(move.by_hand) for step in steps for move in step.moves)
    yield f"sweep      {sweep.name}: {len(steps)} points, {hands} moves by hand"
    yield from _guards(sweep, bench)
    width = len(str(len(steps)))
    for step in steps:
        number = str(step.point.number).rjust(width)
        said = [_said(move, set_by_hand if step is steps[0] else {}) for move in step.moves]
        outcome = ended.get(step.point.number)
        yield f"{number}  {'; '.join(said) or 'the same again'}{f' [{outcome}]' if outcome else ''}"
    if any(point.path for point in sweep.points):
        yield "path       the drive comes to each point through all values before it, without a rest"
    if sweep.centre:
        yield "centring   before the first point and after each move by hand"
    open_yet = [point for point in sweep.points if ended.get(point.number, "stopped") == "stopped"]
    lasts = left(sweep, bench, open_yet, paces)
    sooner = ""
    if sweep.until is not None and lasts.startswith("at most"):
        sooner = f", less where {sweep.until.impacts} impacts come sooner"
    yield f"time       {lasts} for {len(open_yet)} points{sooner}; moves by hand come on top"


def _said(move: Move, set_by_hand: Mapping[str, Value]) -> str:
    if not move.by_hand:
        return str(move)
    if set_by_hand.get(move.key) == move.after:
        return f"{move.key} {move.after} (set by hand already)"
    return f"BY HAND {move}: {move.by_hand}"


def _guards(sweep: Sweep, bench: Bench) -> Iterator[str]:
    kind, scenario = RIGS[sweep.rig], sweep.points[0].scenario
    actuator, asked = actuator_of(bench.actuator_table), max(p.scenario.drive.peak for p in sweep.points)
    allowed = f"{getattr(bench.actuator, actuator.highest) * actuator.per_si:g} {actuator.unit}"
    said = f"{asked * actuator.per_si:g} of {allowed} ({bench.actuator_table}.{actuator.highest})"
    yield f"guard      drive at most {said}"
    if kind.turns:
        yield f"guard      {SPEED_GUARDED}"
    for limit in scenario.limits:
        levels = [
            f"{name} {level:g} {limit.unit}"
            for name, level in (("warning", limit.warning), ("abort", limit.abort))
            if level is not None
        ]
        held = f" held for {limit.hold:g} s" if limit.hold else ""
        yield f"guard      {limit.channel}: {', '.join(levels)}{held}"
    if not any(limit.abort is not None for limit in scenario.limits):
        yield "guard      no abort limit on any channel ([limits] in the scenario)"

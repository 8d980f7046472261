"""Runs of a rig of which values may be others than their scenarios say, and what these may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from daq.errors import UnphysicalParameter
from daq.quantity import Quantity
from rig.files.quantity import si_factor
from rig.rigs import RIGS
from rig.rigs.kind import RigKind, at, tolerance_among
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.identification import VALUES
from sim_twin.diagnosis.subject import Draw, Named, Observed
from sim_twin.effects import Effect, Intervals, Parameter
from sim_twin.healthy import Tolerance
from sim_twin.twin import AnyTwin, Place

_NO_ERROR, _FARTHEST = 2.0, 25.0
"""In deviations of healthy rigs: up to the one it is right, up to the other it may be entered wrongly."""
_NEAR, _FAR = 1.01, 1.3
"""Factors that it may be off at least, where healthy rigs differ by less."""
_NEAR_RAD, _FAR_RAD = 0.02, 0.3
"""The same of an angle."""
_AMPLITUDE = "drive.amplitude"
_TIMES: Intervals = ((0.33, 0.95), (1.05, 3.0))
"""Of the scenario's: a generator may say peak to peak or RMS, an amplifier have another gain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WithValues(Campaign):
    """Runs whose draws may give values of [model] among their effects.

    Those of the name `VALUES` are in SI, those of a cause in the unit that its key has in a file; the
    amplitude of a drive is one of these causes, too. `given` is what [model] gives of each run, `doubts` are
    the values that may be wrong there.
    """

    rig: str
    given: tuple[Mapping[str, Any], ...]
    doubts: tuple[Cause, ...] = ()

    def only(self, numbers: tuple[int, ...]) -> Campaign:
        return Campaign.only(replace(self, given=tuple(self.given[k] for k in numbers)), numbers)

    def changed(self, number: int, effects: tuple[Named, ...]) -> AnyTwin:
        kind = RIGS[self.rig]
        values, times = dict[str, Any](), 1.0
        for name, each in effects:
            if name == VALUES:
                values |= each
            elif _of_model(name):
                values |= {key: float(value) * _factor(kind, key) for key, value in each.items()}
            elif name == _AMPLITUDE:
                times = float(each[_AMPLITUDE])
        if not values and times == 1.0:
            return Campaign.changed(self, number, effects)
        run = self.runs[number]
        twin = run.twin
        if values:
            twin = replace(twin, rig=kind.changed(twin.rig, self.given[number], values))
        if times != 1.0:
            twin = replace(twin, drive=replace(twin.drive, amplitude=times * twin.drive.amplitude))
        runs = list(self.runs)
        runs[number] = replace(run, twin=twin)
        others = tuple(each for each in effects if not (_of_model(each[0]) or each[0] == _AMPLITUDE))
        return Campaign.changed(replace(self, runs=tuple(runs)), number, others)

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Those that no rig can be are not simulated."""
        can = [self._can_be(draw) for draw in draws]
        observed = iter(Campaign.observe(self, [draw for draw, kept in zip(draws, can, strict=True) if kept]))
        shown = zip(draws, can, strict=True)
        return [next(observed) if kept else (None,) * len(draw.sensing) for draw, kept in shown]

    def has_values(self, draw: Draw) -> bool:
        """Whether a draw gives values of [model]."""
        return any(_of_model(name) for name, _ in draw.effects)

    def _can_be(self, draw: Draw) -> bool:
        if not self.has_values(draw):
            return True
        try:
            for number in draw.runs or range(len(self.runs)):
                self.changed(number, draw.effects)
        except UnphysicalParameter:
            return False
        return True


def _of_model(name: str) -> bool:
    return name.partition(".")[0] == VALUES


def tolerance_of(kind: RigKind, key: str, twin: AnyTwin) -> Tolerance | None:
    """What healthy rigs differ by in the value of a key; None where they do not."""
    return tolerance_among(kind, key, twin.model.healthy_spread(twin))


def closed_by(kind: RigKind, key: str, twin: AnyTwin) -> set[str]:
    """The tolerances that a known value of a key leaves nothing of, by name.

    Of a number of a list also what all of its numbers differ by together.
    """
    own, place = tolerance_of(kind, key, twin), ("rig", *kind.model[key].place)
    found = set() if own is None else {own.name}
    if not place[-1].isdigit():
        return found
    of_list = (each for each in twin.model.healthy_spread(twin) if each.place[:-1] == place[:-1])
    return found | {each.name for each in of_list if at(each.off(twin, 1.0), place) != at(twin, place)}


def with_doubts(rig: str, campaign: Campaign, given: Sequence[Mapping[str, Any]]) -> WithValues:
    """A campaign of which any value that its tables [model] have `given`, or the drive, may be wrong."""
    runs, twin = campaign.runs, campaign.runs[0].twin
    doubts = entered_wrongly(RIGS[rig], given, twin)
    if hasattr(twin.drive, "amplitude"):
        amplitude = Parameter(_AMPLITUDE, "times the scenario's", _TIMES)
        doubts += (Cause(_AMPLITUDE, "drive", (amplitude,), entered=True),)
    return WithValues(
        runs, campaign.numbers, campaign.discrepancies, rig=rig, given=tuple(given), doubts=doubts
    )


def entered_wrongly(kind: RigKind, given: Sequence[Mapping[str, Any]], twin: AnyTwin) -> tuple[Cause, ...]:
    """What may stand wrong in the [model] of some runs: each value that all share, about that of the `twin`.

    Without those that an effect of the catalogue changes.
    """
    of_effects = {key for effect in twin.model.effects.values() for key in _keys_of(kind, effect, twin)}
    found = []
    for key, setting in kind.numbers.items():
        [centre, *others] = {kind.value(key, each) for each in given}
        meaning = setting.meaning
        if key in of_effects or others or centre is None or not isinstance(meaning, Quantity):
            continue
        known, factor = _value(twin.rig, setting.place), _factor(kind, key)
        intervals = tuple(
            (max(low / factor, meaning.low), min(high / factor, meaning.high))
            for low, high in _off(
                centre if known is None else known, meaning.unit, tolerance_of(kind, key, twin)
            )
        )
        if inside := tuple((low, high) for low, high in intervals if low < high):
            parameter = Parameter(key, meaning.unit, inside)
            found.append(Cause(f"{VALUES}.{key}", _where(key, twin), (parameter,), entered=True))
    return tuple(found)


def _factor(kind: RigKind, key: str) -> float:
    """From the unit that a key has in a file to SI."""
    meaning = kind.numbers[key].meaning
    return si_factor(meaning.unit) if isinstance(meaning, Quantity) else 1.0


def _where(key: str, twin: AnyTwin) -> str:
    """The place that a key is named for, if an effect has it; else the model."""
    part = key.partition("_")[0]
    places = (effect.location for effect in twin.model.effects.values())
    return next((place for place in places if place in (part, f"{part}s")), VALUES)


def _keys_of(kind: RigKind, effect: Effect, twin: AnyTwin) -> set[str]:
    """The keys of which an effect changes the values in a rig, on any of its channels."""
    if effect.sensing or effect.refusal(twin):
        return set()
    places = {key: each.place for key, each in kind.numbers.items()}
    there = {key: value for key, place in places.items() if (value := _value(twin.rig, place)) is not None}
    found = set[str]()
    for channel in effect.channels or ("",):
        for end in (0, -1):
            values: dict[str, float | str] = {
                each.name: each.intervals[end][end] for each in effect.parameters
            }
            with suppress(ValueError):  # these may not go together, or be on this rig
                rig = effect.apply(twin, {"channel": channel, **values} if channel else values).rig
                found |= {key for key, value in there.items() if _value(rig, places[key]) != value}
    return found


def _value(rig: Any, place: Place) -> Any:
    """What stands at a place; None where a rig has none, as of what it is only made of."""
    with suppress(AttributeError):
        return at(rig, place)
    return None


def _off(centre: float, unit: str, tolerance: Tolerance | None) -> Intervals:
    """Where a value may lie that is wrong: farther off than healthy rigs; nowhere, if that cannot be said."""
    deviation = 0.0 if tolerance is None else tolerance.deviation
    near, far = _NO_ERROR * deviation, _FARTHEST * deviation
    if (tolerance is not None and not tolerance.relative) or unit == "deg":
        if unit == "deg":
            near, far = max(near, _NEAR_RAD), max(far, _FAR_RAD)
        return (centre - far, centre - near), (centre + near, centre + far)
    if not centre > 0:
        return ()
    near, far = max(1 + near, _NEAR), max(1 + far, _FAR)
    return (centre / far, centre / near), (centre * near, centre * far)

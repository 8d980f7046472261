"""What healthy rigs may differ by: tolerances by name, and rigs drawn within them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.matched import Matched, MatchedTwin
from sim_twin.sensors import SensorChain
from sim_twin.twin import AnyTwin, Twin

Array = NDArray[np.float64]
Place: TypeAlias = tuple[str, ...]
"""Attributes, keys and positions that lead from a twin to one of its numbers."""
_GAIN, _SKEW = 0.005, 2e-6
_LEAST_SHARE = 0.05
"""Of a number that cannot be negative; the bell curve of a damping would reach below zero."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """One thing that a healthy rig may differ by, normally with a standard `deviation`.

    `deviation` is a share of what the twin has where it is `relative`, else in `unit`. `place` leads to the
    number that it is told by, in `unit`; `change(twin, offset)` puts an offset (share, or in `unit`) in.
    `each_run`: set anew for each run; the rest belongs to the rig.
    """

    name: str
    deviation: float
    unit: str
    place: Place
    change: Callable[[AnyTwin, float], AnyTwin]
    relative: bool = True
    each_run: bool = False

    def off(self, twin: AnyTwin, z: float) -> AnyTwin:
        """Return `twin` off by `z` standard deviations."""
        return self.change(twin, self.deviation * z)

    def value(self, twin: AnyTwin) -> float:
        """The number in `unit` that `twin` has."""
        return float(_found(twin, self.place))


def factor(
    name: str,
    deviation: float,
    unit: str,
    place: str | Place,
    also: Mapping[str, int] | None = None,
    each_run: bool = False,
) -> Tolerance:
    """A relative tolerance of the number at `place` (with dots, from the twin).

    The numbers at places in `also` go with it, by powers of its factor.
    """
    powers = {_place(place): 1, **{_place(other): power for other, power in (also or {}).items()}}
    return Tolerance(name, deviation, unit, _place(place), partial(_multiplied, powers), each_run=each_run)


def shift(
    name: str, deviation: float, unit: str, place: str, low: float = -np.inf, high: float = np.inf
) -> Tolerance:
    """A tolerance by which the number at `place` is shifted, staying between `low` and `high`."""
    change = partial(_shifted, _place(place), low, high)
    return Tolerance(name, deviation, unit, _place(place), change, relative=False)


def of_sensors(twin: AnyTwin, gains: Mapping[str, float] | None = None) -> tuple[Tolerance, ...]:
    """Gain (0.5 %, or the channel's deviation in `gains`) and time (2 us) of every analog chain."""
    deviations = gains or {}
    analog = [
        name for name in twin.channels if isinstance(twin.sensors.get(name, SensorChain()), SensorChain)
    ]
    return tuple(each for name in analog for each in (_gain(name, deviations.get(name, _GAIN)), _time(name)))


def _gain(channel: str, deviation: float) -> Tolerance:
    return factor(f"{channel}.gain", deviation, "", ("sensors", channel, "gain"))


def _time(channel: str) -> Tolerance:
    place = ("sensors", channel, "skew")
    change = partial(_shifted, place, -np.inf, np.inf)
    return Tolerance(f"{channel}.time", _SKEW, "s", place, change, relative=False)


def drawn(
    twin: AnyTwin,
    tolerances: Sequence[Tolerance],
    rng: np.random.Generator,
    run_rng: np.random.Generator | None = None,
) -> AnyTwin:
    """Return `twin`, which has an entry for every sensor, as a healthy rig may really be on one run.

    `rng` draws what belongs to the rig, `run_rng` (default: the same) what is set anew for each run. A twin
    that was matched differs by what its calibration left open.
    """
    of_rig = [each for each in tolerances if not each.each_run]
    of_run = [each for each in tolerances if each.each_run]
    places = zip(of_rig, drawn_places(twin, tolerances, rng), strict=True)
    for tolerance, z in places:
        twin = tolerance.off(twin, float(z))
    each_run = rng if run_rng is None else run_rng
    for tolerance in of_run:
        twin = tolerance.off(twin, float(each_run.standard_normal()))
    return Twin(twin.rig, twin.drive, twin.sensors)


def drawn_places(twin: AnyTwin, tolerances: Sequence[Tolerance], rng: np.random.Generator) -> Array:
    """Where `drawn` puts the tolerances that belong to the rig, in their deviations, shape (tolerances,)."""
    names = [each.name for each in tolerances if not each.each_run]
    normals = rng.standard_normal(len(names))
    return twin.known.placed(names, normals) if isinstance(twin, MatchedTwin) else normals


def moved(twin: AnyTwin, tolerances: Sequence[Tolerance], matched: Matched) -> AnyTwin:
    """Return `twin` with the means of `matched` in; healthy rigs about it differ by what is still open."""
    known = matched.only([each.name for each in tolerances if not each.each_run])
    for tolerance in tolerances:
        twin = tolerance.off(twin, known.mean_of(tolerance.name))
    return MatchedTwin(twin.rig, twin.drive, twin.sensors, known.centred())


def _place(place: str | Place) -> Place:
    return tuple(place.split(".")) if isinstance(place, str) else place


def _found(whole: Any, place: Place) -> Any:
    for name in place:
        whole = _part(whole, name)
    return whole


def _part(whole: Any, name: str) -> Any:
    if isinstance(whole, Mapping):
        return whole[name]
    return whole[int(name)] if isinstance(whole, tuple) else getattr(whole, name)


def _changed(whole: Any, place: Place, new: Callable[[float], float]) -> Any:
    """`whole` with the number at `place` made new; what is None there stays so."""
    name, *rest = place
    old = _part(whole, name)
    if old is None:
        return whole
    part = _changed(old, tuple(rest), new) if rest else float(new(old))
    if isinstance(whole, Mapping):
        return {**whole, name: part}
    if isinstance(whole, tuple):
        at = int(name)
        return (*whole[:at], part, *whole[at + 1 :])
    return replace(whole, **{name: part})


def _multiplied(powers: Mapping[Place, int], twin: AnyTwin, offset: float) -> AnyTwin:
    by = max(1 + offset, _LEAST_SHARE)
    for place, power in powers.items():
        twin = _changed(twin, place, lambda old, power=power: old * by**power)  # type: ignore[misc]
    return twin


def _shifted(place: Place, low: float, high: float, twin: AnyTwin, offset: float) -> AnyTwin:
    shifted: AnyTwin = _changed(twin, place, lambda old: min(max(old + offset, low), high))
    return shifted

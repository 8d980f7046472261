"""What healthy rigs may differ by: tolerances by name, rigs drawn within them, what a calibration found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from daq.errors import UnphysicalParameter
from sim_twin.sensors import SensorChain
from sim_twin.twin import AnyTwin, DriveT, Place, RigT, Twin, changed, part_of

Array = NDArray[np.float64]
_GAIN, _SKEW = 0.005, 2e-6
_LEAST_SHARE = 0.05
"""Of a number that cannot be negative; the bell curve of a damping would reach below zero."""


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """Tolerances in `names` are normal, with `mean` (n,) and `covariance` (n, n) in their own deviations.

    Before anything is known, means are 0 and the covariance is the identity.
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array

    @property
    def deviation(self) -> Array:
        """Of each tolerance, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    def mean_of(self, name: str) -> float:
        """Where the tolerance `name` lies; 0 for one that was not looked at."""
        return float(self.mean[self.names.index(name)]) if name in self.names else 0.0

    def only(self, names: Sequence[str]) -> Matched:
        """The same for those of `names` that it knows."""
        kept = [k for k, name in enumerate(self.names) if name in names]
        held = tuple(self.names[k] for k in kept)
        return Matched(held, self.mean[kept], self.covariance[np.ix_(kept, kept)])

    def centred(self) -> Matched:
        """What is still open once the means are in."""
        return replace(self, mean=np.zeros_like(self.mean))

    def placed(self, names: Sequence[str], normals: Array) -> Array:
        """Where the tolerances `names` lie for independent standard `normals` (n,); others stay there."""
        places = normals.copy()
        held = [names.index(name) for name in self.names if name in names]
        here = self.only(names)
        values, vectors = np.linalg.eigh(here.covariance)
        # the symmetric root: what is not known is drawn as if without the covariance
        root = np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
        places[held] = here.mean + root @ normals[held]
        return places


@dataclass(frozen=True, slots=True)
class MatchedTwin(Twin[RigT, DriveT], Generic[RigT, DriveT]):
    """A twin that was matched to its rig; `known` is what that has left open of its tolerances."""

    known: Matched = field(default_factory=lambda: Matched((), np.zeros(0), np.zeros((0, 0))))


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
    change: Callable[[AnyTwin, float], AnyTwin] = field(repr=False, compare=False)
    relative: bool = True
    each_run: bool = False

    def off(self, twin: AnyTwin, z: float) -> AnyTwin:
        """Return `twin` off by `z` standard deviations."""
        return self.change(twin, self.deviation * z)

    def value(self, twin: AnyTwin) -> float:
        """The number in `unit` that `twin` has."""
        number: Any = twin
        for name in self.place:
            number = part_of(number, name)
        return float(number)


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
    name: str, deviation: float, unit: str, place: str | Place, low: float = -np.inf, high: float = np.inf
) -> Tolerance:
    """A tolerance by which the number at `place` is shifted, staying between `low` and `high`."""
    change = partial(_shifted, _place(place), low, high)
    return Tolerance(name, deviation, unit, _place(place), change, relative=False)


def where_possible(tolerance: Tolerance) -> Tolerance:
    """The same, but that a twin stays as it is where no rig can be as far off."""
    return replace(tolerance, change=partial(_where_possible, tolerance.change))


def of_sensors(twin: AnyTwin, gains: Mapping[str, float] | None = None) -> tuple[Tolerance, ...]:
    """Gain (0.5 %, or the channel's deviation in `gains`) and time (2 us) of every analog chain.

    Pulses that a counter times have no gain.
    """
    deviations = gains or {}
    found: list[Tolerance] = []
    for name in twin.channels:
        chain = twin.sensors.get(name, SensorChain())
        if isinstance(chain, SensorChain):
            if chain.pulses is None:
                deviation = deviations.get(name, _GAIN)
                found.append(factor(f"{name}.gain", deviation, "", ("sensors", name, "gain")))
            found.append(shift(f"{name}.time", _SKEW, "s", ("sensors", name, "skew")))
    return tuple(found)


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
    return MatchedTwin(twin.rig, twin.drive, twin.sensors, twin.widths, twin.besides, known.centred())


def _place(place: str | Place) -> Place:
    return tuple(place.split(".")) if isinstance(place, str) else place


def _multiplied(powers: Mapping[Place, int], twin: AnyTwin, offset: float) -> AnyTwin:
    by = max(1 + offset, _LEAST_SHARE)

    def times(power: int) -> Callable[[float], float]:
        return lambda old: float(old * by**power)

    multiplied: AnyTwin = changed(twin, {place: times(power) for place, power in powers.items()})
    return multiplied


def _where_possible(change: Callable[[AnyTwin, float], AnyTwin], twin: AnyTwin, offset: float) -> AnyTwin:
    try:
        return change(twin, offset)
    except UnphysicalParameter:
        return twin


def _shifted(place: Place, low: float, high: float, twin: AnyTwin, offset: float) -> AnyTwin:
    shifted: AnyTwin = changed(twin, {place: lambda old: float(min(max(old + offset, low), high))})
    return shifted

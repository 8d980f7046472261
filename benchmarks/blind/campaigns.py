"""Draws campaigns: one to three runs on one rig, in which something is hidden or nothing is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import cycle, islice
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np

from benchmarks.blind.catalogue import BEAM, CATALOGUE, CRANK, PIVOTED_ONLY, SPATIAL, EffectEntry
from benchmarks.blind.operating_points import PointOfRun, beam_points, crank_points, spatial_points

Kind = Literal["single", "none", "pair", "outside"]
SHARES: Mapping[Kind, float] = {"single": 0.40, "none": 0.25, "pair": 0.20, "outside": 0.15}
RIGS = (BEAM, CRANK, SPATIAL)
MOST_RUNS = 3
_ALUMINIUM_SHARE = 0.2
_ONE_STIFFNESS = frozenset(("contact_stiffness", "hertzian_contact"))
"""A pair of these has no meaning of its own: the second replaces what the first scales."""


class Outsider(Protocol):
    """An effect that the catalogue does not hold."""

    def draw(self, rng: np.random.Generator) -> EffectEntry:
        """Its name and parameters as a truth engine takes them."""


Outsiders: TypeAlias = Mapping[str, Sequence[Outsider]]


@dataclass(frozen=True, slots=True)
class Campaign:
    """One rig, its runs and what is hidden in it. `name` says nothing of the answer."""

    name: str
    rig: str
    kind: Kind
    runs: tuple[PointOfRun, ...]
    effects: tuple[EffectEntry, ...]
    rig_seed: int
    run_seeds: tuple[int, ...]

    def as_json(self) -> dict[str, Any]:
        """The campaign as it is sealed."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Campaign:
        """The campaign as it was sealed."""
        several = {key: tuple(data[key]) for key in ("runs", "effects", "run_seeds")}
        return cls(data["name"], data["rig"], data["kind"], rig_seed=data["rig_seed"], **several)


@dataclass(frozen=True, slots=True)
class _Plan:
    rig: str
    kind: Kind
    names: tuple[str, ...] = ()
    outsider: Outsider | None = None


def draw_campaigns(
    count: int, seed: int, outside: Outsiders, rigs: Sequence[str] = RIGS
) -> tuple[Campaign, ...]:
    """Draw `count` campaigns of `rigs`; the same seed and `outside` effects give the same campaigns."""
    rng = np.random.default_rng(seed)
    plans = _plans(count, outside, rigs, rng)
    order = rng.permutation(len(plans))
    return tuple(_campaign(f"c{place:03d}", plans[index], rng) for place, index in enumerate(order))


def numbers_of_kinds(count: int) -> dict[Kind, int]:
    """How many campaigns of each kind: the shares, with what is left over to the largest remainders."""
    numbers: dict[Kind, int] = {kind: int(share * count) for kind, share in SHARES.items()}
    by_remainder = sorted(SHARES, key=lambda kind: numbers[kind] - SHARES[kind] * count)
    for kind in by_remainder[: count - sum(numbers.values())]:
        numbers[kind] += 1
    return numbers


def _plans(count: int, outside: Outsiders, rigs: Sequence[str], rng: np.random.Generator) -> list[_Plan]:
    numbers = numbers_of_kinds(count)
    return [
        *islice(_singles(rigs, rng), numbers["single"]),
        *islice((_Plan(rig, "none") for rig in cycle(rigs)), numbers["none"]),
        *islice(_pairs(rigs, rng), numbers["pair"]),
        *islice(_outsiders(outside, rigs, rng), numbers["outside"]),
    ]


def _singles(rigs: Sequence[str], rng: np.random.Generator) -> Iterator[_Plan]:
    """Every effect of every rig once, then again: as balanced as the number allows."""
    every = [_Plan(rig, "single", (name,)) for rig in rigs for name in CATALOGUE[rig]]
    while True:
        yield from (every[index] for index in rng.permutation(len(every)))


def _pairs(rigs: Sequence[str], rng: np.random.Generator) -> Iterator[_Plan]:
    for rig in cycle(rigs):
        names = list(CATALOGUE[rig])
        chosen = frozenset[str]()
        while not chosen or chosen == _ONE_STIFFNESS:
            first, second = (names[index] for index in rng.choice(len(names), 2, replace=False))
            chosen = frozenset((first, second))
        yield _Plan(rig, "pair", (first, second))


def _outsiders(outside: Outsiders, rigs: Sequence[str], rng: np.random.Generator) -> Iterator[_Plan]:
    turns = {rig: cycle(rng.permutation(len(outside[rig]))) for rig in rigs}
    for rig in cycle(rigs):
        yield _Plan(rig, "outside", outsider=outside[rig][next(turns[rig])])


def _campaign(name: str, plan: _Plan, rng: np.random.Generator) -> Campaign:
    runs = int(rng.integers(1, MOST_RUNS + 1))
    effects = tuple(CATALOGUE[plan.rig][each].draw(rng) for each in plan.names)
    if plan.outsider is not None:
        effects = (plan.outsider.draw(rng),)
    if plan.rig == CRANK:
        points = crank_points(runs, rng)
    elif plan.rig == SPATIAL:
        points = spatial_points(runs, rng)
    else:
        pivoted = plan.kind == "outside" or any(each in PIVOTED_ONLY for each in plan.names)
        aluminium = not pivoted and rng.random() < _ALUMINIUM_SHARE
        points = beam_points(runs, "aluminium" if aluminium else "steel", rng)
    seeds = tuple(int(each) for each in rng.integers(2**31, size=runs))
    return Campaign(name, plan.rig, plan.kind, points, effects, int(rng.integers(2**31)), seeds)

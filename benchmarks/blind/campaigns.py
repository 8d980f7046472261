"""Draws campaigns: one to three runs on one rig, in which something is hidden or nothing is."""

from __future__ import annotations

import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain, cycle, islice
from typing import Any, Protocol, TypeAlias

import numpy as np

from benchmarks.blind.catalogue import BEAM, CATALOGUE, PIVOTED_ONLY, WIRED, EffectEntry, swapped_by
from benchmarks.blind.operating_points import PointOfRun, left_out, longest, points
from benchmarks.blind.outsiders import Outside
from benchmarks.blind.sets import HEALTHY, HIDDEN, OUTSIDE, RIGS, SETS, CheckSet, Kind

MOST_RUNS = 3
_ALUMINIUM_SHARE = 0.2
_COUNTED = "crank.angle"
"""No analog channel: the others can be late against it."""
_ONE_STIFFNESS = frozenset(("contact_stiffness", "hertzian_contact"))
"""A pair of these has no meaning of its own: the second replaces what the first scales."""


class Unlisted(Protocol):
    """What a truth engine has that the catalogue has not."""

    MILD: Sequence[Outside]
    STRONG: Sequence[Outside]
    PAGES: Mapping[str, Sequence[Outside]]


Engines: TypeAlias = Mapping[str, Unlisted]


def channel_of(effect: EffectEntry) -> str:
    """The channel that an effect sits on; empty where it sits on none."""
    values = effect["parameters"]
    return str(values.get("channel", "")) if isinstance(values, dict) else ""


def _needed(effect: EffectEntry) -> tuple[str, ...]:
    """Channels without which nobody can see what is wrong with them."""
    values = effect["parameters"]
    if effect["name"] == "swapped_channels" and isinstance(values, dict):
        return swapped_by(values)
    return (_COUNTED,) if effect["name"] == "analog_delay" else (channel_of(effect),)


@dataclass(frozen=True, slots=True)
class Campaign:
    """One rig, its runs and what is hidden in it. `name` says nothing of the answer.

    `number` counts within its set, kind and rig; `rank` is its share of that, so that a part of each comes
    first.
    `page` is what its truth has otherwise than the twin's, `missing` are channels that nobody recorded.
    `places` are where something of no catalogue sits, `novel` where no threshold was set with its class.
    `lab` has the runs to calibrate by, `same_rig` is the healthy run of this rig.
    """

    name: str
    rig: str
    kind: Kind
    runs: tuple[PointOfRun, ...]
    effects: tuple[EffectEntry, ...]
    rig_seed: int
    run_seeds: tuple[int, ...]
    of_set: str = "singles"
    number: int = 0
    rank: float = 0.0
    page: tuple[EffectEntry, ...] = ()
    wider: float = 1.0
    missing: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    novel: bool = False
    lab: str = ""
    same_rig: str = ""

    def as_json(self) -> dict[str, Any]:
        """The campaign as it is sealed."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Campaign:
        """The campaign as it was sealed."""
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in data.items()
        }
        return cls(**values)

    @property
    def right_page(self) -> bool:
        """Whether the twin's laws, values and tolerances are the truth's."""
        return not self.page and self.wider == 1.0


def draw_campaigns(seed: int, engines: Engines, sets: Mapping[str, CheckSet] = SETS) -> tuple[Campaign, ...]:
    """Draw all campaigns of a full check, and the healthy runs to calibrate by.

    The campaigns of a set on a rig hang on nothing but `seed`, the set and what the engines offer. They come
    by rank: any part from the beginning has a like share of each set.
    """
    drawn, healthy = list[Campaign](), list[Campaign]()
    for each in sets.values():
        for rig in RIGS:
            rng = np.random.default_rng([seed, zlib.crc32(each.name.encode()), RIGS.index(rig)])
            references, campaigns = _of_rig(each, rig, engines[rig], rng)
            healthy += references
            drawn += campaigns
    drawn.sort(key=lambda campaign: campaign.rank)
    names = {old.name: f"h{place:04d}" for place, old in enumerate(healthy)}
    return (
        *(replace(campaign, name=names[campaign.name]) for campaign in healthy),
        *(
            replace(campaign, name=f"c{place:04d}", same_rig=names.get(campaign.same_rig, ""))
            for place, campaign in enumerate(drawn)
        ),
    )


def chosen(
    campaigns: Sequence[Campaign],
    sets: Collection[str] = tuple(SETS),
    rigs: Collection[str] = RIGS,
    share: float = 1.0,
    each: int | None = None,
) -> list[Campaign]:
    """Those of some sets and rigs: a share of each, or the first `each` of every set, kind and rig."""
    return [
        campaign
        for campaign in campaigns
        if campaign.kind != "reference"
        and campaign.of_set in sets
        and campaign.rig in rigs
        and (campaign.rank < share if each is None else campaign.number < each)
    ]


def references_of(campaigns: Sequence[Campaign], of: Sequence[Campaign]) -> list[Campaign]:
    """The healthy runs that campaigns are calibrated by."""
    labs, own = ({getattr(one, name) for one in of} - {""} for name in ("lab", "same_rig"))
    return [
        each
        for each in campaigns
        if each.kind == "reference" and (each.name in own or (each.lab in labs and not each.same_rig))
    ]


def _of_rig(
    of: CheckSet, rig: str, engine: Unlisted, rng: np.random.Generator
) -> tuple[list[Campaign], list[Campaign]]:
    references, campaigns = list[Campaign](), list[Campaign]()
    if not any(counts.get(rig) for counts in of.counts.values()):
        return references, campaigns
    labs = [f"{of.name} {rig} {number}" for number in range(of.labs)] or [""]
    pages = {lab: _page(of, engine, rng) for lab in labs}
    for lab in labs if of.labs else ():
        plain = replace(_campaign(of, rig, (), rng), page=pages[lab], lab=lab, missing=())
        references += (replace(plain, **_other_rig(plain, rng, number)) for number in range(HEALTHY))
    for kind, counts in of.counts.items():
        for number, effects in enumerate(islice(_hidden(kind, rig, engine, rng), counts.get(rig, 0))):
            lab = labs[number % len(labs)]
            rank = (number + float(rng.random())) / counts[rig]
            campaign = replace(
                _campaign(of, rig, effects, rng),
                kind=kind,
                number=number,
                rank=rank,
                page=pages[lab],
                lab=lab,
            )
            if of.labs:
                own = f"{lab} {kind} {number}"
                campaign = replace(campaign, same_rig=own)
                references.append(_healthy_run(campaign, own, rng))
            campaigns.append(campaign)
    return references, campaigns


def _page(of: CheckSet, engine: Unlisted, rng: np.random.Generator) -> tuple[EffectEntry, ...]:
    if of.page is None:
        return ()
    laws = engine.PAGES[of.page]
    return (laws[int(rng.integers(len(laws)))].draw(rng),)


def _other_rig(lab: Campaign, rng: np.random.Generator, number: int) -> dict[str, Any]:
    """What another rig of a lab has of its own: its seeds, and one long run as the lab's others set it."""
    return {
        "name": f"{lab.lab} reference {number}",
        "kind": "reference",
        "runs": (longest(lab.runs[0]),),
        "rig_seed": int(rng.integers(2**31)),
        "run_seeds": (int(rng.integers(2**31)),),
    }


def _healthy_run(campaign: Campaign, name: str, rng: np.random.Generator) -> Campaign:
    """One run of a campaign's rig from before anything was wrong with it, at a setting of its own."""
    beam = str(campaign.runs[0].get("beam", ""))
    return replace(
        campaign,
        name=name,
        kind="reference",
        effects=(),
        missing=(),
        runs=points(campaign.rig, 1, rng, beam),
        run_seeds=(int(rng.integers(2**31)),),
    )


def _hidden(
    kind: Kind, rig: str, engine: Unlisted, rng: np.random.Generator
) -> Iterator[tuple[EffectEntry | Outside, ...]]:
    if kind in OUTSIDE:
        yield from ((each,) for each in _outsiders(engine.MILD if kind == "mild" else engine.STRONG, rng))
    causes, number = (WIRED if kind == "wired" else CATALOGUE)[rig], HIDDEN[kind]
    names = list(causes)
    if number == 0:
        yield from cycle(((),))
    turns = chain.from_iterable(rng.permutation(names) for _ in cycle((0,)))
    for first in turns:
        together = {str(first)}
        while len(together) < number or together >= _ONE_STIFFNESS:
            others = rng.choice(names, number - 1, replace=False)
            together = {str(first), *(str(other) for other in others)}
        yield tuple(causes[name].draw(rng) for name in sorted(together, key=names.index))


def _outsiders(every: Sequence[Outside], rng: np.random.Generator) -> Iterator[Outside]:
    """Novel classes and others by turns, each as often as the others of its sort."""
    sorts = [[each for each in every if each.novel is novel] for novel in (True, False)]
    turns = [cycle([sort[index] for index in rng.permutation(len(sort))]) for sort in sorts if sort]
    for turn in cycle(turns):
        yield next(turn)


def _campaign(
    of: CheckSet, rig: str, hidden: Sequence[EffectEntry | Outside], rng: np.random.Generator
) -> Campaign:
    runs = int(rng.integers(1, MOST_RUNS + 1))
    outsiders = [each for each in hidden if isinstance(each, Outside)]
    effects = tuple(each.draw(rng) if isinstance(each, Outside) else each for each in hidden)
    pivoted = bool(outsiders) or any(effect["name"] in PIVOTED_ONLY for effect in effects)
    aluminium = rig == BEAM and not of.labs and not pivoted and rng.random() < _ALUMINIUM_SHARE
    settings = points(rig, runs, rng, "aluminium" if aluminium else "steel")
    needed = {name for effect in effects for name in _needed(effect)}
    return Campaign(
        name="",
        rig=rig,
        kind="none",
        runs=settings,
        effects=effects,
        rig_seed=int(rng.integers(2**31)),
        run_seeds=tuple(int(each) for each in rng.integers(2**31, size=runs)),
        of_set=of.name,
        wider=of.wider,
        missing=left_out(rig, needed, rng),
        places=tuple(place for each in outsiders for place in (each.location, *each.also)),
        novel=any(each.novel for each in outsiders),
    )

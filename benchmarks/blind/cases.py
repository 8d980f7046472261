"""A case: what was hidden, what the diagnosis said, and how far its effects close the gap."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.catalogue import CATALOGUE
from benchmarks.blind.sets import OUTSIDE

NONE, UNKNOWN = "none", "unknown"
VISIBLE_GAP, VISIBLE_SHRINK = 1.1, 0.1
"""Settings show an effect where the nominal twin is this far off and the true effect closes this much.

Campaigns of the truth engines in which nothing is hidden lie at 0.95 to 1.05 (ten of them).
"""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter: `value` and its 95 % interval; a channel has no interval, nor has what was not fitted."""

    value: float | str | None
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Ranked:
    """One effect in the diagnosis's list."""

    name: str
    location: str
    probability: float
    shrink: float | None = None
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    alike: tuple[str, ...] = ()

    @property
    def named(self) -> frozenset[str]:
        """The effect and those that it is said not to be told from."""
        return frozenset((self.name, *self.alike))


@dataclass(frozen=True, slots=True)
class Answer:
    """What a diagnosis says: probabilities of "none" and "unknown", every effect, and those it `selected`.

    `place` is where most of the gap comes from, whatever it is. `left` is the gap with what it selected.
    """

    none: float
    unknown: float
    effects: tuple[Ranked, ...]
    selected: tuple[str, ...]
    place: str = ""
    left: float | None = None

    def probability(self, label: str) -> float:
        """What the answer gives an effect, "none" or "unknown"."""
        return dict(self.ranking()).get(label, 0.0)

    def ranking(self) -> list[tuple[str, float]]:
        """Effects, "none" and "unknown" with their probabilities, most probable first."""
        every = [(each.name, each.probability) for each in self.effects]
        every += [(NONE, self.none), (UNKNOWN, self.unknown)]
        return sorted(every, key=lambda pair: -pair[1])

    def named_by(self, label: str) -> frozenset[str]:
        """The set of answers that naming `label` stands for."""
        return next((each.named for each in self.effects if each.name == label), frozenset((label,)))


@dataclass(frozen=True, slots=True)
class Gaps:
    """Gap to the nominal twin, to the twin with the true effects and to that with the answer's; 1 = floor."""

    before: float
    oracle: float
    after: float | None = None

    @property
    def visible(self) -> bool:
        """Whether the runs can show what is hidden."""
        return self.before > VISIBLE_GAP and self.oracle_shrink >= VISIBLE_SHRINK

    @property
    def oracle_shrink(self) -> float:
        """How far the true effects with true parameters close the gap."""
        return shrink(self.before, self.oracle)

    @property
    def relative_shrink(self) -> float:
        """The answer's shrink relative to the true effects', between -1 and 1; no answer closes nothing."""
        after = self.before if self.after is None else self.after
        return max(-1.0, min(1.0, shrink(self.before, after) / self.oracle_shrink))


@dataclass(frozen=True, slots=True)
class Case:
    """A campaign with its answer (None: the diagnosis failed), its gaps, and what it cost.

    `calibrated`: diagnosed with a model of healthy rigs. Wall and processor time in s, memory in MB. `above`
    and `outranks` are `held_out`'s.
    """

    campaign: Campaign
    answer: Answer | None
    gaps: Gaps | None = None
    wall_s: float | None = None
    cpu_s: float | None = None
    memory_mb: float | None = None
    calibrated: bool = False
    above: float | None = None
    outranks: float | None = None

    @property
    def outside(self) -> bool:
        """Whether what is hidden is in no catalogue."""
        return self.campaign.kind in OUTSIDE

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of the hidden effects of the catalogue."""
        if self.outside:
            return ()
        return tuple(str(effect["name"]) for effect in self.campaign.effects)

    @property
    def truth(self) -> frozenset[str]:
        """What is right to say: the hidden effect (any of several), "none" or "unknown"."""
        if self.outside:
            return frozenset((UNKNOWN,))
        return frozenset(self.hidden or (NONE,))

    @property
    def visible(self) -> bool:
        """Whether the runs can show what is hidden; taken for granted where it was not measured."""
        if self.gaps is None:
            return True
        return self.gaps.before > VISIBLE_GAP if self.outside else self.gaps.visible

    @property
    def catalogue_size(self) -> int:
        """Effects of the rig."""
        return len(CATALOGUE[self.campaign.rig])


def shrink(before: float, after: float) -> float:
    """1 - max(after - 1, 0) / (before - 1); 0 where there is no gap to close."""
    return 0.0 if before <= 1 else 1 - max(after - 1, 0.0) / (before - 1)


def answer_of(diagnosis: Mapping[str, Any]) -> Answer:
    """Read a diagnosis.json; raises KeyError, TypeError or ValueError where it is none."""
    verdict = diagnosis["verdict_probability"]
    effects = tuple(_ranked(each) for each in diagnosis["effects"])
    gap = diagnosis.get("gap") or {}
    places: Mapping[str, float] = gap.get("by_location") or {}
    answer = Answer(
        float(verdict[NONE]),
        float(verdict[UNKNOWN]),
        effects,
        tuple(diagnosis["selected"]),
        max(places, key=lambda place: places[place], default=""),
        gap.get("after"),
    )
    total = sum(probability for _, probability in answer.ranking())
    if not math.isclose(total, 1, abs_tol=0.02):
        raise ValueError(f"the probabilities add up to {total:g}")
    return answer


def _ranked(entry: Mapping[str, Any]) -> Ranked:
    parameters = {name: _estimate(value) for name, value in (entry.get("parameters") or {}).items()}
    return Ranked(
        name=entry["name"],
        location=entry["location"],
        probability=float(entry["probability"]),
        shrink=entry.get("shrink"),
        parameters=parameters,
        alike=tuple(entry.get("indistinguishable_from") or ()),
    )


def _estimate(entry: Mapping[str, Any]) -> Estimate:
    interval: Sequence[float] | None = entry.get("ci95")
    return Estimate(entry["value"], None if interval is None else (interval[0], interval[1]))

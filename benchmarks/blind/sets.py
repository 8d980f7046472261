"""The sets of the check: what is hidden on which rigs, how often, and what the truth is like.

A set is a line of the table. `python -m benchmarks.blind` takes sets, rigs and shares of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from benchmarks.blind.catalogue import BEAM, CRANK, SPATIAL

RIGS: Final = (BEAM, CRANK, SPATIAL)
Kind: TypeAlias = Literal["none", "single", "pair", "triple", "wired", "mild", "strong", "reference"]
"""What is hidden: `wired` is one of what people wire wrongly, `mild` and `strong` are in no catalogue,
`reference` is a run known to be healthy."""
Counts: TypeAlias = Mapping[str, int]
HIDDEN: Final[Mapping[Kind, int]] = {"none": 0, "single": 1, "pair": 2, "triple": 3, "wired": 1}
OUTSIDE: Final = ("mild", "strong")


@dataclass(frozen=True, slots=True)
class CheckSet:
    """Campaigns that are drawn alike; `counts` of each kind and rig are those of a full check.

    `page` is what the truth has otherwise than the twin's page (a key of the engines' `PAGES`), of tolerances
    so many times `wider`. With `labs`, so many labs a rig each have a draw of the page, `HEALTHY` healthy
    rigs to calibrate by, and a healthy run of each campaign's rig: campaigns are diagnosed without and with
    these.
    """

    name: str
    counts: Mapping[Kind, Counts]
    page: str | None = None
    wider: float = 1.0
    labs: int = 0


HEALTHY: Final = 5
"""Rigs of a lab from which `rattle calibrate --spread` learns."""


def _each(beam: int, crank: int, spatial: int) -> Counts:
    return {BEAM: beam, CRANK: crank, SPATIAL: spatial}


_SINGLES: Final = _each(75, 78, 60)
"""Whole rounds of each catalogue. Figures are of those that show, of which 60, 60 and 40 are needed. Of the
last check's 48 on beam and planar crank 44 did (0.80 at the least of its interval). Of the spatial crank's
nobody knows, but every seventh is in the sensor of a point that is hardly touched.
"""


def _lab(name: str, page: str | None = None, beam: int = 8, wider: float = 1.0) -> CheckSet:
    counts = _each(beam, 8, 8)
    return CheckSet(name, {"none": counts, "single": counts}, page, wider, labs=2)


SETS: Final = {
    each.name: each
    for each in (
        CheckSet("singles", {"single": _SINGLES}),
        CheckSet("healthy", {"none": _each(60, 60, 40)}),
        CheckSet("pairs", {"pair": _each(30, 30, 20)}),
        CheckSet("triples", {"triple": _each(15, 15, 10)}),
        CheckSet("wired", {"wired": _each(12, 12, 8)}),
        CheckSet("mild", {"mild": _each(30, 30, 20)}),
        CheckSet("strong", {"strong": _each(30, 30, 20)}),
        _lab("lab"),
        _lab("exponent", "exponent"),
        _lab("modes", "modes"),
        _lab("friction", "friction", beam=0),  # the beam's page has none
        _lab("tolerances", wider=2.0),
        _lab("value", "value"),
    )
}
WRONG_PAGES: Final = ("exponent", "modes", "friction", "tolerances", "value")

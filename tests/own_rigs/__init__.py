"""Three measured sets as rigs of one's own: small twins that the diagnosis has never heard of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.belief import largest
from sim_twin.diagnosis.library import Library
from sim_twin.diagnosis.search import Search
from sim_twin.diagnosis.subject import Subject

MEASURED = Path(__file__).parents[2].parent / "shared" / "real-data"
"""The measured sets lie beside the project, not in it."""
_MOTIONS = 400
_ALIKE = 0.3

needs_measured_sets = pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no {MEASURED}")


@dataclass(frozen=True, slots=True)
class Verdict:
    """The most probable set of missing effects, and what may be the largest of them.

    `alike` begins with the likeliest, has "none" for nothing, and holds all that cannot be told from it.
    """

    selected: tuple[str, ...]
    alike: tuple[str, ...]


def verdict(subject: Subject, measured: NDArray[np.float32], seed: int) -> Verdict:
    """What is missing by measured fingerprints (blocks, numbers).

    Effects are alike that are at least 0.3 times as probable as the likeliest.
    """
    search = Search(subject, measured, subject.observe, np.random.default_rng(seed), Library(), _MOTIONS)
    attribution, ranked = search.run()
    shares: dict[str, float] = {}
    for each in ranked:
        name = largest(attribution, each.hypothesis, each.best()) if each.hypothesis else "none"
        shares[name] = shares.get(name, 0.0) + each.probability
    order = sorted(shares, key=lambda name: -shares[name])
    alike = tuple(name for name in order if shares[name] >= _ALIKE * shares[order[0]])
    return Verdict(tuple(cause.name for cause in ranked[0].hypothesis), alike)

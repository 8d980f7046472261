"""Three measured sets as rigs of one's own: small twins that the diagnosis has never heard of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.diagnose import Effort, diagnose
from sim_twin.diagnosis.subject import Subject

MEASURED = Path(__file__).parents[2].parent / "shared" / "real-data"
"""The measured sets lie beside the project, not in it."""
_SEARCHING, _JUDGING = 400, 60
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

    Alike is what is at least 0.3 times as probable as the likeliest, and what the diagnosis cannot tell from
    it.
    """
    findings = diagnose(subject, measured, Effort(_SEARCHING, _JUDGING), subject.observe, seed)
    shares = {"none": findings.none, "unknown": findings.unknown}
    shares |= {each.cause.name: each.probability for each in findings.judged}
    order = sorted(shares, key=lambda name: -shares[name])
    likely = [name for name in order if shares[name] >= _ALIKE * shares[order[0]]]
    of_first = [each.indistinguishable_from for each in findings.judged if each.cause.name == order[0]]
    alike = tuple(dict.fromkeys([*likely, *(name for names in of_first for name in names)]))
    return Verdict(tuple(cause.name for cause in findings.selected), alike)

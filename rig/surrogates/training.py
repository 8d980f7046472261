"""Trains a surrogate from logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from daq.errors import LogError
from daq.log.reader import LogReader
from rig.twin.recorded_samples import RIG, digest_of, samples_of
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS
from sim_twin.surrogates.samples import Over, Samples
from sim_twin.surrogates.surrogate import Kind, Surrogate, learnt_and_tested

EVERY = 4
"""Of the samples of a log: 6.4 kHz of 25.6 kHz."""
_MOST = 100_000
_UNITS = {"rbf": ("max_units", 100), "grnn": ("max_prototypes", 1000)}
"""What the number of units is called, and how many there are unless it is said."""


def trained(runs: Sequence[Path], kind: Kind, over: Over, units: int | None, seed: int) -> Surrogate:
    """Learn from logs; raises LogError where one of them cannot be learnt from, or is named twice."""
    parts: list[Samples] = []
    digests: dict[str, str] = {}
    for path in runs:
        with LogReader(path) as log:
            digest = digest_of(log)
            if digest in digests.values():
                raise LogError(f"{path}: the same as another that was named; each counts once")
            digests[path.name if path.name not in digests else str(path)] = digest
            parts.append(samples_of(log, EVERY))
    samples = Samples.joined(parts).thinned(_MOST, np.random.default_rng(seed))
    name, most = _UNITS[kind]
    found = learnt_and_tested(samples, RIG, ACCELERATIONS, over, kind, seed, **{name: units or most})
    return replace(found, learnt_from=digests)

"""Trains a surrogate from logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from daq.errors import LogError
from daq.log.reader import LogReader
from rig.twin.recorded_samples import RIG, digest_of, each_once, samples_of
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS
from sim_twin.surrogates.samples import Over, Samples
from sim_twin.surrogates.surrogate import Kind, Surrogate, learnt_and_tested

_MOST = 100_000
UNITS: Final[Mapping[Kind, tuple[str, int]]] = {"rbf": ("max_units", 100), "grnn": ("max_prototypes", 1000)}
"""What the number of units is called, and how many there are unless it is said."""


def trained(
    runs: Sequence[Path],
    kind: Kind,
    over: Over,
    units: int | None = None,
    seed: int = 0,
    error_goal: float | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Surrogate:
    """Learn from samples of logs, drawn at random of too many; `tell` of logs that are passed over.

    `error_goal` is a share of the variance, for the network that adds units until then. Raises LogError where
    a log cannot be learnt from.
    """
    once, random = each_once(runs, tell), np.random.default_rng(seed)
    parts: list[Samples] = []
    digests: dict[str, str] = {}
    for path in once:
        with LogReader(path) as log:
            digests[path.name if path.name not in digests else str(path)] = digest_of(path)
            parts.append(samples_of(log).thinned(_MOST // len(once), random))
    name, most = UNITS[kind]
    given = {name: units or most} | ({} if error_goal is None else {"error_goal": error_goal})
    try:
        found = learnt_and_tested(Samples.joined(parts), RIG, ACCELERATIONS, over, kind, seed, **given)
    except ValueError as error:
        raise LogError(f"nothing can be learnt from {len(once)} logs: {error}") from error
    return replace(found, learnt_from=digests)

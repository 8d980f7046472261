"""Moves the last bits of every motion, as another processor would: pytest -p tests.last_bits, LAST_BITS=seed.

What chaos makes of a last bit shows in tests that stand at an edge. Worker processes are not moved.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

ROUNDING = 3e-16
SEED = int(os.environ.get("LAST_BITS", "1"))


def _moved(values: Any) -> Any:
    """The same for the same shape, so that what is calculated twice stays the same."""
    rng = np.random.default_rng(SEED)
    return values * (1 + ROUNDING * rng.standard_normal(np.shape(values)))


def pytest_report_header() -> str:
    """What a person who reads the output has to know."""
    return f"last bits of every motion moved, seed {SEED}"


def pytest_configure() -> None:
    """Move the rates of the beam's modes and the start of a crank's motion."""
    from sim_twin.lanes import lanes
    from sim_twin.mechanisms import simulation
    from sim_twin.switched import tables

    modes_of, begin = tables.complex_modes, simulation.begin

    def moved_modes(A: Any) -> Any:
        modes = modes_of(A)
        return modes._replace(rates=_moved(modes.rates.real) + 1j * _moved(modes.rates.imag))

    tables.complex_modes = lanes.complex_modes = moved_modes  # type: ignore[assignment]
    simulation.begin = lambda y, contacts: begin(_moved(y), contacts)

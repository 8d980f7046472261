from __future__ import annotations

import pytest

from rig.reproduce.figure import Effort
from rig.reproduce.page import FIGURES, Reproduced, compute_all


@pytest.fixture(scope="session")
def quick_figures() -> list[Reproduced]:
    """All figures, the quick version, computed once."""
    outcomes = compute_all(list(FIGURES), Effort(quick=True), None, lambda done: None)
    return [Reproduced(FIGURES[name], outcome) for name, outcome in outcomes.items()]

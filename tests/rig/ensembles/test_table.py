"""What a person, a program and a spreadsheet get of an ensemble."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import RattleError
from rig.ensembles import as_json, failure_lines, write_runs
from sim_twin.ensembles.figures import spread_of
from sim_twin.ensembles.simulate import Outcome
from sim_twin.rigs.rig_model import RunFigures
from sim_twin.status import Status

OUTCOMES: list[Outcome[RunFigures]] = [
    Outcome(Status.COMPLETED, RunFigures(Status.COMPLETED, {"peak_n": 20.0, "cycles": 4, "late_n": None})),
    Outcome(Status.STEPS_EXHAUSTED),
    Outcome(Status.COMPLETED, RunFigures(Status.COMPLETED, {"peak_n": 0.1, "cycles": 6, "late_n": None})),
    Outcome(Status.DIVERGED),
]


def test_a_spread_is_over_the_runs_that_have_the_figure() -> None:
    spreads = spread_of(OUTCOMES)
    assert set(spreads) == {"peak_n", "cycles"}
    cycles = spreads["cycles"]
    # linear between the two values
    assert (cycles.runs, cycles.mean, cycles.median) == (2, 5.0, 5.0)
    assert (cycles.p5, cycles.p95) == pytest.approx((4.1, 5.9))
    assert cycles.deviation == pytest.approx(2**0.5)
    assert spread_of(OUTCOMES[:1])["cycles"].deviation is None


def test_failures_are_counted_with_advice() -> None:
    assert [line.split(":")[0] for line in failure_lines(OUTCOMES)] == [
        "1 of 4 runs steps exhausted",
        "1 of 4 runs diverged",
    ]
    assert as_json(OUTCOMES, 1)["failed"] == {"steps_exhausted": 1, "diverged": 1}


def test_a_failed_run_keeps_its_row_with_empty_figures(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    write_runs(OUTCOMES, path)
    assert path.read_text().splitlines() == [
        "run,status,peak_n,cycles,late_n",
        "0,completed,20.0,4,",
        "1,steps_exhausted,,,",
        "2,completed,0.1,6,",
        "3,diverged,,,",
    ]
    with pytest.raises(RattleError, match="cannot be written"):
        write_runs(OUTCOMES, tmp_path / "nowhere" / "runs.csv")

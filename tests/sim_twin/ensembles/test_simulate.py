"""The order of results, what is with the executor at a time, and what a failure does to the others."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from daq.errors import SimulationFailed
from rig.ensembles import worker_processes
from sim_twin.ensembles.figures import Figures
from sim_twin.ensembles.simulate import Outcome, Variant, simulate
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.base.model import flexible_base
from sim_twin.rigs.impact_beam.base.standing import standing_on
from sim_twin.rigs.impact_beam.structure import _structure_of
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.status import Status
from sim_twin.twin import Twin
from tests.sim_twin.ensembles.stand_ins import BEAM, LastFirst, OnlyTheFirst, Phases, numbered

COUNT = 24  # six pieces of four


def test_results_come_in_the_order_of_the_variants_whoever_finishes_first() -> None:
    alone = simulate(numbered(COUNT), Phases())
    assert [outcome.value for outcome in alone] == list(range(COUNT))
    assert simulate(numbered(COUNT), Phases(), LastFirst(3), in_flight=3) == alone
    with ThreadPoolExecutor(3) as threads:
        assert simulate(numbered(COUNT), Phases(), threads) == alone


def test_pieces_depend_on_the_list_alone_and_hold_one_rig_each() -> None:
    crank = Twin(PlanarSliderCrank(), SpeedDrive(20.0))
    mixed = [*numbered(6), *(Variant(crank) for _ in range(5)), *numbered(1)]
    alone, spread = Phases(), Phases()
    simulate(mixed, alone)
    simulate(mixed, spread, LastFirst(1), in_flight=1)
    assert alone.pieces == spread.pieces == [4, 2, 4, 1, 1]


def test_no_more_than_in_flight_is_with_the_executor() -> None:
    executor = LastFirst(2)  # refuses a third
    simulate(numbered(COUNT), Phases(), executor, in_flight=2)
    assert len(executor.submitted) == 6


def test_an_empty_list_is_an_empty_ensemble() -> None:
    assert simulate([], Phases(), OnlyTheFirst()) == ()


@pytest.mark.parametrize("executor", [None, LastFirst(2)])
def test_progress_counts_runs_up_to_all(executor: LastFirst | None) -> None:
    seen: list[tuple[int, int]] = []
    simulate(numbered(COUNT), Phases(), executor, lambda done, every: seen.append((done, every)), 2)
    assert seen == [(done, COUNT) for done in range(4, COUNT + 1, 4)]


@pytest.mark.parametrize(
    "error", [SimulationFailed("it stopped", "try less"), np.linalg.LinAlgError("singular"), OverflowError()]
)
def test_a_run_that_cannot_be_computed_takes_no_other_along(error: Exception) -> None:
    outcomes = simulate(numbered(8), Phases(fails=lambda variant: error if variant.phase == 5 else None))
    expected: list[Outcome[float]] = [Outcome(Status.COMPLETED, float(number)) for number in range(8)]
    expected[5] = Outcome(Status.DIVERGED)
    assert list(outcomes) == expected


def test_a_run_s_own_status_is_kept_whatever_it_advises() -> None:
    error = SimulationFailed("it stopped", "try less", Status.STEPS_EXHAUSTED)
    (outcome,) = simulate(numbered(1), Phases(fails=lambda _: error))
    assert outcome == Outcome(Status.STEPS_EXHAUSTED)


def test_a_division_by_zero_is_a_fault_of_the_program() -> None:
    with pytest.raises(ZeroDivisionError, match="a fault"):
        simulate(numbered(1), Phases(fails=lambda _: ZeroDivisionError("a fault")))


def test_a_worker_process_gives_the_bits_of_this_one() -> None:
    """Threads of linear algebra in one of them would change last bits of a flexible base's modes."""
    _structure_of.cache_clear()
    standing_on.cache_clear()
    standing_on(flexible_base())  # as another test leaves it behind
    flexible = replace(BEAM, rig=replace(BEAM.rig, base=flexible_base()))
    wanted = Figures(0.0, 0.1)
    here = simulate([Variant(flexible)], wanted)[0].value
    with worker_processes(1) as workers:
        there = simulate([Variant(flexible)], wanted, workers.executor)[0].value
    assert here is not None
    assert there is not None
    assert here.values == there.values
    assert all(np.array_equal(here.series[name], there.series[name]) for name in here.series)


def test_a_fault_of_the_program_is_raised_and_cancels_what_waits() -> None:
    executor = OnlyTheFirst()
    with pytest.raises(TypeError, match="a fault"):
        simulate(numbered(COUNT), Phases(fails=lambda _: TypeError("a fault")), executor)
    assert [future.cancelled() for future in executor.submitted] == [False] + 5 * [True]


def test_whoever_looks_at_the_progress_can_stop_it() -> None:
    def stop(done: int, every: int) -> None:
        raise KeyboardInterrupt

    executor = OnlyTheFirst()
    with pytest.raises(KeyboardInterrupt, match=r"^$"):
        simulate(numbered(COUNT), Phases(), executor, stop)
    assert all(future.cancelled() for future in executor.submitted[1:])

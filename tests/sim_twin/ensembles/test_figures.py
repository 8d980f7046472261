"""Figures of many runs are those of each run alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.signals.impacts import half_cycles
from sim_twin.ensembles.figures import Figures
from sim_twin.ensembles.population import Population
from sim_twin.ensembles.simulate import Variant, simulate
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.lanes import beam_lanes
from sim_twin.rigs.impact_beam.model import SineDrive
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.rig import MODEL as CRANK_MODEL
from sim_twin.rigs.rig_model import RunFigures
from sim_twin.sensors import OVERSAMPLED_RATE
from sim_twin.status import Status
from sim_twin.twin import Twin
from tests.sim_twin.ensembles.stand_ins import BEAM, Beyond

SETTLE, DURATION = 0.05, 0.3
HEALTHY = Population(BEAM, any_phase=False).variants(19, 11)  # more than one piece of work


def observed(variant: Variant) -> RunFigures:
    (outcome,) = simulate([variant], Figures(SETTLE, DURATION))
    assert outcome.value is not None
    return outcome.value


def test_first_contacts_are_those_of_the_exact_solver() -> None:
    outcomes = simulate(HEALTHY, Figures(0.0, 0.02))
    for variant, outcome in zip(HEALTHY, outcomes, strict=True):
        exact = MODEL.solver_values(variant.twin, 0.0, 0.02)
        assert outcome.value is not None
        # the accuracy that the fixed step of the lanes is made for
        assert outcome.value.values["first_peak_n"] == pytest.approx(exact["first_peak_n"], rel=5e-3)
        half_a_step = 0.5 / OVERSAMPLED_RATE
        seconds = outcome.value.values["first_contact_s"]
        # the predicted force of a step begins up to half a step early
        assert seconds == pytest.approx(exact["first_contact_s"], abs=2 * half_a_step)


def test_half_cycles_are_those_of_the_whole_trace() -> None:
    """The peaks alone give, bit for bit, what all samples give; the window begins after `settle`."""
    lanes = beam_lanes([HEALTHY[0].twin], OVERSAMPLED_RATE)
    force = lanes.advance(round((SETTLE + DURATION) * OVERSAMPLED_RATE))[0, 0]
    force = force[round(SETTLE * OVERSAMPLED_RATE) :]
    cycles = half_cycles(np.maximum(force, 0), np.maximum(-force, 0), OVERSAMPLED_RATE)
    figures = observed(HEALTHY[0])
    assert len(cycles) > 10
    assert np.array_equal(figures.series["first_n"], cycles.first_n)
    assert np.array_equal(figures.series["max_n"], cycles.max_n)
    assert figures.values["half_cycles"] == len(cycles)
    assert figures.values["max_sd_n"] == np.std(cycles.max_n, ddof=1)


def test_a_run_has_the_same_bits_in_any_company() -> None:
    together = simulate(HEALTHY, Figures(SETTLE, DURATION))
    for number in (0, 7, 18):
        alone = observed(HEALTHY[number])
        assert together[number].value == replace(alone, series=together[number].value.series)  # type: ignore[union-attr]
        assert np.array_equal(together[number].value.series["max_n"], alone.series["max_n"])  # type: ignore[union-attr]


def test_half_a_cycle_later_the_beam_does_the_same_mirrored() -> None:
    outcomes = simulate([Variant(BEAM), Variant(BEAM, np.pi), Variant(BEAM, 0.3)], Figures(0.0, 0.02))
    peaks = [outcome.value.values["first_peak_n"] for outcome in outcomes if outcome.value]
    # sin(pi) is not quite 0
    assert peaks[1] == pytest.approx(peaks[0], rel=1e-9)
    assert peaks[2] != pytest.approx(peaks[0], rel=1e-2)


def test_a_rig_that_touches_nothing_has_no_peaks() -> None:
    figures = observed(Variant(replace(BEAM, drive=SineDrive(1e-6, 20.0))))
    assert {name for name, value in figures.values.items() if value is None} == {
        "first_peak_n", "first_contact_s", "first_mean_n", "first_sd_n", "max_mean_n", "max_sd_n",
    }  # fmt: skip
    assert figures.values["half_cycles"] == 0


def test_a_run_that_diverges_is_marked_and_takes_no_other_along() -> None:
    beyond = replace(BEAM, drive=Beyond(9.0, 20.0))
    outcomes = simulate([Variant(BEAM), Variant(beyond), Variant(BEAM)], Figures(0.0, 0.02))
    assert [outcome.status for outcome in outcomes] == [
        Status.COMPLETED,
        Status.DIVERGED,
        Status.COMPLETED,
    ]
    assert outcomes[1].value is None
    assert outcomes[0].value is not None
    assert outcomes[0].value.values == outcomes[2].value.values  # type: ignore[union-attr]


def test_a_rig_without_lanes_is_run_one_by_one() -> None:
    crank = Twin(PlanarSliderCrank(), SpeedDrive(20.0))
    (outcome,) = simulate([Variant(crank)], Figures(0.0, 0.05))
    assert outcome.value is not None
    assert outcome.value.values == CRANK_MODEL.solver_values(crank, 0.0, 0.05)
    with pytest.raises(ValueError, match=r"planar_slider_crank start at phase 0, not 1 rad"):
        simulate([Variant(crank, 1.0)], Figures(0.0, 0.05))


def test_a_run_alone_that_takes_too_many_steps_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_twin.rigs.planar_slider_crank.solver_values._BUDGET_A_SECOND", 10)
    crank = Variant(Twin(PlanarSliderCrank(), SpeedDrive(20.0)))
    (outcome,) = simulate([crank], Figures(0.0, 0.05))
    assert (outcome.status, outcome.value) == (Status.STEPS_EXHAUSTED, None)

"""Clean samples of many runs are what the instruments of each show, noise and chains apart."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from sim_twin.ensembles.clean_samples import _taps, clean_samples
from sim_twin.ensembles.simulate import Variant
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.impact_beam.rig import MODEL as BEAM_MODEL
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.rig import MODEL as CRANK_MODEL
from sim_twin.rigs.rig_model import RigModel
from sim_twin.sensors import Encoder, SensorChain
from sim_twin.twin import Twin
from tests.sim_twin.ensembles.stand_ins import BEAM, Beyond

Array = NDArray[np.float64]
RATE = 25_600.0
FINEST = 8
CRANK = Twin(PlanarSliderCrank(), SpeedDrive(20.0), {"crank.angle": Encoder()})


def clean(variants: list[Variant], settle: float, count: int, oversampling: int = FINEST) -> list[Array]:
    found = clean_samples(variants, RATE, settle, count, oversampling)
    return [rows for rows in found if rows is not None]


def by_instruments(model: RigModel, variant: Variant, count: int) -> Array:
    """The exact solver through ideal chains, without noise."""
    twin = replace(variant.twin, sensors={})
    stream = model.stream(twin, RATE)
    stream.drive(twin.drive, variant.phase)
    return stream.advance(count)


def test_first_impacts_of_the_beam_are_those_of_the_exact_solver() -> None:
    phase = 0.2
    (rows,) = clean([Variant(BEAM, phase)], 0.0, 125)  # 4.9 ms: the first impact
    exact = by_instruments(BEAM_MODEL, Variant(BEAM, phase), 125)
    assert rows.shape == exact.shape == (5, 125)
    # instruments ring where the drive begins; later their filters pass 9 N to 2e-4
    assert rows[0, 40:] == pytest.approx(exact[0, 40:], abs=2e-3)
    peak = exact[1].max()
    assert peak > 20
    # half a step of 4.9 us in the time of an impact that lasts some 200 us
    assert rows[1] == pytest.approx(exact[1], abs=0.02 * peak)
    assert rows[3] == pytest.approx(exact[3], abs=0.02 * peak)


def test_accelerations_are_in_their_rows() -> None:
    effect = {"frequency_hz": 400.0, "mass_kg": 1.0, "damping_ratio": 0.02}
    softer = BEAM_MODEL.with_effects(BEAM, [("base_flexibility", effect)])
    variant = Variant(replace(softer, rig=replace(softer.rig, stations=(50,))))
    (rows,) = clean([variant], 0.0, 128)
    exact = by_instruments(BEAM_MODEL, variant, 128)
    for row, expected in zip(rows[4:], exact[4:], strict=True):
        # as above; the beam's high modes shift by half a step each
        assert row == pytest.approx(expected, abs=0.05 * np.abs(expected).max())


def test_the_crank_before_its_motions_part_is_that_of_the_exact_solver() -> None:
    count = 1500  # 59 ms, a tenth of a second is the horizon
    start = 2 * np.pi - 0.3  # so that a mark comes in time
    (rows,) = clean([Variant(CRANK, start)], 0.0, count)
    exact = by_instruments(CRANK_MODEL, Variant(CRANK, start), count)
    for name, row, shown in zip(CRANK.channels, rows, exact, strict=True):
        if name == "crank.angle":
            assert row == pytest.approx(start + 20.0 * np.arange(count) / RATE, abs=1e-9)
            continue
        # both stop bands are 80 dB down, but their edges between 0.45 and 0.55 of the rate differ a little,
        # and impacts and marks have something there
        below = np.fft.rfft((row - shown) * np.hanning(count))
        size = np.fft.rfft(shown * np.hanning(count))
        passed = slice(0, int(0.42 * count))
        assert np.linalg.norm(below[passed]) < 0.01 * np.linalg.norm(size[passed]), name


@pytest.mark.parametrize("oversampling", [2, 4])
def test_a_coarser_truth_is_the_same_below_0_42_of_the_rate(oversampling: int) -> None:
    count = 1500
    (fine,) = clean([Variant(CRANK, 0.4)], 0.0, count)
    (coarse,) = clean([Variant(CRANK, 0.4)], 0.0, count, oversampling)
    passed = slice(0, int(0.42 * count))
    for name, one, other in zip(CRANK.channels[:3], fine[:3], coarse[:3], strict=True):
        apart = np.fft.rfft((one - other) * np.hanning(count))[passed]
        # frame modes at 310 Hz and below hold all but the sharp edges of impacts
        assert np.linalg.norm(apart) < 0.01 * np.linalg.norm(np.fft.rfft(one * np.hanning(count))), name


def test_the_window_comes_after_settle_in_any_company() -> None:
    runs = [Variant(BEAM, phase) for phase in (0.0, 1.0, 2.0)]
    whole = clean(runs, 0.0, 3000)
    (late,) = clean(runs[1:2], 2000 / RATE, 1000)
    # longer than one part that is computed at once, so nothing is lost between parts
    assert np.array_equal(late, whole[1][:, 2000:])


def test_chains_and_noise_are_left_for_later() -> None:
    marked = replace(
        BEAM,
        sensors={**BEAM.sensors, "yoke.force": SensorChain(noise=1.0, gain=2.0, skew=1e-3)},
    )
    assert np.array_equal(clean([Variant(marked)], 0.0, 500)[0], clean([Variant(BEAM)], 0.0, 500)[0])


def test_an_encoder_is_not_counted_and_not_delayed() -> None:
    angle = clean([Variant(CRANK, 0.4)], 0.02, 300)[0][CRANK.channels.index("crank.angle")]
    assert angle == pytest.approx(0.4 + 20.0 * (0.02 + np.arange(300) / RATE), abs=1e-9)


def test_a_run_that_fails_is_none_and_takes_no_other_along() -> None:
    beyond: Twin[Any, Any] = replace(BEAM, drive=Beyond(9.0, 20.0))
    sound, failed = clean_samples([Variant(BEAM), Variant(beyond)], RATE, 0.0, 1300, FINEST)
    assert failed is None
    assert sound is not None
    assert np.array_equal(sound, clean([Variant(BEAM)], 0.0, 1300)[0])


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_the_first_stage_is_the_window_design_of_scipy(factor: int) -> None:
    """Flat to 0.45 of the rate that is left, 80 dB down from where it would fall onto that."""
    edge = 0.55 / 2 / factor
    count, beta = signal.kaiserord(80.0, 2 * (1 / factor - 2 * edge))
    wanted = signal.firwin(count | 1, 0.5 / factor, window=("kaiser", beta), fs=1.0)
    assert _taps(factor) == pytest.approx(wanted, abs=1e-15)

"""A twin's samples as they come: independent of how they are asked for, and of how long they last."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import MODEL, nominal_sensors
from sim_twin.twin import Twin
from tests.sim_twin.solver import driven, solve

SAMPLE_RATE = 51_200.0
SINE = SineDrive(9.0, 20.0)
STEEL = nominal()
TWIN = Twin(STEEL, SINE)


def samples(chunks: list[int], rng: np.random.Generator | None = None, twin: Twin = TWIN) -> np.ndarray:
    stream = MODEL.stream(twin, SAMPLE_RATE, rng)
    stream.drive(SINE)
    stream.drive(SineDrive(7.0, 23.0), 1.0, at_sample=333.4)
    return np.hstack([stream.advance(count) for count in chunks])


@pytest.mark.parametrize("chunks", [[1] * 100 + [924], [333, 1, 690], [7] * 146 + [2]])
def test_the_size_of_the_chunks_changes_nothing(chunks: list[int]) -> None:
    whole = samples([1024])
    assert whole[1:3].max() > 25.0
    # 20 ms are before chaos acts; each chunk passes through the state and costs 1e-15 of it.
    assert samples(chunks) == pytest.approx(whole, abs=1e-9 * np.abs(whole).max())


def test_with_noise_the_order_of_the_draws_is_that_of_the_chunks_and_repeats() -> None:
    twin = replace(TWIN, sensors=nominal_sensors(STEEL))
    first, second = (samples([512, 512], np.random.default_rng(3), twin) for _ in range(2))
    assert np.array_equal(first, second)
    clean = samples([1024])
    assert np.std(first[1] - clean[1]) == pytest.approx(0.05, rel=0.1)  # 1,024 draws: 2.2 % at one sigma


def test_a_drive_that_is_set_again_as_it_is_does_not_change_the_motion() -> None:
    plain, reset = (driven(STEEL, SINE) for _ in range(2))
    plain.advance(1000)
    reset.advance(1000)
    reset.drive(SINE.phasors(), 2 * np.pi * 20.0, 0.0, reference=0.0)
    assert reset.advance(1500).outputs == pytest.approx(plain.advance(1500).outputs, abs=1e-9)


def test_a_drive_may_change_its_frequency_without_a_jump_of_the_state() -> None:
    simulation = driven(STEEL, SINE)
    simulation.advance(500)
    before = simulation.state
    simulation.drive(SineDrive(9.0, 50.0).phasors(), 2 * np.pi * 50.0)
    simulation.advance(0)
    assert simulation.state == pytest.approx(before, rel=1e-9, abs=1e-12 * np.abs(before).max())


def test_a_stream_shows_the_solver_s_force() -> None:
    stream = MODEL.stream(TWIN, SAMPLE_RATE)
    stream.drive(SINE)
    shown = stream.advance(1024)
    solved = solve(STEEL, SINE, 0.02).outputs
    # The filter keeps impulses: their sum differs by its ripple, 80 dB down, at the record's end only.
    assert shown[1].sum() == pytest.approx(solved[0].sum() / 4, rel=1e-3)
    exact = 9.0 * np.sin(2 * np.pi * 20.0 * np.arange(1024) / SAMPLE_RATE)
    # The filter rounds the corner where the drive sets in, by a share of the 0.02 N of one sample's rise.
    assert shown[0] == pytest.approx(exact, abs=3e-3)


def test_yoke_is_the_difference_of_the_forces_through_its_mode() -> None:
    stream = MODEL.stream(TWIN, SAMPLE_RATE)
    stream.drive(SineDrive(9.0, 20.0))
    _, upper, lower, yoke, *_ = stream.advance(25_600)
    frequency = np.fft.rfftfreq(25_600, 1 / SAMPLE_RATE)
    window = np.hanning(25_600)
    ratio = np.fft.rfft(window * yoke) / np.fft.rfft(window * (upper - lower))
    exact = 1 / (1 - (frequency / 700) ** 2 + 2j * 0.03 * frequency / 700)
    strong = (frequency > 10) & (frequency < 3000) & (np.abs(np.fft.rfft(window * (upper - lower))) > 500)
    assert strong.sum() > 100
    # The window smears the resonance over its three lines of 2 Hz, against a width of 42 Hz.
    assert np.median(np.abs(ratio[strong] / exact[strong] - 1)) < 0.01


def test_a_pure_sine_stream_refuses_harmonics() -> None:
    stream = MODEL.stream(TWIN, SAMPLE_RATE)
    stream.drive(replace(SINE, second=0.1))
    with pytest.raises(ValueError, match="set up for a pure sine"):
        stream.advance(1)


def test_accelerometers_on_the_beam_show_its_deflection_differentiated_twice() -> None:
    trace = solve(replace(STEEL, clearance=1.0, stations=(50, 100)), SineDrive(9.0, 20.0), 1.0)
    _, _, _, middle, tip = trace.outputs[:, -20_480:]
    # Without contact and below the modes the beam turns as a rigid body: twice as far out, twice as much.
    assert np.abs(tip).max() > 10.0
    assert np.std(tip) == pytest.approx(2 * np.std(middle), rel=0.02)


@pytest.mark.parametrize("drive", [SineDrive(0.0, 20.0), SineDrive(1e-3, 20.0)])
def test_minutes_without_any_contact_cost_no_more_than_seconds_with(drive: SineDrive) -> None:
    simulation = driven(replace(STEEL, clearance=1.0), drive, orders=(1,))
    simulation.advance(1)
    begin = time.process_time()
    for _ in range(60):
        assert simulation.advance(2 * 204_800).switches == 0
    # Free motion runs at some 2,000 times real time; denormal numbers would make it a hundred times slower.
    assert time.process_time() - begin < 10.0
    assert np.isfinite(simulation.state).all()


def test_stopping_the_drive_lets_the_motion_die_without_slowing_down() -> None:
    simulation = driven(nominal(modal_damping=0.05), SINE, orders=(1,))
    simulation.advance(20_480)
    simulation.drive(np.zeros(1, complex), 2 * np.pi * 20.0)
    begin = time.process_time()
    for _ in range(60):
        simulation.advance(204_800)
    assert time.process_time() - begin < 10.0
    assert np.abs(simulation.state).max() < 1e-9

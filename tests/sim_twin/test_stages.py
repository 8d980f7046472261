"""Declared stages of a chain, against scipy.signal and against each other."""

from __future__ import annotations

from math import inf, pi

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from drivers.ni_daq.channels import CardChannel, Pulses
from drivers.ni_daq.emulator.converter import AngleCount
from drivers.ni_daq.emulator.wiring import CounterWire
from drivers.ni_daq.sensors import known_sensor
from sim_twin.diagnosis.campaign import through_chains
from sim_twin.sensors import Encoder, SensorChain, SensorStream, oversampling
from sim_twin.stages import Section, Stages, StageStream

RATE = 25_600.0
FINE = RATE * oversampling(RATE)
FREQUENCIES = np.array([0.3, 2.0, 40.0, 700.0, 3000.0, 9000.0])
QUIET = np.random.default_rng(1)
Array = NDArray[np.float64]


@pytest.mark.parametrize("order", [1, 2, 5, 8])
def test_a_low_pass_is_the_butterworth_of_scipy(order: int) -> None:
    stages = Stages(low_pass=(1500.0, order))
    b, a = signal.butter(order, 2 * pi * 1500.0, analog=True)
    _, wanted = signal.freqs(b, a, 2 * pi * FREQUENCIES)
    assert [stages.response(each) for each in FREQUENCIES] == pytest.approx(wanted, rel=1e-9)
    blow = np.zeros(4096)
    blow[7] = 1.0
    sections = signal.butter(order, 1500.0, fs=FINE, output="sos")
    shown = StageStream(stages, FINE, inf)(blow)
    assert shown == pytest.approx(signal.sosfilt(sections, blow), abs=1e-12)


def test_a_high_pass_is_the_butterworth_of_scipy() -> None:
    stages = Stages(high_passes=(5.0,))
    _, wanted = signal.freqs(*signal.butter(1, 2 * pi * 5.0, "highpass", analog=True), 2 * pi * FREQUENCIES)
    assert [stages.response(each) for each in FREQUENCIES] == pytest.approx(wanted, rel=1e-9)
    step = np.ones(4096)
    wanted_step = signal.lfilter(*signal.butter(1, 5.0, "highpass", fs=FINE), step)
    assert StageStream(stages, FINE, inf)(step) == pytest.approx(wanted_step, abs=1e-9)


@pytest.mark.parametrize("damping", [0.02, 0.1])
def test_a_sensor_rings_as_its_damping_lets_it(damping: float) -> None:
    stages = Stages(resonance=(3000.0, damping))
    assert abs(stages.response(3000.0)) == pytest.approx(1 / (2 * damping))
    assert abs(settled(SensorChain(stages=stages), 3000.0)) == pytest.approx(1 / (2 * damping), rel=0.02)


def test_the_delay_is_that_of_slow_signals() -> None:
    stages = Stages(low_pass=(1000.0, 5), late=2e-4, resonance=(9000.0, 0.02))
    assert stages.delay == pytest.approx(-np.angle(stages.response(0.5)) / pi, rel=1e-5)
    assert Section(10.0, high=True).delay == 0.0


def settled(chain: SensorChain, frequency: float) -> complex:
    """What the chain in motion makes of a sine, once it has settled; by whole periods."""
    seconds, fine = 1.0, np.arange(round(2.5 * FINE)) / FINE
    stream = SensorStream(chain, RATE, None)
    stream.push(np.sin(2 * pi * frequency * fine))
    shown = stream.pull(round(2.0 * RATE))
    times = np.arange(len(shown)) / RATE
    last = times >= seconds
    return complex(2j * np.mean(shown[last] * np.exp(-2j * pi * frequency * times[last])))


@pytest.mark.parametrize(
    "stages",
    [
        Stages(high_passes=(3.0, 0.7)),
        Stages(low_pass=(2000.0, 6)),
        Stages(resonance=(30_000.0, 0.02)),
        Stages(late=1.3e-3),
        Stages(high_passes=(8.0,), low_pass=(9000.0, 4), late=4e-4),
    ],
)
def test_a_chain_in_motion_makes_of_a_sine_what_its_stages_say(stages: Stages) -> None:
    for frequency in (20.0, 1000.0, 8000.0):
        shown = settled(SensorChain(stages=stages), frequency)
        assert shown == pytest.approx(stages.response(frequency), abs=0.008)


def test_by_frequency_and_over_time_are_the_same_chain() -> None:
    chain = SensorChain(stages=Stages(high_passes=(4.0,), low_pass=(1200.0, 4), output=0.8, late=5e-4))
    fine = np.arange(round(4.0 * FINE)) / FINE
    # loud now and then, so that the amplifier's output is reached
    truth = np.sin(2 * pi * 20.0 * fine) * (1 + 0.5 * np.sin(2 * pi * fine)) + 0.1 * np.sin(
        2 * pi * 900 * fine
    )
    stream = SensorStream(chain, RATE, None)
    stream.push(truth)
    inner = slice(round(1.5 * RATE), round(2.5 * RATE))
    moving = stream.pull(round(3.0 * RATE))[inner]
    (standing,) = through_chains(truth[None, :: oversampling(RATE)], [chain], RATE, 1.0, QUIET)
    assert np.abs(moving).max() > 0.8
    assert standing[inner] == pytest.approx(moving, abs=0.01)


def test_a_sensors_noise_goes_through_what_is_behind_it() -> None:
    chain = SensorChain(noise=1.0, stages=Stages(low_pass=(RATE / 20, 8)))
    (shown,) = through_chains(np.zeros((1, 65_536)), [chain], RATE, 1.0, np.random.default_rng(2))
    assert np.std(shown) == pytest.approx(np.sqrt(0.1), rel=0.05)


def test_an_input_takes_no_more_than_it_does() -> None:
    truth = 3.0 * np.sin(2 * pi * 50.0 * np.arange(round(0.2 * FINE)) / FINE)
    stream = SensorStream(SensorChain(limit=2.0), RATE, None)
    stream.push(truth)
    assert np.abs(stream.pull(2560)).max() == 2.0
    (shown,) = through_chains(truth[None, ::8], [SensorChain(limit=2.0)], RATE, 1.0, QUIET)
    assert np.abs(shown).max() == pytest.approx(2.0)


def test_what_nobody_declares_costs_no_bit() -> None:
    fine, rng = np.random.default_rng(3).standard_normal(30_000), np.random.default_rng(4)
    plain, none = (SensorStream(each, RATE, None) for each in (SensorChain(), SensorChain(limit=inf)))
    plain.push(fine)
    none.push(fine)
    assert np.array_equal(plain.pull(2000), none.pull(2000))
    shown = through_chains(fine[None, :], [SensorChain(limit=1e9)], RATE, 1.0, rng)[0]
    assert np.array_equal(
        shown, through_chains(fine[None, :], [SensorChain()], RATE, 1.0, np.random.default_rng(4))[0]
    )


def test_an_encoder_that_counts_backwards_shows_the_next_count() -> None:
    angles = np.array([0.0, 0.1, 3.0, 6.2])
    count = 2 * pi / 500
    ahead, behind = Encoder(500, backwards=True).shown(angles), Encoder(500).shown(angles)
    assert (ahead >= angles).all()
    assert (behind <= angles).all()
    assert ahead - behind == pytest.approx([0.0, count, count, count])


@pytest.mark.parametrize("backwards", [False, True])
def test_an_encoder_shows_what_the_cards_counter_makes_of_it(backwards: bool) -> None:
    angles = 0.3 + 25.0 * np.arange(8000) / RATE + 1e-4
    pulses = Pulses(900, 2, index=True, initial_angle=2.0, backwards=backwards)
    count = round(pulses.counted_from / pulses.rad_per_count)
    channel = CardChannel("crank.angle", "cDAQ1Mod3/ctr0", "encoder", pulses=pulses, unit="rad")
    counter = AngleCount(CounterWire("", 900, backwards=backwards, index_at=2.0), 2, count, count)
    read = known_sensor(channel).decoder(channel)(counter(angles))
    shown = Encoder(1800, backwards, 2.0).shown(angles)
    after = angles > 2.0 + 1e-3  # before the first mark the counter knows nothing
    turns = np.round((read - shown)[after] / (2 * pi))
    assert (read - shown)[after] == pytest.approx(2 * pi * turns, abs=1e-9)
    assert np.ptp(turns) == 0.0

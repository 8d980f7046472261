"""The stages of a measuring chain: charge amplifier and anti-alias filter, and what the samples tell."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from nidaqmx.errors import DaqError
from numpy.typing import NDArray
from scipy import signal

from daq.block import Flag
from daq.quantity import Samples
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.channels import Amplifier, AntiAliasFilter, CardChannel, CardSettings, Mark
from drivers.ni_daq.emulator.wiring import (
    CardWiring,
    ChargeStage,
    LowPassStage,
    MarkStage,
    ResonanceStage,
    Wire,
)
from drivers.ni_daq.quality import QualityWatch
from drivers.protocols.card import CardReading, Finding
from tests.drivers.in_process import RowsPlant, opened

RATE = 25600.0
LSB_V = 5.0 / 2**23
# 4 pC/N into 6 mV/pC: 24 mV/N, and 4.8 V at 200 N
FORCE = CardChannel("force", "cDAQ1Mod1/ai0", "charge_amplifier", 4e-12, 200.0, gain=6e9, unit="N")
TRUE = 0.024


def read(force: NDArray[np.float64], wire: Wire, channel: CardChannel, blocks: int = 10) -> list[CardReading]:
    with opened(RowsPlant({"force": force}), CardWiring({"cDAQ1Mod1/ai0": wire}), channel) as card:
        return [card.read(2560) for _ in range(blocks)]


def values_of(readings: list[CardReading]) -> NDArray[np.float64]:
    return np.concatenate([reading.values[0] for reading in readings])


def sine(frequency_hz: float, amplitude: float) -> NDArray[np.float64]:
    return amplitude * np.sin(math.tau * frequency_hz * np.arange(int(RATE)) / RATE)


def test_an_amplifier_droops_with_its_corner() -> None:
    values = values_of(read(np.full(25600, 100.0), Wire("force", TRUE, charge=ChargeStage(2.0)), FORCE))
    time_s = np.arange(25600) / RATE
    # Sampled, the step may come anywhere within a sample: what decays in that time.
    assert values == pytest.approx(
        100.0 * np.exp(-math.tau * 2.0 * time_s), abs=100.0 * math.tau * 2.0 / RATE
    )


@pytest.mark.parametrize("gain", [3e9, 12e9, 25e9])
def test_a_wrong_gain_in_the_bench_shows_as_a_wrong_force(gain: float) -> None:
    wrong = replace(FORCE, gain=gain, range=40.0)
    values = values_of(read(sine(20.0, 30.0), Wire("force", TRUE, charge=ChargeStage()), wrong))
    assert values == pytest.approx(sine(20.0, 30.0) * 6e9 / gain, abs=LSB_V / wrong.volts_per_unit)


def test_an_amplifier_that_saturates_below_the_cards_range_is_overloaded() -> None:
    # Set ten times too high, it stops at 2.5 V, which the card takes without a word of its own.
    stage = Amplifier("CA-7", output_v=2.5)
    low = read(
        sine(20.0, 50.0),
        Wire("force", TRUE, charge=ChargeStage(output_v=2.5)),
        replace(FORCE, amplifier=stage),
    )
    high = read(
        sine(20.0, 50.0),
        Wire("force", 10 * TRUE, charge=ChargeStage(output_v=2.5)),
        replace(FORCE, amplifier=stage),
    )
    assert {reading.flags for reading in low} == {(Flag.GOOD,)}
    assert {reading.flags for reading in high} == {(Flag.OVERLOAD,)}
    assert np.abs(values_of(high)).max() == pytest.approx(2.5 / TRUE, abs=LSB_V / TRUE)


def test_an_amplifier_in_reset_is_stuck_and_told_once() -> None:
    readings = read(sine(20.0, 50.0), Wire("force", TRUE, charge=ChargeStage(reset=True)), FORCE)
    assert [len(reading.findings) for reading in readings] == [1] + [0] * 9
    finding = readings[0].findings[0]
    assert (finding.channel, finding.code) == ("force", "stuck")
    assert "the same value, 0 N" in finding.text


@pytest.mark.parametrize(("frequency_hz", "order"), [(1000.0, 8), (4000.0, 8), (4000.0, 2)])
def test_the_filter_passes_and_stops_as_a_butterworth(frequency_hz: float, order: int) -> None:
    wire = Wire("force", TRUE, low_pass=LowPassStage(2000.0, order))
    values = values_of(read(sine(frequency_hz, 100.0), wire, FORCE))[5120:]
    # An analog Butterworth whose impulse response is sampled: what lies beyond half the rate folds onto it.
    analog = signal.butter(order, math.tau * 2000.0, analog=True)
    folded = frequency_hz + RATE * np.arange(-200, 201)
    shown, still = (
        signal.freqs(*analog, math.tau * each)[1].sum() for each in (folded, folded - frequency_hz)
    )
    assert np.sqrt(2.0) * values.std() == pytest.approx(
        100.0 * abs(shown / still), rel=1e-3, abs=LSB_V / TRUE
    )


def test_a_filter_above_half_the_rate_does_nothing() -> None:
    wire = Wire("force", TRUE, low_pass=LowPassStage(20000.0))
    assert values_of(read(sine(500.0, 100.0), wire, FORCE)) == pytest.approx(
        sine(500.0, 100.0), abs=LSB_V / TRUE
    )


def test_stages_stand_in_the_log_with_their_serial_numbers() -> None:
    channel = replace(
        FORCE, serial="SN2", amplifier=Amplifier("CA-7", 0.16, 10.0), anti_alias=AntiAliasFilter("AF-3", 10e3)
    )
    described = (
        NiDaqCard(CardSettings(sample_rate_hz=RATE, buffer_s=1.0, channels=(channel,))).channels[0].metadata()
    )
    assert described["sensor"] == "charge_amplifier + amplifier + filter"
    assert described["serial"] == "SN2, amplifier CA-7, filter AF-3"
    assert described["raw_unit"] == "V"
    assert float(described["scale"]) == pytest.approx(1.0 / TRUE)


def test_the_calibration_of_a_stage_expires_too() -> None:
    channel = replace(FORCE, amplifier=Amplifier("CA-7", valid_until=date(1969, 12, 31)))
    card = NiDaqCard(CardSettings(sample_rate_hz=RATE, buffer_s=1.0, channels=(channel,)), Epoch())
    assert card.warnings == ("force: the calibration of amplifier CA-7 expired on 1969-12-31",)


class Epoch:
    def unix_ns(self) -> int:
        return 0

    def monotonic_s(self) -> float:
        return 0.0

    def sleep(self, seconds: float) -> None:
        raise NotImplementedError


def test_a_short_circuit_at_an_iepe_sensor_is_told_and_flagged() -> None:
    channel = CardChannel("yoke.force", "cDAQ1Mod1/ai0", "force_iepe", TRUE, 200.0, unit="N")
    readings = read(sine(20.0, 50.0), Wire("force", TRUE, shorted=True), channel)
    assert {reading.flags for reading in readings} == {(Flag.OPEN_SENSOR,)}
    assert [finding.code for finding in readings[0].findings] == ["supply"]
    assert not readings[1].findings
    loose = read(sine(20.0, 50.0), Wire("force", TRUE, connected=False), channel)
    assert {reading.flags for reading in loose} == {(Flag.OPEN_SENSOR,)}
    assert not loose[0].findings


class Asked:
    """A stream of which at one reading one input is open, and from then on no clock is locked."""

    def __init__(self, at: int) -> None:
        self.reading, self._at = 0, at
        self.questions: list[str] = []

    def __getattr__(self, name: str) -> object:
        holds = self.reading == self._at if name.startswith("open") else self.reading >= self._at
        told = name.startswith(("open_chans", "pll_unlocked_chans")) and holds
        if not name.endswith("_exist"):
            return ["cDAQ1Mod1/ai0"] if told else []
        self.questions.append(name)
        return told


@pytest.mark.parametrize("at", range(5))
def test_a_cable_is_asked_about_with_each_reading_and_a_clock_with_every_fourth(at: int) -> None:
    channel = CardChannel("yoke.force", "cDAQ1Mod1/ai0", "force_iepe", TRUE, 200.0, unit="N")
    card, stream = NiDaqCard(CardSettings(sample_rate_hz=RATE, buffer_s=1.0, channels=(channel,))), Asked(at)
    told = []
    for stream.reading in range(12):
        told.append(card._status(stream))
    # that a cable was off for a moment marks that reading alone
    assert [("open_chans", 0) in said for said in told] == [reading == at for reading in range(12)]
    unlocked = [reading for reading, said in enumerate(told) if ("pll_unlocked_chans", 0) in said]
    assert unlocked == list(range(-(-at // 4) * 4, 12))
    assert len(stream.questions) == 3 * 12 + 3


class Hiccup:
    """A stream that answers from the second question on."""

    def __init__(self) -> None:
        self.asked = 0

    def __getattr__(self, name: str) -> object:
        self.asked += 1
        if self.asked == 1:
            raise DaqError("the connection was reset", -200999)
        return ["cDAQ1Mod1/ai0"] if name.startswith("overloaded") else False


def test_a_question_that_failed_is_asked_again() -> None:
    channel = CardChannel("yoke.force", "cDAQ1Mod1/ai0", "force_iepe", TRUE, 200.0, unit="N")
    card, stream = NiDaqCard(CardSettings(sample_rate_hz=RATE, buffer_s=1.0, channels=(channel,))), Hiccup()
    with pytest.raises(DaqError):
        card._status(stream)
    assert card._status(stream) == [("overloaded_chans", 0)]


def watch(channel: CardChannel, *blocks: list[float]) -> tuple[list[Flag], list[str]]:
    quality = QualityWatch([channel], 100.0)
    arrays = [np.array([block], dtype=float) for block in blocks]
    flags = [quality.flags(array)[0] for array in arrays]
    return flags, [finding.code for array in arrays for finding in quality.findings(array)]


PLAIN = CardChannel("x", "D/ai0", "voltage", 1.0, 10.0, unit="N")


@pytest.mark.parametrize(
    ("values", "flag"),
    [
        ([1.0, -9.0, 9.9], Flag.GOOD),
        ([1.0, 10.0], Flag.OVERLOAD),
        ([1.0, -10.5], Flag.OVERLOAD),
        ([9.85, 9.85, 9.85, 1.0], Flag.OVERLOAD),
        ([9.85, 9.85, 1.0, 9.85, 9.85], Flag.GOOD),
        ([-9.85, -9.85, -9.85], Flag.OVERLOAD),
        ([9.85, -9.85, 9.85], Flag.GOOD),
        ([9.7, 9.7, 9.7], Flag.GOOD),
        ([math.nan, 1.0], Flag.NOT_FINITE),
        ([math.inf, 1.0], Flag.NOT_FINITE | Flag.OVERLOAD),
        ([5e-324, -0.0], Flag.GOOD),
        ([], Flag.GOOD),
    ],
)
def test_what_a_block_tells_of_itself(values: list[float], flag: Flag) -> None:
    assert watch(PLAIN, values)[0] == [flag]


def test_a_marker_may_stand_at_its_level() -> None:
    marker = replace(PLAIN, kind="marker")
    assert watch(marker, [9.85] * 50) == ([Flag.GOOD], [])


@pytest.mark.parametrize(
    ("blocks", "codes"),
    [
        ([[1.0] * 10], ["stuck"]),
        ([[2.0] + [1.0] * 9], []),
        ([[2.0] + [1.0] * 5, [1.0] * 5], ["stuck"]),
        ([[1.0] * 5, [2.0] * 5, [2.0] * 4], []),
        ([[1.0] * 20, [1.0] * 20, [1.0, 2.0], [2.0] * 20], ["stuck", "stuck"]),
        ([[math.nan] * 20], []),
        ([[], [1.0] * 10, []], ["stuck"]),
        ([[1.0]] * 10, ["stuck"]),
        ([[2.0, 1.0], [1.0] * 9], ["stuck"]),
        ([[1.0] * 9 + [math.nan], [1.0] * 9], []),
        ([[math.nan] + [1.0] * 9, [math.nan]], []),
    ],
)
def test_a_tenth_of_a_second_of_one_value_is_stuck(blocks: list[list[float]], codes: list[str]) -> None:
    assert watch(PLAIN, *blocks)[1] == codes


def noisy(mean: float) -> list[float]:
    return [mean - 1.0, mean + 1.0] * 25


@pytest.mark.parametrize(
    ("mean", "codes"), [(0.9, []), (1.1, ["offset"]), (-1.1, ["offset"]), (math.nan, [])]
)
def test_an_ac_coupled_chain_has_no_mean(mean: float, codes: list[str]) -> None:
    iepe = replace(PLAIN, kind="force_iepe", unit="N")
    blocks = [noisy(mean)] * 6
    assert watch(iepe, *blocks)[1] == codes
    assert watch(PLAIN, *blocks)[1] == []


def test_an_offset_that_came_back_is_told_again() -> None:
    charge = replace(PLAIN, kind="charge_amplifier", unit="N", gain=1.0)
    assert watch(charge, *[noisy(2.0)] * 2, *[noisy(0.0)] * 2, *[noisy(2.0)] * 2)[1] == ["offset", "offset"]


def test_what_the_device_tells_comes_first_and_once() -> None:
    quality = QualityWatch([PLAIN], 100.0)
    fault = Finding("x", "supply", "short")
    block = np.array([[1.0] * 10])
    assert [finding.code for finding in quality.findings(block, [fault])] == ["supply", "stuck"]
    assert quality.findings(block, [fault]) == ()
    assert [finding.code for finding in quality.findings(np.array([[1.0, 2.0]]), [])] == []
    assert quality.findings(block, [fault])[0] is fault


@pytest.mark.parametrize("falling", [False, True])
def test_a_mark_is_shown_as_one_of_5_volts_that_rises(falling: bool) -> None:
    mark = np.where(np.arange(int(RATE)) % 2000 < 100, 5.0, 0.0)
    channel = CardChannel(
        "force", "cDAQ1Mod1/ai0", "marker", 1.0, 10.0, mark=Mark(0.0, 8.0, falling), unit="V"
    )
    wire = Wire("force", 1.0, range_v=10.0, mark=MarkStage(8.0, falling))
    readings = read(mark, wire, channel)
    assert values_of(readings) == pytest.approx(mark, abs=1e-5)
    assert {reading.flags for reading in readings} == {(Flag.GOOD,)}


@pytest.mark.parametrize("samples", [30.4, 2000.4])
def test_an_input_that_is_late_shows_it_later(samples: float) -> None:
    """By a time or by samples, more of them than a reading has too."""
    for delay in (samples / RATE, Samples(samples)):
        values = values_of(read(sine(1000.0, 100.0), Wire("force", TRUE, delay=delay), FORCE))[2560:]
        at = np.arange(2560, 25600) - samples
        assert values == pytest.approx(100.0 * np.sin(math.tau * 1000.0 * at / RATE), abs=0.02)


def test_a_sensor_rings_at_its_own_frequency() -> None:
    wire = Wire("force", TRUE, resonance=ResonanceStage(4000.0, 0.02), corner_hz=5.0)
    values = values_of(read(sine(2000.0, 10.0), wire, FORCE))[5120:]
    warped = math.tan(math.pi * 2000.0 / RATE) / math.tan(math.pi * 4000.0 / RATE)
    assert np.sqrt(2.0) * values.std() == pytest.approx(10.0 / (1 - warped**2), rel=2e-3)


@pytest.mark.parametrize("damping_ratio", [0.02, 0.1])
def test_a_sensor_rings_as_its_damping_lets_it(damping_ratio: float) -> None:
    wire = Wire("force", TRUE, resonance=ResonanceStage(4000.0, damping_ratio))
    values = values_of(read(sine(4000.0, 1.0), wire, FORCE))[5120:]
    assert np.sqrt(2.0) * values.std() == pytest.approx(1 / (2 * damping_ratio), rel=1e-3)


@pytest.mark.parametrize("kind", ["voltage", "force_iepe"])
def test_a_sensor_that_is_inverted_is_turned_round_where_it_is_read(kind: str) -> None:
    channel = CardChannel("force", "cDAQ1Mod1/ai0", kind, TRUE, 200.0, unit="N")
    force = sine(20.0, 50.0)
    for inverted, sign in ((None, -1.0), (True, 1.0)):
        shown = values_of(read(force, Wire("force", -TRUE), replace(channel, inverted=inverted)))
        assert shown == pytest.approx(sign * force, abs=2 * LSB_V / TRUE)

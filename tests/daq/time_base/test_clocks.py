"""The card is the time base: how host and encoder lie against it, from when their samples arrive."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from daq.block import NS_PER_S
from daq.log.records import ClockRecord
from daq.time_base.clocks import CardClock, DeviceClock
from daq.time_base.fit import ClockFit
from daq.time_base.model import ClockModel
from tests.rig.session.shafts import SteppedClock

RATE, BLOCK_S = 25_600.0, 0.1
CARD_DELAY_S = 0.004
EPOCH_S = 1_700_000_000.0
"""The encoder's clock was never set."""


class Lab:
    """A card whose clock is right, a host off by `host_ppm`, an encoder that stamps by a clock of its own."""

    def __init__(self, host_ppm: float, encoder_ppm: float = 0.0, jitter_s: float = 1e-3) -> None:
        self.clock = SteppedClock()
        self.base = CardClock(self.clock, RATE)
        self.encoder = DeviceClock("encoder", self.base)
        self._host, self._encoder = 1.0 + host_ppm * 1e-6, 1.0 + encoder_ppm * 1e-6
        self._jitter = np.random.default_rng(3)
        self._jitter_s = jitter_s
        self.base.start(lambda: None)
        self._zero_s = self.clock.now_s

    def stamps(self, card_s: np.ndarray) -> np.ndarray:
        return EPOCH_S + card_s * self._encoder

    def run(self, seconds: float) -> list[ClockRecord]:
        """Blocks of both, one after the other; what the clocks say at the end."""
        for number in range(1, round(seconds / BLOCK_S) + 1):
            end_s = number * BLOCK_S
            delay_s = CARD_DELAY_S + self._jitter.exponential(self._jitter_s)
            self.clock.now_s = self._zero_s + (end_s + delay_s) * self._host
            self.base.arrived(round(end_s * RATE), self.clock.now_s)
            taken = end_s - BLOCK_S + np.arange(10) * BLOCK_S / 10
            late = self._jitter.exponential(self._jitter_s, 10)
            self.encoder.note(self.stamps(taken), self._zero_s + (taken + late) * self._host)
        host = self.base.refit(at_last=True)
        return host + self.encoder.refit(at_last=True)[0]


@pytest.mark.parametrize("ppm", [50.0, -20.0, 0.0])
def test_the_hosts_clock_is_found_and_its_offset_leads_from_the_host_to_the_card(ppm: float) -> None:
    lab = Lab(ppm)
    host, _ = lab.run(120.0)
    assert host.device == "host"
    # Jitter of 1 ms over 1200 blocks: a rate to some 1e-3 / sqrt(1200) / 35 s = 1 ppm, and less by its edge.
    assert host.rate_ppm == pytest.approx(-ppm, abs=2.0)
    # What the card's blocks are late is no part of it: its sample 0 was taken while it was being started.
    assert host.offset_s == pytest.approx(-120.0 * ppm * 1e-6, abs=2 * host.uncertainty_s)
    assert 0 < host.uncertainty_s < 3e-4


@pytest.mark.parametrize(("host_ppm", "encoder_ppm"), [(30.0, -15.0), (-50.0, 10.0)])
def test_an_encoders_stamps_are_placed_on_the_cards_time(host_ppm: float, encoder_ppm: float) -> None:
    lab = Lab(host_ppm, encoder_ppm)
    _, encoder = lab.run(60.0)
    assert lab.encoder.locked
    assert encoder.rate_ppm == pytest.approx(-encoder_ppm, abs=3.0)
    card_s = np.array([10.0, 30.0, 60.0])
    placed = lab.encoder.card_s(lab.stamps(card_s), np.full(3, np.nan))
    assert placed == pytest.approx(card_s, abs=2 * encoder.uncertainty_s)
    assert 0 < encoder.uncertainty_s < 1e-3
    stamp_s = encoder.time_ns / NS_PER_S - encoder.offset_s
    assert stamp_s == pytest.approx(EPOCH_S + 60.0, abs=0.2)


def test_before_there_is_a_model_a_stamp_lies_where_it_arrived_and_is_not_locked() -> None:
    lab = Lab(0.0)
    assert lab.run(0.2) == []
    assert not lab.encoder.locked
    arrival_s = np.array([lab.clock.now_s])
    assert lab.encoder.card_s(lab.stamps(np.array([0.2])), arrival_s) == pytest.approx([0.2], abs=0.02)


def test_until_arrivals_say_better_two_clocks_agree_as_crystals_do() -> None:
    lab = Lab(0.0, jitter_s=0.03)  # a network that holds up every block by tens of milliseconds
    (host, _) = lab.run(4.0)
    assert abs(host.rate_ppm) < 50.0  # a fit of so few alone would be off by some 1,000
    assert host.uncertainty_s == pytest.approx(2 * 50e-6 * 4.0, rel=0.05)


def test_how_long_the_card_took_to_start_is_uncertain() -> None:
    clock = SteppedClock()
    base = CardClock(clock, RATE)
    base.start(lambda: clock.sleep(0.02))
    assert base.uncertainty_s(0.0) == pytest.approx(0.01)
    assert base.card_s(base.host_s(clock.now_s)) == pytest.approx(0.01)


def test_a_card_that_stamps_its_start_leaves_nothing_uncertain_of_it() -> None:
    clock, stamps = SteppedClock(), []

    def start() -> None:
        clock.sleep(0.003)
        stamps.append(clock.monotonic_s())
        clock.sleep(0.017)

    base = CardClock(clock, RATE)
    assert base.start(start, lambda: stamps[0]) == ""
    assert base.start_ns == clock.unix_ns() - 17_000_000
    assert base.uncertainty_s(0.0) == pytest.approx(1e-4)
    assert base.card_s(base.host_s(clock.now_s)) == pytest.approx(0.017)


@pytest.mark.parametrize("away_s", [-0.001, 0.021, 3600.0])
def test_a_stamp_of_a_time_at_which_the_card_was_not_started_is_left_out(away_s: float) -> None:
    clock = SteppedClock()
    base, began_s, began_ns = CardClock(clock, RATE), clock.monotonic_s(), clock.unix_ns()
    doubt = base.start(lambda: clock.sleep(0.02), lambda: began_s + away_s)
    assert (
        doubt == f"says that it started {away_s - 0.01:+.6f} s from when it was told to: no time of this host"
    )
    assert base.start_ns == began_ns + 10_000_000
    assert base.uncertainty_s(0.0) == pytest.approx(0.01)


@pytest.mark.parametrize("slower", [0.005, 0.07])
def test_who_reads_ever_later_sees_it_although_the_clock_is_fitted_to_what_came(slower: float) -> None:
    lab, jitter = Lab(0.0), np.random.default_rng(4)
    for number in range(1, 601):
        end_s = number * BLOCK_S
        lab.clock.now_s = lab._zero_s + end_s * (1.0 + slower) + float(jitter.exponential(1e-3))
        lab.base.arrived(round(end_s * RATE), lab.clock.now_s)
        lab.base.refit()
    assert abs(lab.base.rate_ppm) > 0.5e6 * slower  # which takes it for the clock's
    assert lab.base.age_s(600 * BLOCK_S) == pytest.approx(600 * BLOCK_S * slower, abs=0.04)


def test_news_come_ever_more_rarely() -> None:
    lab, fits = Lab(0.0), 0
    for number in range(1, 1201):
        lab.clock.now_s = lab._zero_s + number * BLOCK_S + CARD_DELAY_S
        lab.base.arrived(round(number * BLOCK_S * RATE), lab.clock.now_s)
        fits += len(lab.base.refit())
    assert 3 < fits < 30  # each takes tens of milliseconds; 120 s by steps of 30 %


def test_a_block_does_not_wait_for_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    lab, fit, waited = Lab(0.0), ClockFit.model, list[bool]()
    lab.run(20.0)

    def while_a_block_comes(self: ClockFit) -> ClockModel | None:
        block = threading.Thread(target=lab.base.arrived, args=(round(20.1 * RATE), lab.clock.now_s + 0.1))
        block.start()
        block.join(timeout=1.0)
        waited.append(block.is_alive())
        return fit(self)

    monkeypatch.setattr(ClockFit, "model", while_a_block_comes)
    assert lab.base.refit(at_last=True)
    assert waited == [False]


def test_a_step_of_the_encoders_clock_is_told_once() -> None:
    lab = Lab(0.0)
    lab.run(20.0)
    for number in range(201, 401):
        end_s = number * BLOCK_S
        lab.clock.now_s = lab._zero_s + end_s + CARD_DELAY_S
        lab.base.arrived(round(end_s * RATE), lab.clock.now_s)
        taken = end_s - BLOCK_S + np.arange(10) * BLOCK_S / 10
        late = lab._jitter.exponential(1e-3, 10)
        lab.encoder.note(lab.stamps(taken) + 3600.0, lab._zero_s + taken + late)
    _, steps = lab.encoder.refit(at_last=True)
    assert [step.code for step in steps] == ["clock.step"], steps
    assert lab.encoder.refit(at_last=True)[1] == []

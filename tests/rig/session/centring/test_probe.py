"""The emulated beam, drawn as healthy rigs differ, is centred whatever its hidden rest position is."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.centring import BAR as CENTRED_SHARE
from benchmarks.centring import BEAMS, scenario
from benchmarks.driven_beam import drawn_beam
from daq.errors import ConfigurationError
from rig.files.bench import embedded_bench, parse_bench
from rig.files.scenario import Scenario
from rig.rigs import RIGS
from rig.session.centring import CentringPlan, centre_beam, plan_of

BENCH = embedded_bench()
SHAKER, RINGING, ALUMINIUM = map(scenario, BEAMS.values())


@pytest.mark.parametrize(
    ("wanted", "share", "seed"),
    [
        (SHAKER, 0.5, 1),
        (SHAKER, -0.7, 2),
        (SHAKER, 0.0, 3),
        (RINGING, -0.3, 4),
        (ALUMINIUM, 0.6, 5),
    ],
)
def test_the_tip_is_held_in_the_middle(wanted: Scenario, share: float, seed: int) -> None:
    plan, per_volt = plan_of(wanted, BENCH), BENCH.actuator.force_per_volt
    beam = drawn_beam(wanted, per_volt, seed, share * plan.clearance)
    beam.arm_sine(plan.frequency, plan.sine.least / per_volt, 0.0, triggered=False)
    beam.start()
    middle = centre_beam(beam, plan)
    assert abs(beam.off_centre(middle.offset)) < CENTRED_SHARE
    assert plan.rest_offset(middle) == pytest.approx(
        share * plan.clearance, abs=CENTRED_SHARE * plan.clearance
    )
    assert middle.uncertainty <= 0.02 * plan.reach


def test_a_beam_on_its_flexure_alone_is_refused_before_anything_moves() -> None:
    with pytest.raises(ConfigurationError, match=r"2\.96 N/m.*rests as softly as its flexure"):
        plan_of(scenario(""), BENCH)


def test_a_real_beam_is_not_centred_by_an_emulated_card() -> None:
    text = RIGS["impact_beam"].bench
    real = text.replace("emulated = true", 'resource = "TCPIP::127.0.0.1::5025::SOCKET"', 1)
    with pytest.raises(ConfigurationError, match=r"daq_card.emulated = true: false beside a real generator"):
        plan_of(SHAKER, parse_bench(real, "bench", Path()))


def test_a_plan_stays_far_below_the_benchs_limit_and_the_beams_resonance() -> None:
    plan: CentringPlan = plan_of(SHAKER, BENCH)
    # 0.26 N move the tip of a beam on 3 kN/m by 0.127 mm: k L_drive^2 over L_drive L times g, by hand
    by_hand = (0.16 + 3e3 * (0.69 * 0.28) ** 2) / (0.69 * 0.28 * 0.28) * 0.127e-3
    assert plan.reach == pytest.approx(by_hand, rel=0.01)
    assert plan.frequency == pytest.approx(9.6, rel=0.05)
    assert plan.sine.amplitude + plan.farthest <= 12.0

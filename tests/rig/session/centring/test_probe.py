"""The emulated beam, drawn as healthy rigs differ, is centred whatever its hidden rest position is."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.errors import ConfigurationError
from drivers.protocols import DriveSettings
from rig.files.bench import embedded_bench, parse_bench
from rig.files.rigs import RIGS
from rig.files.scenario import Scenario, parse_scenario
from rig.session.centring.probe import CentringPlan, centre_beam, plan_of
from rig.twin.plant import BeamPlant, BeamPlantFactory
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.at_rest import resting

RATE = 51_200.0
BENCH = embedded_bench()
PER_VOLT = BENCH.signal_generator.force_per_volt
CENTRED_SHARE = 0.05
"""Of the clearance: 2 % that the search leaves, 1 % each of the drive's amplitude and of the beam's parts."""


def scenario(model: str) -> Scenario:
    return parse_scenario(f"""\
rig = "impact_beam"
[model]
{model}
[drive]
frequency = "20 Hz"
[acquisition]
sample_rate = "51.2 kHz"
duration = "1 s"
""")


SHAKER = scenario('shaker_stiffness = "3 kN/m"\nshaker_damping = "20 N s/m"\nshaker_mass = "20 g"')
RINGING = scenario('shaker_stiffness = "3 kN/m"')
ALUMINIUM = scenario('beam = "aluminium"\nclearance = "0.254 mm"')


class PlantBeam:
    """The plant of the emulated card, driven as the generator drives it, as fast as it can be computed."""

    sample_rate = RATE

    def __init__(self, plant: BeamPlant, frequency: float) -> None:
        self._plant, self._frequency = plant, frequency
        self._at, self._amplitude, self._offset = 0, 0.0, 0.0
        self._sides = [plant.channels.index(f"contact.force_{side}") for side in ("upper", "lower")]

    def shake(self, amplitude: float) -> None:
        self._amplitude = amplitude
        self._set()

    def push(self, offset: float) -> None:
        self._offset = offset
        self._set()

    def wait(self, seconds: float) -> None:
        self.forces(seconds)

    def forces(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        count = round(seconds * RATE)
        self._at += count
        values = self._plant.advance(count)
        return values[self._sides[0]], values[self._sides[1]]

    def _set(self) -> None:
        phase = math.tau * self._frequency * self._at / RATE
        volts = self._amplitude / PER_VOLT, self._offset / PER_VOLT
        self._plant.drive(
            DriveSettings(True, self._frequency, *volts, 0.0, phase % math.tau), float(self._at)
        )


def plant_of(wanted: Scenario, rest_offset: float, seed: int) -> BeamPlant:
    believed = twin_of(wanted)
    hidden = replace(believed, rig=replace(believed.rig, rest_offset=rest_offset))
    plant = BeamPlant(BeamPlantFactory(hidden, PER_VOLT, seed, seed + 1, healthy=True))
    plant.start(RATE)
    return plant


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
    plan = plan_of(wanted, BENCH)
    rest_offset = share * plan.clearance
    plant = plant_of(wanted, rest_offset, seed)
    middle = centre_beam(PlantBeam(plant, plan.frequency), plan)
    rig = plant._twin.rig
    pushed = resting(rig).compliance * plant._twin.drive.amplitude * middle.offset
    assert abs(rest_offset + pushed) < CENTRED_SHARE * rig.clearance
    assert plan.rest_offset(middle) == pytest.approx(rest_offset, abs=CENTRED_SHARE * plan.clearance)
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

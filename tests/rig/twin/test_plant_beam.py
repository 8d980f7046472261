"""The emulated beam: drawn as the healthy rigs are that a run is judged by."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.protocols.generator import DriveSettings
from rig.files.scenario import parse_scenario
from rig.twin.plant import ShakenPlant
from rig.twin.scenario_twin import twin_of

RATE, PER_VOLT = 51_200.0, 3.6
BEAM = parse_scenario("""
name = "beam"
rig = "impact_beam"

[drive]
frequency = "20 Hz"
amplitude = "9 N"

[acquisition]
sample_rate = "51.2 kHz"
duration = "5 s"
""")


def picked_up(seed: int, healthy: bool = True) -> float:
    """What a rigid base's accelerometer shows of each newton at the stops, m/s2."""
    plant = ShakenPlant(twin_of(BEAM), PER_VOLT, seed, 1, healthy)
    plant.start(RATE)
    plant.drive(DriveSettings(True, 20.0, 9.0 / PER_VOLT, 0.0, 0.0), 0.0)
    blocks = [plant.advance(1280) for _ in range(40)]
    rows = dict(zip(plant.channels, np.concatenate(blocks, axis=1), strict=True))
    stops = rows["contact.force_upper"] - rows["contact.force_lower"]
    return float(rows["base.acceleration"] @ stops / (stops @ stops))


def test_the_accelerometer_of_a_rigid_base_picks_up_what_those_of_healthy_rigs_do() -> None:
    """Each its own share of 1.1e-3 m/s2 a newton; 0.03 m/s2 of noise in a second leave 2e-5 of doubt."""
    shares = [picked_up(seed) for seed in range(4)]
    assert all(-6e-5 < share < 1.2e-3 for share in shares)
    assert max(shares) > 2 * min(shares)
    assert picked_up(0) == pytest.approx(shares[0])
    assert abs(picked_up(0, healthy=False)) < 6e-5

"""Of many cycles the one nearest to their middle is shown, all channels of it, as twins' are."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.diagnosis.recordings import setting_of
from rig.files.scenario import parse_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.typical_cycle import TypicalCycle, typical_cycles
from tests.rig.diagnosis.measured_log import BEAM, RATE

UPPER, LOWER = "contact.force_upper", "contact.force_lower"
AMPLITUDES = (0.4, 0.7, 1.0, 1.3, 1.7) * 4
EFFECT = ("clearance", {"scale": 1.6})


@cache
def campaign() -> Campaign:
    twin = twin_of(parse_scenario(BEAM))
    return Campaign((setting_of(twin, [*twin.channels], RATE, 20),))


def shown(unsound: float = 0.0) -> list[TypicalCycle]:
    """Of cycles that differ by their amplitudes alone; those of one amplitude cannot be used."""
    period = RATE / 20
    time = np.arange(int(len(AMPLITUDES) * period)) / period
    size = np.array([*AMPLITUDES, 1.0])[time.astype(int)]
    records: dict[str, NDArray[np.float64]] = {
        name: size * np.sin(4 * np.pi * time) for name in campaign().runs[0].twin.channels
    }
    records["drive.force"] = 9 * np.sin(2 * np.pi * time)
    wanted = [(0, UPPER), (0, LOWER)]
    return typical_cycles(campaign(), [records], [size != unsound], wanted, [EFFECT], 0)


def test_the_sound_cycle_in_the_middle_is_shown_of_every_channel() -> None:
    for each in shown():
        assert np.abs(each.lines["measured"]).max() == pytest.approx(1.0, abs=1e-3)
    for each in shown(unsound=1.0):
        assert np.abs(each.lines["measured"]).max() in (
            pytest.approx(0.7, abs=1e-3),
            pytest.approx(1.3, abs=1e-3),
        )


def test_twins_strike_in_their_cycles_and_a_wider_gap_is_struck_harder() -> None:
    upper, lower = shown()
    assert (upper.run, upper.channel, lower.channel) == (0, UPPER, LOWER)
    peaks = {
        whose: max(float(np.abs(each.lines[whose]).max()) for each in (upper, lower))
        for whose in ("nominal", "repaired")
    }
    assert len(upper.lines["nominal"]) == pytest.approx(RATE / 20, abs=1)
    assert 0 < peaks["nominal"] != peaks["repaired"]

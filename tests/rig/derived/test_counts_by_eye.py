"""Impacts in recordings of another program, counted by eye in ten cycles from 1 s on (docs/derived.md)."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from daq.log.reader import LogReader
from rig.derived.derivation import Derivation
from rig.files.scenario import parse_scenario
from rig.stream import Block
from tests.rig.derived.spatial_run import GUIDE, SOCKET, SPATIAL, spatial_blocks
from tests.rig.session.fakes import Kept

SAMPLES = Path(__file__).parents[3].parent / "shared" / "samples"

BY_EYE = {
    "beam_healthy": {"contact.force_upper": 10, "contact.force_lower": 10},
    "beam_base_flexibility": {"contact.force_upper": 10, "contact.force_lower": 10},
    "crank_healthy": {
        "crank_frame.acceleration_y": 19,
        "crank_frame.acceleration_x": 19,
        "piston_frame.acceleration_y": 17,
    },
    "crank_joint_friction": {
        "crank_frame.acceleration_y": 10,
        "crank_frame.acceleration_x": 10,
        "piston_frame.acceleration_y": 10,
    },
}


@pytest.mark.skipif(not SAMPLES.is_dir(), reason="no recordings of other programs beside here")
@pytest.mark.parametrize("name", BY_EYE)
def test_impacts_are_those_that_one_counts_by_eye(name: str) -> None:
    kept = Kept()
    with LogReader(SAMPLES / f"{name}.mcap") as log:
        scenario = parse_scenario(log.scenario)
        derivation = Derivation(kept, {"measured": tuple(log.channels("measured"))}, scenario)
        rate = 0.0
        for origin, block in log.blocks(("measured",)):
            derivation(Block(origin, block))
            rate = block.sample_rate
        derivation.finish()
    end = (1.0 + 10 / scenario.drive.cycle_hz) * rate
    counted = Counter(each.channel for each in kept.impacts if rate <= each.first_sample < end)
    assert counted == {channel: pytest.approx(count, rel=0.1) for channel, count in BY_EYE[name].items()}


def test_a_healthy_spatial_twin_is_struck_as_often_as_one_counts_by_eye() -> None:
    """7.1 blows a revolution in the socket and 14.8 on a point of the guide, as on the emulated bench."""
    kept, blocks = Kept(), spatial_blocks()
    derivation = Derivation(kept, {"measured": tuple(blocks[0])}, parse_scenario(SPATIAL))
    for together in blocks:
        for block in together.values():
            derivation(Block("measured", block))
    derivation.finish()
    counted = Counter(each.channel for each in kept.impacts)
    revolutions = 230 / 60 * 2.6
    assert counted[SOCKET] / revolutions == pytest.approx(7.1, rel=0.1)
    assert counted[GUIDE] / revolutions == pytest.approx(14.8, rel=0.1)

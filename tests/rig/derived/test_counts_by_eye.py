"""Impacts in recordings of another program, counted by eye in ten cycles from 1 s on (docs/derived.md)."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from benchmarks.impact_counts import (
    BY_EYE,
    CYCLES,
    RATE,
    SAME,
    SCENARIOS,
    as_samples,
    derived,
    shown,
)
from benchmarks.impact_counts import SAMPLES as FOREIGN
from daq.log.reader import LogReader
from rig.derived.derivation import Derivation
from rig.files.scenario import load_scenario, parse_scenario
from rig.stream import Block
from tests.rig.derived.spatial_run import GUIDE, SOCKET, SPATIAL, TEN_REVOLUTIONS_S, spatial_blocks
from tests.rig.session.fakes import Kept

_TENS = 12
SAMPLES = Path(__file__).parents[3].parent / "shared" / "samples"


@pytest.mark.skipif(not SAMPLES.is_dir(), reason="no recordings of other programs beside here")
@pytest.mark.parametrize("name", FOREIGN)
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
    assert counted == {name: pytest.approx(eye, rel=0.1) for name, (eye, _) in BY_EYE[name].items()}


@pytest.mark.long
def test_a_healthy_spatial_rig_is_struck_as_often_in_socket_and_guide_as_one_counts_by_eye() -> None:
    whose = "spatial crank, 230 rpm"
    file, settings = SCENARIOS[whose]
    asked = {**settings, "acquisition.sample_rate": f"{RATE:g} Hz"}
    scenario = load_scenario(Path("scenarios") / f"{file}.toml", asked)
    seconds = 1.0 + CYCLES / scenario.drive.cycle_hz
    rig, _ = shown(scenario, 0, seconds + 0.1)
    blocks = [Block("measured", each) for each in rig]
    samples = as_samples(blocks)
    found = derived(blocks, scenario, {"measured": tuple(samples)})
    counted = found.counts("measured", RATE, seconds * RATE)
    for name, (eye, rms) in BY_EYE[whose].items():
        looked_at = samples[name][round(RATE) : round(seconds * RATE)].astype(np.float64)
        if np.sqrt(np.mean(looked_at**2)) != pytest.approx(rms, rel=SAME):
            pytest.skip("nobody has counted this motion: another processor's is another one")
        assert counted[name] == pytest.approx(eye, rel=0.1)


@pytest.mark.long
def test_the_rule_finds_as_many_blows_on_a_healthy_spatial_twin_as_on_the_emulated_bench() -> None:
    """7.1 a revolution in the socket and 14.8 on a point of the guide that carries it.

    Ten revolutions after ten others have 7 % more or fewer.
    """
    kept, blocks = Kept(), spatial_blocks(_TENS)
    derivation = Derivation(kept, {"measured": tuple(blocks[0])}, parse_scenario(SPATIAL))
    for together in blocks:
        for block in together.values():
            derivation(Block("measured", block))
    derivation.finish()
    counted = Counter(each.channel for each in kept.impacts)
    revolutions = 230 / 60 * TEN_REVOLUTIONS_S * _TENS
    assert counted[SOCKET] / revolutions == pytest.approx(7.1, rel=0.1)
    assert counted[GUIDE] / revolutions == pytest.approx(14.8, rel=0.1)

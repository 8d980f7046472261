"""Benches whose shaker a person sets: what is set has to be measured, and set by hand at all."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

import pytest

from daq.errors import ConfigurationError
from rig.files.bench import parse_bench
from rig.files.pairing import check_pair
from rig.files.scenario import load_scenario, parse_scenario
from rig.rigs import RIGS
from rig.session.centring import plan_of

SCENARIOS = Path(__file__).parents[3] / "scenarios"
TODAY = datetime.date(2026, 11, 22)
MANUAL = '[manual_shaker]\nmaximum_amplitude = "20 N"\n'
REAL_CARD = RIGS["impact_beam"].bench.split("[daq_card]")[1].replace("emulated = true\n", "", 1)


def test_a_drive_that_is_set_by_hand_has_to_be_measured() -> None:
    beam = (SCENARIOS / "impact_beam.toml").read_text()
    bench = parse_bench(f"{MANUAL}[daq_card]{REAL_CARD}", "bench", Path())
    assert (bench.rig, bench.actuator_table, bench.unseen) == ("impact_beam", "manual_shaker", False)
    check_pair(parse_scenario(beam), bench, TODAY)
    blind = parse_bench(f"{MANUAL}[daq_card]\nemulated = true\n", "bench", Path())
    with pytest.raises(ConfigurationError, match=r"daq_card.emulated = true: false beside a real person"):
        check_pair(parse_scenario(beam), blind, TODAY)
    deaf = re.sub(
        r'\[\[daq_card.channels\]\]\nname = "drive.force".*?(?=\[\[)', "", REAL_CARD, flags=re.DOTALL
    )
    without = parse_bench(f"{MANUAL}[daq_card]{deaf}", "bench", Path())
    with pytest.raises(ConfigurationError, match=r"drive.force: a drive that is set by hand is believed"):
        check_pair(parse_scenario(beam), without, TODAY)


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"drive.amplitude": "21 N"}, r"up to 20 N \(manual_shaker.maximum_amplitude\)"),
        ({"acquisition.settle": "0 s"}, "nobody starts a drive by hand in time"),
        ({"drive.offset": "1 N"}, "no offset, with a drive that is set by hand"),
    ],
)
def test_what_a_person_cannot_set_is_refused(settings: dict[str, str], match: str) -> None:
    bench = parse_bench(f"{MANUAL}[daq_card]{REAL_CARD}", "bench", Path())
    scenario = load_scenario(SCENARIOS / "impact_beam.toml", settings)
    with pytest.raises(ConfigurationError, match=match):
        check_pair(scenario, bench, TODAY)


def test_nobody_centres_a_beam_by_hand() -> None:
    bench = parse_bench(f"{MANUAL}[daq_card]{REAL_CARD}", "bench", Path())
    with pytest.raises(ConfigurationError, match=r"manual_shaker = .*nobody sets by hand"):
        plan_of(load_scenario(SCENARIOS / "impact_beam_shaker.toml"), bench)

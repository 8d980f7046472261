"""Where the tip of an emulated beam really rests, whatever scenario and twin believe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from daq.errors import UnphysicalParameter
from rig.files.bench import parse_bench
from rig.twin.plant import ShakenPlant, resting_at
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import nominal_sensors
from sim_twin.twin import Twin
from tests.end_to_end.files import write_bench

BEAM = Twin(nominal(), SineDrive(9.0, 20.0), nominal_sensors(nominal()))


def test_a_place_is_taken_and_nothing_else_changes() -> None:
    hidden = resting_at(BEAM, 5e-5, seed=1)
    assert hidden.rig.rest_offset == 5e-5
    assert resting_at(hidden, 0.0, seed=1) == BEAM


def test_a_drawn_place_is_the_seeds_own_and_within_half_of_the_clearance_on_either_side() -> None:
    places = [resting_at(BEAM, "drawn", seed).rig.rest_offset for seed in range(200)]
    assert places[7] == resting_at(BEAM, "drawn", 7).rig.rest_offset
    assert max(map(abs, places)) <= 0.5 * BEAM.rig.clearance
    # 200 places spread evenly reach within 5 % of both ends but for one chance in 1e4
    assert min(places) < -0.45 * BEAM.rig.clearance
    assert max(places) > 0.45 * BEAM.rig.clearance


def test_a_place_at_a_stop_is_none() -> None:
    with pytest.raises(UnphysicalParameter, match="rest_offset"):
        resting_at(BEAM, 0.95 * BEAM.rig.clearance, seed=1)


def test_a_bench_says_it_in_its_unit(tmp_path: Path) -> None:
    file = write_bench(tmp_path / "bench.toml", emulation='[emulation]\nrest_offset = "-0.05 mm"')
    bench = parse_bench(file.read_text(), "bench", tmp_path)
    assert bench.emulation.rest_offset == pytest.approx(-5e-5)


def test_another_run_on_a_rig_sets_anew_what_every_run_sets_anew_and_nothing_else() -> None:
    plant = ShakenPlant(BEAM, 3.6, seed=1, run_seed=2, healthy=True)
    drawn = plant.really
    plant.start(51_200.0)
    assert plant.really is drawn
    plant.start(51_200.0)
    again = plant.really
    assert again.rig.clearance != drawn.rig.clearance
    assert again.rig.clearance == pytest.approx(drawn.rig.clearance, rel=0.2)
    assert replace(again.rig, clearance=drawn.rig.clearance) == drawn.rig

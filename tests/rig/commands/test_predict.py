"""`rattle predict`: physics.md's numbers, and a log of the twin alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from daq.log.reader import LogReader
from daq.log.recover import verify_log
from tests.rig.commands.cli import Call

SCENARIO = """\
name = "prediction"
rig = "impact_beam"
[model]
clearance = "{clearance} mm"
[drive]
frequency = "{frequency} Hz"
amplitude = "9 N"
[acquisition]
sample_rate = "51.2 kHz"
settle = "{settle} s"
duration = "0.1 s"
"""


def scenario(folder: Path, frequency: float = 20, clearance: float = 0.127, settle: float = 0) -> Path:
    path = folder / "scenario.toml"
    path.write_text(SCENARIO.format(frequency=frequency, clearance=clearance, settle=settle))
    return path


# physics.md section 1, the table of reference values
@pytest.mark.parametrize(
    ("frequency", "clearance", "contact_ms", "first_peak_n"),
    [
        (5, 0.127, 7.0409, 18.381),
        (5, 0.254, 8.8606, 28.910),
        (5, 0.508, 11.1582, 45.716),
        (20, 0.127, 4.4826, 28.895),
        (20, 0.254, 5.6468, 45.255),
        (20, 0.508, 7.1259, 70.778),
    ],
)
def test_first_contact_is_that_of_physics(
    call: Call, tmp_path: Path, frequency: float, clearance: float, contact_ms: float, first_peak_n: float
) -> None:
    answer = call("predict", scenario(tmp_path, frequency, clearance), "--json", "--out", tmp_path / "p.mcap")
    assert answer.code == 0, answer.err
    values = json.loads(answer.out)
    assert values["first_peak_n"] == pytest.approx(first_peak_n, rel=0.005)
    # printed to 0.1 us; two programs' integrators agree far better than their last digit
    assert values["first_contact_s"] == pytest.approx(contact_ms * 1e-3, abs=1e-6)


def test_the_nominal_prediction_is_noiseless_from_rest_on_the_unix_epoch(call: Call, tmp_path: Path) -> None:
    assert call("predict", scenario(tmp_path), "--out", tmp_path / "p.mcap").code == 0
    assert verify_log(tmp_path / "p.mcap").sound
    with LogReader(tmp_path / "p.mcap") as log:
        rows = log.table("predicted")
        assert not log.channels("measured")
    assert {(row.time_ns, row.first_sample, len(row)) for row in rows.values()} == {(0, 0, 5120)}
    times = np.arange(5120) / 51_200
    # the start of the sine is a kink, which the anti-alias filter rounds
    assert rows["drive.force"].values[50:] == pytest.approx(9 * np.sin(2 * np.pi * 20 * times)[50:], abs=2e-3)
    assert not rows["base.acceleration"].values.any()


def test_sample_0_comes_after_settle(call: Call, tmp_path: Path) -> None:
    assert call("predict", scenario(tmp_path, settle=0.0125), "--out", tmp_path / "p.mcap").code == 0
    with LogReader(tmp_path / "p.mcap") as log:
        drive = log.series("predicted", "drive.force")
    assert drive.time_ns == 0
    # a quarter of a 20 Hz cycle later: the sine's top
    assert drive.values[0] == pytest.approx(9.0, abs=2e-3)


def test_a_seed_gives_one_healthy_rig_again_and_again(call: Call, tmp_path: Path) -> None:
    found = {}
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        path = tmp_path / f"{name}.mcap"
        assert call("predict", scenario(tmp_path), "--seed", seed, "--out", path).code == 0
        with LogReader(path) as log:
            found[name] = {channel: row.values for channel, row in log.table("predicted").items()}
    for channel, values in found["a"].items():
        assert np.array_equal(values, found["b"][channel])
        assert not np.array_equal(values, found["c"][channel])
        assert values.std() > 0.01  # noise, at least
    assert found["a"]["base.acceleration"].std() == pytest.approx(0.03, rel=0.1)


def test_an_effect_moves_the_numbers(call: Call, tmp_path: Path) -> None:
    (tmp_path / "wide.json").write_text('[{"name": "clearance", "parameters": {"scale": 2.0}}]')
    answer = call(
        "predict",
        scenario(tmp_path),
        "--effects",
        tmp_path / "wide.json",
        "--json",
        "--out",
        tmp_path / "p.mcap",
    )
    # twice 0.127 mm is the table's 0.254 mm
    assert json.loads(answer.out)["first_peak_n"] == pytest.approx(45.255, rel=0.005)


def test_an_existing_file_is_not_overwritten(call: Call, tmp_path: Path) -> None:
    (tmp_path / "p.mcap").write_bytes(b"mine")
    answer = call("predict", scenario(tmp_path), "--out", tmp_path / "p.mcap")
    assert answer.code == 1
    assert "p.mcap" in answer.err
    assert (tmp_path / "p.mcap").read_bytes() == b"mine"


CRANK = """\
rig = "planar_slider_crank"
[model]
clearance_1 = "1 mm"
clearance_2 = "1 mm"
[drive]
speed = "200 rpm"
[acquisition]
sample_rate = "25.6 kHz"
settle = "{settle} s"
duration = "0.4 s"
"""


def crank(folder: Path, settle: float = 0.0, text: str = CRANK) -> Path:
    path = folder / "crank.toml"
    path.write_text(text.format(settle=settle))
    return path


def test_the_planar_crank_gives_its_reference_peaks(call: Call, tmp_path: Path) -> None:
    answer = call("predict", crank(tmp_path), "--json", "--out", tmp_path / "p.mcap")
    assert answer.code == 0, answer.err
    values = json.loads(answer.out)
    # physics.md section 2, 200 rpm and 1 mm
    assert values["first_peak_crank_pin_n"] == pytest.approx(9079.3, rel=0.005)
    assert values["first_peak_piston_pin_n"] == pytest.approx(14918.8, rel=0.005)


def test_a_cranks_angle_begins_below_one_turn_and_is_kept_in_full(call: Call, tmp_path: Path) -> None:
    path = crank(tmp_path, settle=0.7)
    assert call("predict", path, "--out", tmp_path / "p.mcap").code == 0
    with LogReader(tmp_path / "p.mcap") as log:
        angle, marker = log.series("predicted", "crank.angle"), log.series("predicted", "crank.marker")
    assert angle.values.dtype == np.float64
    count = 2 * np.pi / 4096
    turned = 2 * np.pi * ((200 / 60 * (0.7 + np.arange(len(angle)) / 25_600)) - 2)
    assert 0 <= angle.values[0] < 2 * np.pi
    assert angle.values == pytest.approx(turned, abs=1.001 * count)
    assert angle.values / count == pytest.approx(np.round(angle.values / count), abs=1e-6)
    # 5 V from 0 to 5 degrees; the anti-alias filter rings for a few samples at its edges
    high = np.degrees(turned) % 360 < 5
    edges = np.flatnonzero(np.diff(high.astype(int)))
    clear = np.array([np.abs(edges - k).min() > 40 for k in range(len(high))])
    assert marker.values[clear & ~high] == pytest.approx(0.0, abs=0.05)


def test_a_crank_that_cannot_be_is_refused_with_name_value_and_range(call: Call, tmp_path: Path) -> None:
    short = CRANK.replace("[drive]", 'crank_length = "0.563 m"\n[drive]')
    answer = call("predict", crank(tmp_path, text=short), "--out", tmp_path / "p.mcap")
    assert answer.code == 2
    assert "model.rod_length = 0.564: above 0.565 m" in answer.err
    assert not (tmp_path / "p.mcap").exists()


SPATIAL = """\
rig = "spatial_slider_crank"
[model]
axis_angle = "{angle} deg"
[drive]
speed = "230 rpm"
[acquisition]
sample_rate = "25.6 kHz"
settle = "0.5 s"
duration = "0.6 s"
"""


@pytest.mark.parametrize("angle", [90, 65])
def test_the_spatial_crank_predicts_every_channel(call: Call, tmp_path: Path, angle: float) -> None:
    path = tmp_path / "spatial.toml"
    path.write_text(SPATIAL.format(angle=angle))
    answer = call("predict", path, "--json", "--out", tmp_path / "p.mcap")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["first_peak_socket_n"] > 0
    with LogReader(tmp_path / "p.mcap") as log:
        rows = log.table("predicted")
    forces = {f"slider.force_{point}" for point in range(1, 9)} | {"socket.force"}
    assert rows.keys() == forces | {"motor.tachometer", "flywheel.marker"}
    assert rows["motor.tachometer"].values[100:] == pytest.approx(230 * 2 * np.pi / 60, rel=1e-5)
    for name in forces:
        # never a pull; the anti-alias filter rings below zero after an impact
        assert rows[name].values.min() > -0.1 * rows[name].values.max() - 1e-6
    # somebody carries the slider: 0.35 kg and its share of the rod rest on the guide or hang on the socket
    assert sum(rows[f"slider.force_{point}"].values.mean() for point in (3, 4, 7, 8)) > 1.0


def test_a_rod_with_too_many_modes_is_refused_with_name_value_and_range(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "spatial.toml"
    path.write_text(SPATIAL.format(angle=90).replace("[drive]", "rod_modes = 40\n[drive]"))
    answer = call("predict", path, "--out", tmp_path / "p.mcap")
    assert answer.code == 2
    assert "model.rod_modes = 40: at least 0, at most" in answer.err


BASE = """\
rig = "impact_beam"
[model]
base = "flexible"
cover = "{cover}"
[drive]
frequency = "20 Hz"
[acquisition]
sample_rate = "51.2 kHz"
settle = "0 s"
duration = "0.1 s"
"""


@pytest.mark.long
@pytest.mark.parametrize("cover", ["none", "aluminium", "fibreglass"])
def test_a_flexible_base_moves_and_its_cover_with_it(call: Call, tmp_path: Path, cover: str) -> None:
    path = tmp_path / "base.toml"
    path.write_text(BASE.format(cover=cover))
    assert call("predict", path, "--out", tmp_path / "p.mcap").code == 0
    with LogReader(tmp_path / "p.mcap") as log:
        rows = log.table("predicted")
    assert np.abs(rows["base.acceleration"].values).max() > 1.0
    on_cover = {"cover.acceleration_center", "cover.acceleration_corner"}
    assert rows.keys() & on_cover == (set() if cover == "none" else on_cover)
    assert all(np.abs(rows[name].values).max() > 0.1 for name in rows.keys() & on_cover)


def test_the_log_says_which_effects_its_twin_had(call: Call, tmp_path: Path) -> None:
    effects = tmp_path / "effects.json"
    effects.write_text('[{"name": "clearance", "parameters": {"scale": 1.5}}]')
    assert call("predict", scenario(tmp_path), "--effects", effects, "--out", tmp_path / "p.mcap").code == 0
    with LogReader(tmp_path / "p.mcap") as log:
        assert json.loads(log.metadata["twin"]["effects"]) == json.loads(effects.read_text())


def test_a_file_that_is_there_is_refused_before_anything_is_read(call: Call, tmp_path: Path) -> None:
    (tmp_path / "p.mcap").write_text("mine")
    answer = call("predict", "not read.toml", "--out", tmp_path / "p.mcap")
    assert answer.code == 1
    assert "p.mcap is there already; remove it or name another, nothing was predicted" in answer.err

"""`rattle check` refuses what a run would refuse before anything moves."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from rig.rigs import RIGS
from tests.end_to_end.files import write_bench, write_scenario
from tests.rig.commands.cli import Call

SCENARIOS = Path(__file__).parents[3] / "scenarios"
CRANK, CRANK_BENCH = SCENARIOS / "planar_slider_crank.toml", SCENARIOS / "crank_bench.example.toml"
SPATIAL = SCENARIOS / "spatial_slider_crank.toml"
BENCH = SCENARIOS / "bench.example.toml"
FAST = 'speed = "900 rpm"'


def crank(path: Path, old: str = "", new: str = "") -> Path:
    text = CRANK.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


@pytest.fixture
def lasting_bench(tmp_path: Path) -> Path:
    """The crank's example with calibrations that no test outlives."""
    path = tmp_path / "crank_bench.toml"
    path.write_text(CRANK_BENCH.read_text().replace("valid_until = 2027", "valid_until = 2096"))
    return path


def test_a_motor_without_time_for_its_ramp_is_refused_on_any_bench(call: Call, tmp_path: Path) -> None:
    hasty = crank(tmp_path / "hasty.toml", 'settle = "1 s"', 'settle = "0.5 s"')
    said = "acquisition.settle = 0.5 s: at least 1 s: a motor comes up on its ramp"
    for command in ("check", "run"):
        answer = call(command, hasty)
        assert answer.code == 2
        assert answer.err.count(said) == 1


def test_a_speed_that_this_bench_does_not_allow_is_refused_on_it(
    call: Call, tmp_path: Path, lasting_bench: Path
) -> None:
    fast = crank(tmp_path / "fast.toml", 'speed = "200 rpm"', FAST)
    answer = call("check", fast, "--bench", lasting_bench)
    assert answer.code == 2
    assert "drive.speed = 900 rpm: up to 300 rpm (inverter.maximum_speed)" in answer.err
    answer = call("check", crank(tmp_path / "slow.toml"), "--bench", lasting_bench)
    assert answer.code == 0
    remark, verdict = answer.out.splitlines()
    assert remark.startswith("! no delay for crank_frame.acceleration_y, ")
    assert verdict == f"{tmp_path / 'slow.toml'}: scenario, no faults on {lasting_bench}"


def test_without_a_bench_it_is_told_that_the_emulated_one_would_refuse(call: Call, tmp_path: Path) -> None:
    """Another bench may allow it, so that it is no fault of the scenario."""
    answer = call("check", crank(tmp_path / "fast.toml", 'speed = "200 rpm"', FAST))
    assert answer.code == 0
    remark, verdict = answer.out.splitlines()
    assert remark.startswith(
        "! needs a bench of its own, the emulated one refuses drive.speed = 900 rpm: up to"
    )
    assert verdict == f"{tmp_path / 'fast.toml'}: scenario, no faults"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("valid_until = 2027-05-04", "valid_until = 2026-05-05", "2026-05-05: not before today"),
        ('name = "base.acceleration"', 'name = "crank_frame.acceleration_x"', "a channel of the impact_beam"),
    ],
)
def test_a_bench_that_no_run_takes_is_refused(
    call: Call, tmp_path: Path, old: str, new: str, said: str
) -> None:
    text = BENCH.read_text().replace(old, new).replace("valid_until = 2027", "valid_until = 2096")
    (tmp_path / "bench.toml").write_text(text)
    answer = call("check", tmp_path / "bench.toml")
    assert answer.code == 2
    assert said in answer.err


@pytest.fixture
def blind_bench(tmp_path: Path) -> Path:
    """An emulated crank with an accelerometer and nothing that shows the shaft."""
    bench = RIGS["planar_slider_crank"].bench
    head, first, *_ = bench.split("[[daq_card.channels]]")
    path = tmp_path / "blind.toml"
    path.write_text(f"{head}[[daq_card.channels]]{first}")
    return path


def test_a_crank_that_no_channel_shows_is_refused_before_anything_starts(
    call: Call, tmp_path: Path, blind_bench: Path
) -> None:
    sweep = f'[sweep]\nname = "s"\nscenario = "{CRANK}"\n[axes]\n"drive.speed" = ["200 rpm"]\n'
    (tmp_path / "sweep.toml").write_text(sweep)
    on_it = ("--bench", blind_bench)
    out = (*on_it, "--out", tmp_path / "out")
    for call_of in (
        ("check", blind_bench),
        ("check", CRANK, *on_it),
        ("check", tmp_path / "sweep.toml", *on_it),
        ("run", CRANK, *out),
        ("sweep", tmp_path / "sweep.toml", *out),
        ("dwell", CRANK, "--speeds", "100 rpm", *out),
    ):
        answer = call(*call_of)
        assert answer.code == 2
        shown = (
            "daq_card.channels = crank_frame.acceleration_y: one that shows the crank turn: its angle on a"
        )
        assert shown in answer.err
        assert "starting" not in answer.out
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("rig", "name"),
    [
        ("planar_slider_crank", "crank.angle"),
        ("planar_slider_crank", "crank.marker"),
        ("spatial_slider_crank", "flywheel.marker"),
    ],
)
def test_one_channel_that_shows_the_shaft_will_do(call: Call, tmp_path: Path, rig: str, name: str) -> None:
    head, *channels = RIGS[rig].bench.split("[[daq_card.channels]]")
    (shaft,) = (channel for channel in channels if f'"{name}"' in channel)
    bench = tmp_path / "bench.toml"
    bench.write_text("[[daq_card.channels]]".join([head, channels[0], shaft]))
    assert call("check", SCENARIOS / f"{rig}.toml", "--bench", bench).code == 0


@pytest.mark.parametrize("card", ["", "emulated = true\nchannels = []"])
def test_a_bench_without_a_channel_is_refused(call: Call, tmp_path: Path, card: str) -> None:
    head = BENCH.read_text().partition("[daq_card]")[0]
    (tmp_path / "bench.toml").write_text(f"{head}[daq_card]\n{card}\n")
    answer = call("check", tmp_path / "bench.toml")
    assert answer.code == 2
    assert "daq_card.channels = [...]: at least one table [[daq_card.channels]]" in answer.err


def test_every_point_of_a_sweep_is_checked_on_a_bench(
    call: Call, tmp_path: Path, lasting_bench: Path
) -> None:
    crank(tmp_path / "s.toml")
    sweep = '[sweep]\nname = "fast"\nscenario = "s.toml"\n[axes]\n"drive.speed" = ["200 rpm", "310 rpm"]\n'
    (tmp_path / "sweep.toml").write_text(sweep)
    assert call("check", tmp_path / "sweep.toml").code == 0
    answer = call("check", tmp_path / "sweep.toml", "--bench", lasting_bench)
    assert answer.code == 2
    assert "point 2: drive.speed = 310 rpm: up to 300 rpm" in answer.err


def test_a_bench_is_not_checked_on_a_bench(call: Call, lasting_bench: Path) -> None:
    answer = call("check", lasting_bench, "--bench", lasting_bench)
    assert answer.code == 2
    assert "a scenario or a sweep to check on it" in answer.err


@pytest.fixture
def odd_spatial(tmp_path: Path) -> Path:
    """A spatial crank that no twin can be set up for and that is too fast for the emulated bench."""
    text = SPATIAL.read_text().replace("[model]\n", "[model]\nrod_modes = 3\n")
    path = tmp_path / "odd.toml"
    path.write_text(re.sub(r'speed = "[^"]*"', FAST, text))
    return path


@pytest.fixture
def emulated_bench(tmp_path: Path) -> Path:
    path = tmp_path / "emulated.toml"
    path.write_text("[inverter]\nemulated = true\n")
    return path


NO_TWIN = "model.rod_modes = 3: an even number: as many in each plane"
HASTY = "acquisition.settle = 0.5 s: at least 1 s: a motor comes up on its ramp"


def swept(path: Path, scenario: Path, axes: str = '"drive.speed" = ["100 rpm", "200 rpm"]') -> Path:
    path.write_text(f'[sweep]\nname = "s"\nscenario = "{scenario}"\n[axes]\n{axes}\n')
    return path


def test_every_point_of_a_sweep_is_checked_without_a_bench(call: Call, tmp_path: Path) -> None:
    hasty = crank(tmp_path / "hasty.toml", 'settle = "1 s"', 'settle = "0.5 s"')
    answer = call("check", swept(tmp_path / "sweep.toml", hasty))
    assert answer.code == 2
    assert f"points 1-2: {HASTY}" in answer.err


def test_a_twin_is_set_up_for_every_point_of_a_sweep(
    call: Call, tmp_path: Path, odd_spatial: Path, emulated_bench: Path
) -> None:
    sweep = swept(tmp_path / "sweep.toml", odd_spatial)
    for options in ((), ("--bench", emulated_bench)):
        answer = call("check", sweep, *options)
        assert answer.code == 2
        assert answer.err.count(f"points 1-2: {NO_TWIN}") == 1


def test_a_sweep_that_the_emulated_bench_refuses_is_told_so(call: Call, tmp_path: Path) -> None:
    axes = '"drive.speed" = ["200 rpm", "900 rpm"]'
    answer = call("check", swept(tmp_path / "sweep.toml", CRANK, axes))
    assert answer.code == 0
    refused = "! needs a bench of its own, the emulated one refuses point 2: drive.speed = 900 rpm: up to"
    assert answer.out.startswith(refused)


def test_a_beam_that_settles_too_shortly_is_centred_on_no_bench(call: Call, tmp_path: Path) -> None:
    text = (SCENARIOS / "impact_beam.toml").read_text()
    (tmp_path / "beam.toml").write_text(re.sub(r'settle = "[^"]*"', 'settle = "0.5 s"', text))
    sweep = tmp_path / "sweep.toml"
    swept(sweep, tmp_path / "beam.toml", '"drive.frequency" = ["19 Hz", "20 Hz"]')
    sweep.write_text(sweep.read_text().replace("[axes]", "centre = true\n[axes]"))
    answer = call("check", sweep)
    assert answer.code == 2
    assert answer.err.count("points 1-2: acquisition.settle = 0.5 s: at least 0.8 s") == 1


@pytest.mark.parametrize("command", ["check", "run", "check a sweep", "sweep"])
def test_faults_of_a_scenario_or_sweep_and_of_the_bench_are_told_together(
    call: Call, tmp_path: Path, command: str
) -> None:
    if "sweep" in command:
        file = swept(tmp_path / "sweep.toml", CRANK, '"drive.speed" = ["-200 rpm"]')
    else:
        file = crank(tmp_path / "back.toml", '"200 rpm"', '"-200 rpm"')
    bench = tmp_path / "bench.toml"
    bench.write_text("[inverter]\nemulated = true\nrpm_per_hz = -5.0\n")
    out = () if "check" in command else ("--out", tmp_path / "out")
    answer = call(command.split()[0], file, "--bench", bench, *out)
    assert answer.code == 2
    assert f"{file}: " in answer.err
    assert '= "-200 rpm": 1 rpm to 3000 rpm' in answer.err
    assert f"{bench}: inverter.rpm_per_hz = -5.0" in answer.err


def test_what_no_bench_and_what_this_bench_forbids_is_told_together(
    call: Call, odd_spatial: Path, emulated_bench: Path
) -> None:
    answer = call("check", odd_spatial, "--bench", emulated_bench)
    assert answer.code == 2
    first, *told = answer.err.splitlines()
    assert first.endswith(f"{odd_spatial} on {emulated_bench}:")
    assert len(told) == 2
    assert "drive.speed = 900 rpm: up to 350 rpm (inverter.maximum_speed)" in told[0]
    assert NO_TWIN in told[1]


def test_a_scenario_beside_a_faulty_bench_is_checked_as_far_as_it_can_be(
    call: Call, tmp_path: Path, odd_spatial: Path
) -> None:
    odd_spatial.write_text(re.sub(r'settle = "[^"]*"', 'settle = "0.5 s"', odd_spatial.read_text()))
    bench = tmp_path / "bench.toml"
    bench.write_text("[inverter]\nemulated = true\nrpm_per_hz = -5.0\n")
    answer = call("check", odd_spatial, "--bench", bench)
    assert answer.code == 2
    assert f"{odd_spatial}: {HASTY}" in answer.err
    assert f"{odd_spatial}: {NO_TWIN}" in answer.err
    assert f"{bench}: inverter.rpm_per_hz = -5.0" in answer.err


def test_a_bench_beside_a_faulty_scenario_is_checked_as_far_as_it_can_be(
    call: Call, tmp_path: Path, blind_bench: Path
) -> None:
    back = crank(tmp_path / "back.toml", '"200 rpm"', '"-200 rpm"')
    answer = call("check", back, "--bench", blind_bench)
    assert answer.code == 2
    assert f'{back}: drive.speed = "-200 rpm"' in answer.err
    assert f"{blind_bench}: daq_card.channels = crank_frame.acceleration_y: one that shows" in answer.err


@pytest.mark.parametrize("beside", [(), (SCENARIOS / "impact_beam.toml",)])
def test_what_a_bench_hides_in_the_rig_is_checked_with_it(
    call: Call, tmp_path: Path, beside: tuple[Path, ...]
) -> None:
    bench, hidden = tmp_path / "bench.toml", tmp_path / "hidden.json"
    bench.write_text('[emulation]\neffects = "hidden.json"\n')
    arguments = (*beside, "--bench", bench) if beside else (bench,)
    hidden.write_text('[{"name": "clearence"}, {"name": "clearance", "parameters": {"scale": 9, "size": 1}}]')
    answer = call("check", *arguments)
    assert answer.code == 2
    assert 'emulation.effects [1].name = "clearence": unknown effect; did you mean clearance?' in answer.err
    assert "emulation.effects [2].clearance.scale = 9: 0.5 to 0.9 or 1.1 to 2" in answer.err
    assert "emulation.effects [2].clearance.size = 1: unknown key" in answer.err
    hidden.write_text('[{"name": "clearance", "parameters": {"scale": 1.5}}]')
    assert call("check", *arguments).code == 0


def test_a_bench_alone_may_hide_what_any_rig_can_have_and_beside_a_scenario_what_that_rig_can(
    call: Call, tmp_path: Path
) -> None:
    bench, hidden = tmp_path / "bench.toml", tmp_path / "hidden.json"
    bench.write_text('[emulation]\neffects = "hidden.json"\n')
    names = {name: {*kind.nominal().model.effects} for name, kind in RIGS.items()}
    only = next(name for name in names["planar_slider_crank"] if name not in names["impact_beam"])
    effect = RIGS["planar_slider_crank"].nominal().model.effects[only]
    values = {
        name: each.words[0] if each.words else each.intervals[0][0] for name, each in effect.asked.items()
    }
    hidden.write_text(json.dumps([{"name": only, "parameters": values}]))
    assert call("check", bench).code == 0
    beside_the_beam = call("check", SCENARIOS / "impact_beam.toml", "--bench", bench)
    assert beside_the_beam.code == 2
    assert f'emulation.effects [1].name = "{only}": unknown effect' in beside_the_beam.err


def test_a_bench_is_told_to_read_an_emergency_stop_or_none(
    call: Call, tmp_path: Path, lasting_bench: Path
) -> None:
    assert "emergency stop: none is read\n" in call("check", lasting_bench).out
    watched = tmp_path / "watched.toml"
    watched.write_text(f'{lasting_bench.read_text()}\n[emergency_stop]\nline = "inverter/RH"\n')
    assert "emergency stop: inverter/RH is read, normally closed\n" in call("check", watched).out


def test_a_real_shaker_beside_an_emulated_card_is_remarked(call: Call, tmp_path: Path) -> None:
    bench = write_bench(tmp_path / "bench.toml", generator="TCPIP::127.0.0.1::5025::SOCKET")
    remark = "! nothing measures what the real shaker does (the card is emulated)"
    for arguments in ([bench], [write_scenario(tmp_path / "beam.toml"), "--bench", bench]):
        checked = call("check", *arguments)
        assert checked.code == 0
        assert remark in checked.out


def test_what_a_scenario_says_is_shown_and_never_obeyed(call: Call, tmp_path: Path) -> None:
    """A limit may be of a channel that no rig has, whatever it is called."""
    limits = '[limits."\\u001b]0;t\\u0007\\u202e"]\nabort = "5 Pa"'
    answer = call("check", write_scenario(tmp_path / "s.toml", limits=limits))
    assert answer.code == 0
    assert r"limits.\x1b]0;t\x07\u202e = (here): a channel of the bench" in answer.out
    assert not set(answer.out + answer.err) & set("\x1b\x07\u202e")


def test_a_bench_on_which_nothing_tells_the_drives_phase_says_that_no_run_is_judged(
    call: Call, tmp_path: Path
) -> None:
    bench = write_bench(tmp_path / "bench.toml")
    assert "no run is judged" not in call("check", bench).out
    first, *channels = bench.read_text().split("[[daq_card.channels]]")
    others = [each for each in channels if 'name = "drive.force"' not in each]
    assert len(others) == len(channels) - 1
    bench.write_text("[[daq_card.channels]]".join([first, *others]))
    assert "! no channel is drive.force" in call("check", bench).out
    assert "no run is judged or diagnosed" in call("check", bench).out


def test_a_scenario_with_every_key_passes(call: Call, tmp_path: Path) -> None:
    file = tmp_path / "whole.toml"
    shown = call("scenario", "planar_slider_crank")
    file.write_text(shown.out, encoding="utf-8")
    assert "frame_piston_y_frequency" in shown.out
    assert "no faults" in call("check", file).out
    refused = call("scenario", "moon_buggy")
    assert refused.code == 2
    assert "impact_beam, planar_slider_crank" in refused.err

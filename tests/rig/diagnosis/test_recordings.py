"""Recorded runs as a campaign: what is used, what is left out with a remark, what is refused and why."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.errors import ConfigurationError, LogError
from daq.log.records import RANGE
from rig.diagnosis.diagnose_runs import not_looked_for
from rig.diagnosis.recordings import recorded
from sim_twin.diagnosis.subject import Draw, Named
from tests.rig.diagnosis.measured_log import BEAM, BLOCK, CRANK, RATE, Damage, flagged, recording, write

Recording = tuple[tuple[Channel, ...], NDArray[np.float64]]
UPPER, YOKE = "contact.force_upper", "yoke.force"


@cache
def beam() -> Recording:
    return recording(BEAM)


@cache
def crank() -> Recording:
    return recording(CRANK)


def cut(found: Recording, seconds: float) -> Recording:
    return found[0], found[1][:, : round(seconds * RATE)]


def with_row(found: Recording, name: str, row: NDArray[np.float64]) -> Recording:
    channels, samples = found[0], found[1].copy()
    samples[[channel.name for channel in channels].index(name)] = row
    return channels, samples


def turned(found: Recording) -> Recording:
    """Another run: the same samples from the middle of its cycles on."""
    return found[0], np.roll(found[1], found[1].shape[1] // 2, axis=1)


def spoilt(name: str, *numbers: int, flags: Flag = Flag.OVERLOAD) -> Damage:
    """Flag some blocks of a channel."""

    def damage(block: SampleBlock) -> SampleBlock:
        here = block.channel == name and block.first_sample // BLOCK in numbers
        return flagged(block, flags) if here else block

    return damage


def dropped(name: str | None, number: int) -> Damage:
    """Lose a block of one channel, or of all."""

    def damage(block: SampleBlock) -> SampleBlock | None:
        here = name in (None, block.channel) and block.first_sample == number * BLOCK
        return None if here else block

    return damage


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def test_a_whole_run_is_cut_into_blocks_of_cycles(log: Path) -> None:
    found = recorded([write(log, beam(), BEAM)])
    setting = found.campaign.runs[0]
    # 1.5 s at 20 Hz: 30 cycles, less one and a half at the ends, in two halves
    assert setting.cycles == 14
    assert found.measured.shape == (2, found.campaign.layout.size)
    assert found.measured.dtype == np.float32
    assert np.isfinite(found.measured).all()
    assert found.remarks == ()
    assert found.scenarios == (BEAM,)
    assert setting.columns.channels == setting.twin.channels
    # within 0.02 % of the nominal frequency, five standard deviations
    assert setting.columns.frequency == pytest.approx(20.0, rel=1e-3)
    assert setting.columns.frequency == setting.twin.drive.frequency


def test_a_healthy_recording_lies_among_healthy_simulations(log: Path) -> None:
    found = recorded([write(log, beam(), BEAM)])
    draws = [Draw((), seed) for seed in range(8)]
    healthy = np.array([shown[0][0] for shown in found.campaign.observe(draws) if shown[0] is not None])
    assert len(healthy) == 8
    layout = found.campaign.layout
    energies = [
        layout.starts[k] + 2
        for k, cell in enumerate(layout.cells)
        if cell.what == "energy" and cell.channel in (UPPER, YOKE)
    ]
    apart = found.measured[0, energies] - healthy[:, energies].mean(axis=0)
    # of logarithms: chaotic cycles scatter by some tenths; a filter, a unit or a rate that is wrong by a
    # factor of two would move them by 1.4
    assert np.abs(apart).max() < 1.4
    assert np.sqrt(np.mean(apart**2)) < 0.5


def test_several_runs_are_one_campaign_with_as_many_blocks_as_the_shortest(tmp_path: Path) -> None:
    paths = [
        write(tmp_path / "long.mcap", beam(), BEAM),
        write(tmp_path / "short.mcap", cut(beam(), 0.9), BEAM),
    ]
    found = recorded(paths)
    assert len(found.campaign.runs) == len(found.scenarios) == 2
    single = recorded(paths[:1])
    assert found.measured.shape == (2, 2 * single.campaign.layout.size)
    assert [run.cycles for run in found.campaign.runs] == [14, 8]


def test_runs_stand_in_the_order_in_which_they_were_made(tmp_path: Path) -> None:
    def an_hour_later(block: SampleBlock) -> SampleBlock:
        return replace(block, time_ns=block.time_ns + 3600 * 10**9)

    first = write(tmp_path / "b.mcap", beam(), BEAM)
    second = write(tmp_path / "a.mcap", turned(beam()), BEAM, damage=an_hour_later)
    for named in ([first, second], [second, first]):
        assert recorded(named).paths == (first, second)


def test_a_crank_is_followed_by_its_encoder(log: Path) -> None:
    found = recorded([write(log, crank(), CRANK)])
    assert found.campaign.runs[0].columns.frequency == pytest.approx(200 / 60, rel=1e-3)
    assert "crank.angle" in found.campaign.runs[0].columns.channels
    assert found.remarks == ()


def test_runs_of_different_rigs_are_no_campaign(tmp_path: Path) -> None:
    paths = [write(tmp_path / "b.mcap", beam(), BEAM), write(tmp_path / "c.mcap", crank(), CRANK)]
    with pytest.raises(
        ConfigurationError, match=r"b\.mcap is of the impact_beam, c\.mcap is of the planar_slider_crank"
    ):
        recorded(paths)


def test_runs_of_two_specimens_are_no_campaign(tmp_path: Path) -> None:
    noted = BEAM + '[notes]\nspecimen = "beam 7"\n'
    paths = [write(tmp_path / "a.mcap", beam(), noted), write(tmp_path / "b.mcap", turned(beam()), BEAM)]
    with pytest.raises(
        ConfigurationError, match=r"a\.mcap is of beam 7, b\.mcap is of none that is named: runs of one rig"
    ):
        recorded(paths)
    assert recorded(paths[:1]).specimen == "beam 7"


@pytest.mark.parametrize(
    ("run", "scenario", "references"),
    [(beam, BEAM, ["drive.force"]), (crank, CRANK, ["crank.angle", "crank.marker"])],
    ids=["beam", "crank"],
)
def test_without_a_channel_that_tells_the_cycles_a_run_is_refused(
    log: Path, run: Callable[[], Recording], scenario: str, references: list[str]
) -> None:
    with pytest.raises(LogError, match=rf"run\.mcap: no {references[0]}; without it nobody knows the phase"):
        recorded([write(log, run(), scenario, without=references)])


def test_a_crank_without_its_encoder_is_followed_by_its_marker(tmp_path: Path) -> None:
    whole = recorded([write(tmp_path / "all.mcap", crank(), CRANK)])
    found = recorded([write(tmp_path / "fewer.mcap", crank(), CRANK, without={"crank.angle"})])
    assert "fewer.mcap: crank.marker tells the cycles in place of crank.angle" in found.remarks
    setting = found.campaign.runs[0]
    assert "crank.angle" not in setting.columns.channels
    starts = [each.campaign.runs[0].cycles_in(each.records[0]).starts(90_000) for each in (whole, found)]
    # a mark is seen to a sample, and the counter shows the last whole count
    assert np.abs(np.subtract(*starts)).max() <= 3
    # a simulated run is cut by its marker, too
    assert setting.reference == "crank.marker"
    assert np.isfinite(np.array(found.campaign.observe([Draw((), 1)])[0][0])).all()


def test_a_mark_on_a_counter_cuts_the_cycles_and_is_not_compared(tmp_path: Path) -> None:
    """Of one sample each, at twice the rate that is looked at, and between the samples that are."""
    whole = recorded([write(tmp_path / "all.mcap", crank(), CRANK)])
    channels, samples = crank()
    marker = [channel.name for channel in channels].index("crank.marker")
    high = samples[marker] > 2.5
    finer = np.repeat(samples, 2, axis=1)
    finer[marker] = 0.0
    finer[marker, 2 * np.flatnonzero(high[1:] & ~high[:-1]) + 3] = 5.0
    record = {
        "chain.crank.marker": json.dumps({"physical": "cDAQ1Mod3/ctr1", "kind": "marker"}),
        f"{RANGE}crank.marker": "5.0",
    }
    log = write(
        tmp_path / "counted.mcap",
        (channels, finer),
        CRANK.replace("25.6 kHz", "51.2 kHz"),
        without={"crank.angle"},
        rate=2 * RATE,
        record=record,
    )
    found = recorded([log])
    setting = found.campaign.runs[0]
    assert setting.columns.rate == RATE
    assert setting.reference == "crank.marker"
    assert "crank.marker" not in setting.columns.channels
    told = [remark for remark in found.remarks if "crank.marker" in remark]
    assert told == ["counted.mcap: crank.marker tells the cycles in place of crank.angle"]
    starts = [each.campaign.runs[0].cycles_in(each.records[0]).starts(90_000) for each in (whole, found)]
    assert np.abs(np.subtract(*starts)).max() <= 4
    assert np.isfinite(np.array(found.campaign.observe([Draw((), 1)])[0][0])).all()


def test_another_missing_channel_is_remarked_and_its_effects_are_no_candidates(log: Path) -> None:
    found = recorded([write(log, beam(), BEAM, without={YOKE})])
    assert found.remarks == (f"run.mcap: no {YOKE}: what only it shows cannot be found",)
    assert not [cell for cell in found.campaign.layout.cells if YOKE in (cell.channel, cell.partner)]
    assert not [cause for cause in found.campaign.causes if cause.channel == YOKE]
    assert [cause for cause in found.campaign.causes if cause.channel == UPPER]


def test_a_copy_of_a_run_is_no_second_run(tmp_path: Path) -> None:
    paths = [write(tmp_path / name, beam(), BEAM) for name in ("run.mcap", "copy.mcap")]
    with pytest.raises(ConfigurationError, match=r"copy\.mcap hold the same samples: each run once"):
        recorded(paths)


def test_a_channel_that_one_of_two_runs_lacks_is_used_in_the_other(tmp_path: Path) -> None:
    paths = [
        write(tmp_path / "all.mcap", beam(), BEAM),
        write(tmp_path / "fewer.mcap", turned(beam()), BEAM, without={YOKE}),
    ]
    found = recorded(paths)
    assert found.remarks == (f"fewer.mcap: no {YOKE}: what only it shows cannot be found",)
    assert [YOKE in run.columns.channels for run in found.campaign.runs] == [True, False]
    effects: tuple[Named, ...] = (("sensor_gain", {"channel": YOKE, "gain": 1.5}),)
    assert [cause for cause in found.campaign.causes if cause.channel == YOKE]
    assert found.campaign.observe([Draw((), 1, sensing=(effects,))])[0][0] is not None


def test_a_run_that_cannot_be_used_is_left_out_where_another_stands_in(tmp_path: Path) -> None:
    paths = [
        write(tmp_path / "short.mcap", cut(turned(beam()), 0.1), BEAM),
        write(tmp_path / "blind.mcap", turned(beam()), BEAM, without={"drive.force"}),
        write(tmp_path / "sound.mcap", beam(), BEAM),
    ]
    found = recorded(paths)
    assert found.paths == (paths[2],)
    assert len(found.campaign.runs) == len(found.scenarios) == len(found.told) == 1
    assert [remark.split(":")[0] for remark in found.remarks] == [
        "short.mcap is left out",
        "blind.mcap is left out",
    ]
    with pytest.raises(LogError, match=r"short\.mcap: .*; .*blind\.mcap: no drive\.force"):
        recorded(paths[:2])


def broken(path: Path) -> Path:
    """A run whose log has other bytes in its middle than were written."""
    content = bytearray(write(path, turned(beam()), BEAM).read_bytes())
    middle, wide = len(content) // 2, len(content) // 20  # more than one block of samples
    content[middle : middle + wide] = bytes(wide)
    path.write_bytes(content)
    return path


def no_log(path: Path) -> Path:
    path.write_bytes(b"hello")
    return path


UNREADABLE: dict[str, tuple[Callable[[Path], Path], str]] = {
    "broken log": (broken, "damaged"),
    "no log": (no_log, "not a log"),
    "declared, no samples": (
        lambda path: write(path, turned(beam()), BEAM, damage=lambda b: b if b.channel != YOKE else None),
        rf"samples of /measured/{YOKE}: none",
    ),
    "no scenario": (lambda path: write(path, turned(beam()), None), "no scenario in it"),
    "faulty scenario": (
        lambda path: write(path, turned(beam()), BEAM.replace('"9 N"', '"9 kg"')),
        r'what it says of its rig cannot be used: drive\.amplitude = "9 kg"',
    ),
}


@pytest.mark.parametrize("kind", UNREADABLE)
def test_a_run_that_cannot_be_read_is_left_out_where_another_stands_in(tmp_path: Path, kind: str) -> None:
    odd, told = UNREADABLE[kind]
    paths = [odd(tmp_path / "odd.mcap"), write(tmp_path / "sound.mcap", beam(), BEAM)]
    for given in (paths, paths[::-1]):
        found = recorded(given)
        assert found.paths == (paths[1],)
        assert len(found.remarks) == 1
        assert re.match(rf"odd\.mcap is left out: .*{told}", found.remarks[0])
        assert "\n" not in found.remarks[0]
    with pytest.raises((ConfigurationError, LogError), match=r"odd\.mcap"):
        recorded(paths[:1])


def test_where_no_run_can_be_read_each_is_told(tmp_path: Path) -> None:
    paths = [write(tmp_path / "bare.mcap", beam(), None), no_log(tmp_path / "text.mcap")]
    with pytest.raises(LogError, match=r"bare\.mcap: no scenario in it.*; .*text\.mcap: not a log"):
        recorded(paths)


@pytest.mark.parametrize("name", ["absent.mcap", "."])
def test_a_path_that_is_no_file_is_an_error_whatever_else_is_there(tmp_path: Path, name: str) -> None:
    sound = write(tmp_path / "sound.mcap", beam(), BEAM)
    with pytest.raises(LogError, match=r"No such file|a folder"):
        recorded([sound, tmp_path / name])


@pytest.mark.parametrize(
    ("damage", "channel", "lost", "cycles"),
    [
        # half of the sound cycles make a block; those that reach into a lost tenth by half are lost with it
        (dropped(UPPER, 3), UPPER, "6.7% missing", 12),
        (spoilt(YOKE, 3, 8), YOKE, "13.3% overloaded", 10),
        (spoilt(YOKE, 3, flags=Flag.OPEN_SENSOR), YOKE, "6.7% open", 12),
    ],
    ids=["gap of a channel", "overloads", "open sensor"],
)
def test_what_was_lost_is_left_out_with_a_remark(
    log: Path, damage: Damage, channel: str, lost: str, cycles: int
) -> None:
    found = recorded([write(log, beam(), BEAM, damage=damage)])
    assert found.remarks == (f"run.mcap: {channel}: {lost}; left out, in all channels",)
    assert found.campaign.runs[0].cycles == cycles
    assert len(found.measured) >= 1
    assert np.isfinite(found.measured).all()


def test_a_gap_of_all_channels_is_said_once(log: Path) -> None:
    found = recorded([write(log, beam(), BEAM, damage=dropped(None, 3))])
    assert found.remarks == ("run.mcap: all channels: 6.7% missing; left out, in all channels",)
    assert found.campaign.runs[0].cycles == 12


def test_a_channel_that_is_dead_for_most_of_the_run_takes_no_other_along(log: Path) -> None:
    def dead(block: SampleBlock) -> SampleBlock | None:
        late = block.channel == YOKE and block.first_sample >= 4 * BLOCK
        return replace(block, flags=Flag.OPEN_SENSOR) if late else block

    found = recorded([write(log, beam(), BEAM, damage=dead)])
    assert found.remarks == (f"run.mcap: {YOKE} is not used: 73% of it open",)
    assert YOKE not in found.campaign.runs[0].columns.channels


def test_a_reference_that_is_dead_is_refused(log: Path) -> None:
    with pytest.raises(LogError, match=r"100% of drive\.force overloaded; without it nobody knows the phase"):
        recorded([write(log, beam(), BEAM, damage=spoilt("drive.force", *range(15)))])


def test_what_lies_in_the_lost_part_does_not_matter(tmp_path: Path) -> None:
    wild = beam()[1][1].copy()
    wild[3 * BLOCK : 4 * BLOCK] = 1e6
    damage = spoilt(UPPER, 3)
    plain = recorded([write(tmp_path / "plain.mcap", beam(), BEAM, damage=damage)])
    odd = recorded([write(tmp_path / "odd.mcap", with_row(beam(), UPPER, wild), BEAM, damage=damage)])
    assert np.array_equal(plain.measured, odd.measured)


@pytest.mark.parametrize("seconds", [0.04, 0.12])
def test_too_few_cycles_are_refused_with_their_number(log: Path, seconds: float) -> None:
    run = write(log, cut(beam(), seconds), BEAM)
    with pytest.raises(LogError, match=r"run\.mcap: too short: [01] sound cycles .* three whole cycles"):
        recorded([run])


def test_a_run_of_nothing_but_overloads_is_refused(log: Path) -> None:
    run = write(log, beam(), BEAM, damage=lambda block: flagged(block, Flag.OVERLOAD))
    with pytest.raises(LogError, match=r"run\.mcap: 100% of drive\.force overloaded"):
        recorded([run])


def test_a_run_without_a_scenario_is_refused(log: Path) -> None:
    with pytest.raises(LogError, match=r"run\.mcap: no scenario in it"):
        recorded([write(log, beam(), None)])


def test_a_scenario_that_is_wrong_in_itself_is_refused_with_its_fault(log: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"scenario in .*run\.mcap(.|\n)*drive\.amplitude"):
        recorded([write(log, beam(), BEAM.replace('"9 N"', '"9 kg"'))])


@pytest.mark.parametrize("told", ["19 Hz", "20.1 Hz", "40 Hz"])
def test_a_scenario_of_another_drive_frequency_is_refused(log: Path, told: str) -> None:
    wrong = BEAM.replace('"20 Hz"', f'"{told}"')
    with pytest.raises(LogError, match=rf"drive\.force does not run at the scenario's {told} within 0\.1 %"):
        recorded([write(log, beam(), wrong)])


def test_a_scenario_of_another_speed_is_refused_with_the_measured_one(log: Path) -> None:
    wrong = CRANK.replace('"200 rpm"', '"210 rpm"')
    with pytest.raises(LogError, match=r"crank\.angle does not run at the scenario's 3\.5 Hz.*at 3\.33"):
        recorded([write(log, crank(), wrong)])


def test_a_channel_in_another_unit_is_not_used_unless_it_tells_the_cycles(log: Path) -> None:
    channels, samples = beam()

    def in_volts(*names: str) -> Path:
        log.unlink(missing_ok=True)
        odd = tuple(Channel(c.name, "V" if c.name in names else c.unit) for c in channels)
        return write(log, (odd, samples), BEAM)

    found = recorded([in_volts(YOKE)])
    [run] = found.campaign.runs
    assert YOKE not in run.columns.channels
    assert len(run.columns.channels) > 1
    assert "yoke.force is in V, the twin's in N: it is not used" in " ".join(found.remarks)
    with pytest.raises(LogError, match=r"drive\.force is in V, the twin's in N; without it nobody knows"):
        recorded([in_volts("drive.force")])
    with pytest.raises(LogError, match=r"drive\.force is in V.*; yoke\.force is in V"):
        recorded([in_volts(*(c.name for c in channels))])


def test_what_is_no_log_or_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_bytes(b"hello")
    with pytest.raises(LogError, match=r"text\.mcap: not a log"):
        recorded([tmp_path / "text.mcap"])
    with pytest.raises(LogError, match=r"absent\.mcap: No such file"):
        recorded([tmp_path / "absent.mcap"])


def test_a_log_that_was_cut_is_used_as_far_as_it_goes_and_said(log: Path) -> None:
    whole = recorded([write(log, beam(), BEAM)])
    content = log.read_bytes()
    log.write_bytes(content[: len(content) * 3 // 4])
    found = recorded([log])
    assert found.records[0][YOKE].size < whole.records[0][YOKE].size
    assert any("never finished, or cut" in remark for remark in found.remarks)
    assert not any("never finished" in remark for remark in whole.remarks)


def test_a_run_at_twice_the_rate_gives_the_same_numbers(tmp_path: Path) -> None:
    found = recorded([write(tmp_path / "run.mcap", beam(), BEAM)])
    channels, samples = beam()
    # a band-limited record's samples in between, as a card of twice the rate would see it
    finer = channels, signal.resample(samples, 2 * samples.shape[1], axis=1)
    text = BEAM.replace("25.6 kHz", "51.2 kHz")
    twice = recorded([write(tmp_path / "twice.mcap", finer, text, rate=2 * RATE)])
    one, other = found.campaign.runs[0], twice.campaign.runs[0]
    assert one.columns.rate == other.columns.rate == RATE
    # a low-pass at half of the band leaves half of a white noise's power
    assert one.quiet[UPPER] == 1.0
    assert other.quiet[UPPER] == pytest.approx(np.sqrt(0.5), rel=0.03)
    layout = found.campaign.layout
    energies = [layout.starts[k] + 2 for k, cell in enumerate(layout.cells) if cell.what == "energy"]
    # logarithms; filters are flat to 2e-4 below 0.4 of the rate, and cycles are cut a sample apart at most
    assert np.abs(found.measured - twice.measured)[:, energies].max() < 0.05


def test_fragments_without_a_whole_cycle_are_too_few_cycles(log: Path) -> None:
    run = write(log, crank(), CRANK, damage=spoilt("piston_frame.acceleration_y", *range(1, 40, 3)))
    with pytest.raises(LogError, match=r"run\.mcap: too short: 0 sound cycles"):
        recorded([run])


def test_less_than_a_cycle_is_too_few_cycles(log: Path) -> None:
    with pytest.raises(LogError, match=r"run\.mcap: "):
        recorded([write(log, cut(beam(), 0.01), BEAM)])


def test_a_gap_does_not_turn_the_crank(tmp_path: Path) -> None:
    whole = recorded([write(tmp_path / "whole.mcap", crank(), CRANK)])
    gappy = recorded([write(tmp_path / "gappy.mcap", crank(), CRANK, damage=dropped(None, 19))])
    layout = whole.campaign.layout
    piston = [k for k, c in enumerate(layout.cells) if c.channel == "piston_frame.acceleration_y" and c.phase]
    courses = [np.mean(each.measured, axis=0)[layout.starts[piston] + 2] for each in (whole, gappy)]
    # a tenth of the cycles is gone; the course over the phase stays where it was
    assert np.corrcoef(*courses)[0, 1] > 0.9


def test_a_scenario_of_another_amplitude_is_named(log: Path) -> None:
    found = recorded([write(log, beam(), BEAM.replace('"9 N"', '"4 N"'))])
    assert any("amplitude" in remark for remark in found.remarks)


def test_an_infinite_sample_spoils_its_cycle_only(log: Path) -> None:
    wild = beam()[1][3].copy()
    wild[10_000] = np.inf
    found = recorded([write(log, with_row(beam(), YOKE, wild), BEAM)])
    assert len(found.remarks) == 1
    assert np.isfinite(found.measured).all()


def test_an_effect_that_the_rig_cannot_have_is_no_cause_and_is_named(log: Path) -> None:
    clamped = BEAM + '\n[model]\nbeam = "aluminium"\n'
    found = recorded([write(log, recording(clamped), clamped)])
    assert "pivot_friction" not in {cause.name for cause in found.campaign.causes}
    assert any("pivot_friction was not looked for" in remark for remark in not_looked_for(found))
    assert not found.remarks  # where nothing is looked for, as in an identification, it would only puzzle


def test_runs_of_two_beams_are_no_campaign(tmp_path: Path) -> None:
    clamped = BEAM + '\n[model]\nbeam = "aluminium"\n'
    paths = [
        write(tmp_path / "steel.mcap", beam(), BEAM),
        write(tmp_path / "aluminium.mcap", recording(clamped), clamped),
    ]
    with pytest.raises(ConfigurationError, match=r"model\.beam = default in steel\.mcap, aluminium in alum"):
        recorded(paths)


def test_runs_at_two_clearances_are_one_campaign(tmp_path: Path) -> None:
    wider = BEAM + '\n[model]\nclearance = "0.254 mm"\n'
    paths = [
        write(tmp_path / "narrow.mcap", beam(), BEAM),
        write(tmp_path / "wide.mcap", recording(wider), wider),
    ]
    assert len(recorded(paths).campaign.runs) == 2


def test_a_channel_that_ends_early_is_a_loss_that_is_said(log: Path) -> None:
    def ended(block: SampleBlock) -> SampleBlock | None:
        return None if block.channel == YOKE and block.first_sample >= 8 * BLOCK else block

    assert recorded([write(log, beam(), BEAM, damage=ended)]).remarks

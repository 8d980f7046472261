"""The second measure of the gap: closed forms of its distance, and a floor that is 1 by its own members."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.blind.gap.beam import beam_features, drive_phase, whole_cycles, without_crosstalk
from benchmarks.blind.gap.crank import ACCELERATIONS, crank_features
from benchmarks.blind.gap.cycles import contacts, lag, levels, orders
from benchmarks.blind.gap.distance import Floor, energy_distances
from benchmarks.blind.gap.spatial import FORCES, marked_turns, spatial_features

RATE = 51_200.0


def _draws(seed: int, count: int, shift: float = 0.0, scale: float = 1.0) -> list[NDArray[np.float64]]:
    """Tables of 200 cycles and 6 features, each with a small offset of its own as healthy rigs have."""
    rng = np.random.default_rng(seed)
    return [
        shift + 0.1 * rng.standard_normal(6) + scale * rng.standard_normal((200, 6)) for _ in range(count)
    ]


def _gaps(
    floor: Floor, recordings: Sequence[NDArray[np.float64]], ensemble: list[NDArray[np.float64]]
) -> float:
    return float(np.mean([floor.gap(each, ensemble) for each in recordings]))


def test_distance_between_two_points_is_closed() -> None:
    # F - G is 1 over the distance a between them: the square root of 2 a.
    assert energy_distances(np.full((5, 1), 1.0), np.full((9, 1), 3.0)) == pytest.approx([2.0])


def test_distance_between_shifted_uniform_laws_is_closed() -> None:
    line = np.linspace(0, 1, 4001)[:, None]
    # F - G rises to s, stays and falls: 2 (s^2 (1 - s) + 2 s^3 / 3) for a shift s below 1.
    s = 0.25
    expected = np.sqrt(2 * (s**2 * (1 - s) + 2 * s**3 / 3))
    assert energy_distances(line, line + s) == pytest.approx([expected], rel=1e-3)  # steps of 1/4000


def test_one_more_member_has_gap_one_and_a_shift_more() -> None:
    members = _draws(1, 8)
    floor = Floor(members, [0, 0, 0, 1, 1, 1])
    # Healthy ones scatter by some 15 %, so 20 give their mean to 4 %; 8 members give the floor to 5 %.
    assert _gaps(floor, _draws(2, 20), members) == pytest.approx(1, abs=0.15)
    assert _gaps(floor, _draws(3, 20, shift=1.0), members) > 3
    assert _gaps(floor, _draws(4, 20, scale=2.0), members) > 1.5


def test_what_only_rounding_varies_does_not_make_a_gap() -> None:
    members = [np.column_stack([table, np.full(200, 5.0)]) for table in _draws(1, 8)]
    floor = Floor(members, [0] * 7)
    recording = np.column_stack([_draws(2, 1)[0], np.full(200, 5.0 + 1e-6)])
    assert floor.gap(recording, members) < 1.5


def test_phase_of_the_drive_is_found_a_little_off_its_frequency() -> None:
    times = np.arange(round(5 * RATE)) / RATE
    true = 2 * np.pi * 20.004 * times + 0.7  # 0.02 % off
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(times))
    phase = drive_phase(9 * np.sin(true) + noise, RATE, 20.0)
    apart = (phase - true + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(apart).max() < 1e-3  # 8 us of a cycle of 50 ms
    cuts = list(whole_cycles(phase))
    assert len(cuts) == 99
    assert all(abs((true[cut.start] + 1e-3) % (2 * np.pi)) < 0.01 for cut in cuts)


def test_levels_of_a_sine_lie_in_its_octave() -> None:
    cycle = 3 * np.sin(2 * np.pi * 1000 * np.arange(2560) / RATE)
    found = levels(cycle, RATE, 100.0)
    assert found["rms"] == pytest.approx(3 / np.sqrt(2), rel=1e-9)
    # One side of the spectrum: amplitude squared over four.
    assert found["band 800"] == pytest.approx(np.log10(9 / 4), abs=1e-9)
    assert found["band 400"] < -10


def test_orders_are_amplitudes() -> None:
    phase = 2 * np.pi * np.arange(1000) / 1000
    found = orders(2 * np.cos(2 * phase) - 0.5 * np.sin(phase), phase, (1, 2))
    assert found == pytest.approx({"cos 1": 0.0, "sin 1": 0.5, "cos 2": 2.0, "sin 2": 0.0}, abs=1e-9)


def test_contacts_are_counted_and_placed() -> None:
    force = np.zeros(100)
    force[20:30], force[60:65] = 5.0, 9.0
    expected = {"onsets": 2.0, "share": 0.15, "first": 0.20, "peak": 0.60}
    assert contacts(force, 1.0) == pytest.approx(expected)
    assert contacts(np.zeros(100), 1.0)["onsets"] == 0


@pytest.mark.parametrize("delay", [-1.3e-3, 0.0, 4.4e-5])
def test_lag_is_found_between_samples(delay: float) -> None:
    times = np.arange(2560) / RATE
    pulses = [np.exp(-(((times - at) / 3e-4) ** 2)) for at in (0.02, 0.02 + delay)]
    assert lag(pulses[0], pulses[1], RATE) == pytest.approx(delay, abs=0.02 / RATE)


def test_healthy_crosstalk_is_taken_out_of_the_base_and_no_more() -> None:
    rng = np.random.default_rng(5)
    contact = np.maximum(rng.standard_normal(20_000), 0) * 30
    noise = 0.03 * rng.standard_normal(20_000)
    channels = {"contact.force_upper": contact, "contact.force_lower": np.zeros(20_000)}
    rest = without_crosstalk({**channels, "base.acceleration": noise + 8e-4 * contact})
    # The slope is known to 0.03 / (21 N sqrt(20 000)) = 1e-5.
    assert np.abs(rest - noise).max() < 5e-5 * contact.max()
    shaken = without_crosstalk({**channels, "base.acceleration": noise + 0.1 * contact})
    assert shaken == pytest.approx(noise + 0.099 * contact)


def _marked(rate: float, late: float = 0.0) -> dict[str, NDArray[np.float64]]:
    """Ten and a half turns at 4 Hz, a contact of 10 N in the fifth tenth of each; the mark `late` s."""
    rng = np.random.default_rng(8)
    turn = 4.0 * (np.arange(round(2.625 * rate)) + 0.5) / rate  # no edge on a sample
    share = np.mod(turn, 1.0)
    force = np.where((share > 0.4) & (share < 0.5), 10.0, 0.0) + 0.05 * rng.standard_normal(len(turn))
    mark = np.where(np.mod(turn - 4.0 * late, 1.0) < 5 / 360, 5.0, 0.0)
    return {
        **dict.fromkeys(FORCES, force),
        "motor.tachometer": np.full(len(turn), 25.0),
        "flywheel.marker": mark,
    }


def test_turns_of_the_spatial_crank_go_from_mark_to_mark() -> None:
    channels = _marked(25_600.0, late=0.01)
    turns = list(marked_turns(channels["flywheel.marker"]))
    assert len(turns) == 10
    assert {cut.stop - cut.start for cut in turns} == {6400}
    assert turns[0].start == 256


def test_a_late_mark_shows_as_an_earlier_contact() -> None:
    (_, on_time, *_), (_, late, *_) = (
        spatial_features(_marked(25_600.0, late), 25_600.0, 0.0) for late in (0.0, 2e-3)
    )
    assert on_time["socket.force"]["first"] == pytest.approx(0.4, abs=2e-4)
    # 2 ms of a turn of 250 ms; half a sample
    assert late["socket.force"]["first"] == pytest.approx(0.4 - 0.008, abs=2e-4)
    assert on_time["socket.force"]["onsets"] == 1
    # what lies between the channels is the same
    assert late["timing"] == pytest.approx(on_time["timing"], abs=1e-6)


def test_what_was_not_recorded_tells_nothing() -> None:
    every = _marked(25_600.0)
    (_, turn, *_) = spatial_features(every, 25_600.0, 0.0)
    fewer = {name: each for name, each in every.items() if name not in ("socket.force", "motor.tachometer")}
    (_, without, *_) = spatial_features(fewer, 25_600.0, 0.0)
    assert turn.keys() - without.keys() == {"socket.force", "motor.tachometer"}
    assert {name for name in turn["timing"] if not name.startswith("socket")} == without["timing"].keys()


def test_the_base_tells_nothing_without_the_forces_whose_cross_talk_it_has() -> None:
    times = np.arange(round(0.5 * RATE)) / RATE
    drive = 9 * np.sin(2 * np.pi * 20 * times)
    every = {
        "drive.force": drive,
        "contact.force_upper": np.maximum(drive - 8, 0),
        "contact.force_lower": np.maximum(-drive - 8, 0),
        "yoke.force": drive,
        "base.acceleration": 1e-4 * drive,
    }
    fewer = {name: each for name, each in every.items() if name != "contact.force_lower"}
    (all_told, *_), (told, *_) = (beam_features(channels, RATE, 20.0) for channels in (every, fewer))
    assert told.keys() == all_told.keys() - {"contact.force_lower", "base.acceleration"}
    assert set(told["timing"]) == {"contact.force_upper to yoke"}


def test_the_mark_cuts_the_planar_cranks_turns_where_no_angle_does() -> None:
    rate, rng = 25_600.0, np.random.default_rng(2)
    angle = 2 * np.pi * 4.0 * (np.arange(round(2.625 * rate)) + 0.5) / rate
    every = {
        **{name: rng.standard_normal(len(angle)) for name in ACCELERATIONS},
        "crank.angle": angle,
        "crank.marker": np.where(np.mod(angle, 2 * np.pi) < np.radians(5), 5.0, 0.0),
    }
    without = {name: each for name, each in every.items() if name not in ("crank.angle", ACCELERATIONS[2])}
    turns, by_mark = (crank_features(channels, rate, 0.0) for channels in (every, without))
    assert len(turns) == len(by_mark) == 9
    assert by_mark[3]["turn"] == {"speed": turns[3]["turn"]["speed"]} == {"speed": pytest.approx(4.0)}
    assert by_mark[3]["timing"].keys() < turns[3]["timing"].keys()
    # the same turn: what is told of a channel by its angle is told by the mark as well
    assert by_mark[3][ACCELERATIONS[0]] == pytest.approx(turns[3][ACCELERATIONS[0]], abs=2e-3)

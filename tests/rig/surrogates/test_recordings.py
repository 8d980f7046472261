"""The recordings that surrogates are judged on: made once, on one rig, and gone on with after a stop."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from daq.clock import SystemClock
from rig.files.scenario import parse_scenario
from rig.session.progress import Screen, Terminal
from rig.session.run import RunRequest
from rig.surrogates import recordings
from rig.surrogates.recordings import ALL, PAPER, QUICK_SECONDS, SECONDS, SEED, Setting, log_of, recorded
from rig.twin.recorded_samples import RIG
from tests.rig.surrogates.crank_logs import write_log, write_recordings


class Bench:
    """Records at once, and notes what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __call__(self, request: RunRequest, screen: Screen, clock: SystemClock) -> Path:
        assert request.bench.emulation.seed == SEED
        self.asked.append(request.scenario.name)
        setting = next(each for each in ALL if each.name == request.scenario.name)
        request.folder.mkdir(parents=True)
        return write_log(request.folder / "run.mcap", setting, QUICK_SECONDS)


def made(folder: Path, bench: Bench, settings: tuple[Setting, ...] = PAPER[:3]) -> dict[Setting, Path]:
    def connect(*_: object) -> None:
        raise AssertionError("no bench in this test")

    return recorded(settings, folder, QUICK_SECONDS, connect, Screen(Terminal()), SystemClock(), bench)  # type: ignore[arg-type]


def test_what_is_recorded_is_not_recorded_again(tmp_path: Path) -> None:
    bench = Bench()
    first = made(tmp_path, bench, PAPER[:2])
    assert bench.asked == [each.name for each in PAPER[:2]]
    assert {**made(tmp_path, bench), **first} == made(tmp_path, bench)
    assert bench.asked == [each.name for each in PAPER[:3]]


def test_a_log_that_was_cut_short_counts_for_nothing(tmp_path: Path) -> None:
    (path,) = write_recordings(tmp_path, PAPER[:1], QUICK_SECONDS)
    assert log_of(tmp_path, PAPER[0], QUICK_SECONDS) == path
    path.write_bytes(path.read_bytes()[:-1000])
    assert log_of(tmp_path, PAPER[0], QUICK_SECONDS) is None
    path.write_bytes(b"not a log")
    assert log_of(tmp_path, PAPER[0], QUICK_SECONDS) is None


def test_a_log_of_another_bench_counts_for_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_recordings(tmp_path, PAPER[:1], QUICK_SECONDS)
    monkeypatch.setattr(recordings, "SEED", SEED + 1)  # another rig
    assert log_of(tmp_path, PAPER[0], QUICK_SECONDS) is None
    monkeypatch.setattr(recordings, "SEED", SEED)
    assert log_of(tmp_path, PAPER[0], QUICK_SECONDS) is not None
    bench = recordings.embedded_bench(RIG)
    monkeypatch.setattr(recordings, "embedded_bench", lambda _: replace(bench, text=bench.text + "# new"))
    assert log_of(tmp_path, PAPER[0], QUICK_SECONDS) is None


def test_a_short_recording_is_none_for_the_full_version(tmp_path: Path) -> None:
    (path,) = write_recordings(tmp_path, PAPER[:1], QUICK_SECONDS)
    assert log_of(tmp_path, PAPER[0], SECONDS) is None
    assert log_of(tmp_path, PAPER[1], QUICK_SECONDS) is None
    assert path.is_file()


@pytest.mark.parametrize("setting", ALL, ids=lambda each: each.name)
def test_a_setting_is_a_sound_scenario(setting: Setting) -> None:
    scenario = parse_scenario(setting.scenario(SECONDS))
    assert scenario.model["clearance_2"] == pytest.approx(1e-3 * setting.clearance_2)
    assert scenario.drive.speed == pytest.approx(setting.speed * 2 * 3.141592653589793 / 60)

"""What work took is kept, and says what the next one of its kind takes."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

from rig.session.pace import PACES, Paces, Work, lasting


@pytest.fixture
def paces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Paces:
    monkeypatch.setenv(PACES, "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    # work here is shorter than any kernel has been on the disk
    monkeypatch.setattr("rig.session.pace._PROJECT", tmp_path)
    return Paces()


def kept(paces: Paces, *took: tuple[float, float]) -> Paces:
    for units, seconds in took:
        paces.took(Work("predict", units), seconds)
    return Paces()  # another command


def test_what_was_never_done_nobody_knows(paces: Paces) -> None:
    assert paces.expected_s(Work("predict", 10.0)) is None
    assert kept(paces, (10.0, 5.0)).expected_s(Work("overlay", 10.0)) is None


def test_one_work_tells_of_another_by_its_size(paces: Paces) -> None:
    assert kept(paces, (10.0, 5.0)).expected_s(Work("predict", 40.0)) == pytest.approx(20.0)


def test_what_every_work_takes_however_small_is_told_apart(paces: Paces) -> None:
    """Processes that start first, say, for 4 s."""
    took = [(10.0, 4.0 + 1.0), (100.0, 4.0 + 10.0)]
    assert kept(paces, *took).expected_s(Work("predict", 50.0)) == pytest.approx(4.0 + 5.0)


def test_works_of_about_one_size_tell_nothing_of_others_but_their_ratio(paces: Paces) -> None:
    assert kept(paces, (10.0, 5.0), (10.1, 5.01)).expected_s(Work("predict", 100.0)) == pytest.approx(
        50.0, rel=0.01
    )


def test_a_work_that_was_disturbed_moves_nothing_and_a_slower_machine_is_learnt(paces: Paces) -> None:
    assert kept(paces, *[(10.0, 5.0)] * 3, (10.0, 60.0)).expected_s(Work("predict", 10.0)) == 5.0
    assert kept(paces, *[(10.0, 15.0)] * 8).expected_s(Work("predict", 10.0)) == 15.0


def test_what_compiled_tells_nothing_of_what_need_not(
    paces: Paces, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = tmp_path / "sim_twin" / "__pycache__" / "kernel.nbi"
    index.parent.mkdir(parents=True)
    index.touch()
    assert kept(paces, (10.0, 50.0)).expected_s(Work("predict", 10.0)) is None
    long_ago = time.time() - 3600.0
    os.utime(index, (long_ago, long_ago))
    assert kept(paces, (10.0, 5.0)).expected_s(Work("predict", 10.0)) == 5.0


@pytest.mark.parametrize(
    "content", ["", "[]", "{", '{"predict": 3}', '{"predict": [[1]]}', '{"predict": [[0, 0]]}']
)
def test_a_damaged_file_is_as_good_as_none(paces: Paces, tmp_path: Path, content: str) -> None:
    file = tmp_path / "cache" / "rattle" / "paces.json"
    file.parent.mkdir(parents=True)
    file.write_text(content)
    assert Paces().expected_s(Work("predict", 10.0)) is None
    assert kept(paces, (10.0, 5.0)).expected_s(Work("predict", 10.0)) == 5.0


def test_a_place_that_cannot_be_written_keeps_nothing_and_ends_nothing(
    paces: Paces, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    assert kept(Paces(), (10.0, 5.0)).expected_s(Work("predict", 10.0)) is None


def test_a_user_without_a_home_keeps_nothing(paces: Paces, monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("could not determine home directory")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    assert kept(Paces(), (10.0, 5.0)).expected_s(Work("predict", 10.0)) is None


def test_nothing_is_kept_where_the_environment_says_so(
    paces: Paces, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PACES, "0")
    assert kept(Paces(), (10.0, 5.0)).expected_s(Work("predict", 10.0)) is None
    assert not (tmp_path / "cache").exists()


def test_the_file_holds_the_last_of_each_kind(paces: Paces, tmp_path: Path) -> None:
    kept(paces, *[(float(size), 1.0) for size in range(1, 20)])
    content = json.loads((tmp_path / "cache" / "rattle" / "paces.json").read_text())
    assert [size for size, _ in content["predict"]] == [float(size) for size in range(12, 20)]
    assert [file.name for file in (tmp_path / "cache" / "rattle").iterdir()] == ["paces.json"]


def test_a_time_to_wait_in_words() -> None:
    assert [lasting(seconds) for seconds in (4.4, 119.7, 3661.0)] == ["4 s", "2 min 0 s", "1 h 1 min"]

"""What is written beside logs is whole at every moment, whatever call fails."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from daq.disk import make_folder, write_whole
from daq.errors import RecorderFailed
from daq.log.reader import LogReader
from daq.log.writer import LogWriter


@pytest.mark.parametrize(
    ("place", "call", "nth"), [(Path, "open", 1), (os, "fsync", 1), (Path, "replace", 1), (os, "fsync", 2)]
)
def test_whatever_call_fails_it_is_one_error_and_nothing_is_half(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: object, call: str, nth: int
) -> None:
    """The old one or the new one; the last is that of the folder, where the new one is there already."""
    path, count, real = tmp_path / "sweep.json", 0, getattr(place, call)
    write_whole(path, b"old")

    def failing(*arguments: object, **options: object) -> object:
        nonlocal count
        count += 1
        if count == nth:
            raise OSError(errno.EIO, "Input/output error")
        return real(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(place, call, failing)
        with pytest.raises(RecorderFailed, match=rf"^cannot write {path}: Input/output error$"):
            write_whole(path, b"new")
    assert path.read_bytes() == (b"new" if nth == 2 else b"old")
    assert list(tmp_path.iterdir()) == [path]
    write_whole(path, b"newer")
    assert path.read_bytes() == b"newer"


def test_what_is_replaced_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_bytes(b"old")
    path.chmod(0o640)
    write_whole(path, b"new")
    assert path.stat().st_mode & 0o777 == 0o640


def test_the_name_of_each_folder_that_is_made_comes_to_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced, real = list[str](), os.fsync

    def noting(descriptor: int) -> None:
        synced.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", noting)
    make_folder(tmp_path / "lab" / "runs")
    assert synced == [str(tmp_path / "lab"), str(tmp_path)]
    make_folder(tmp_path / "lab" / "runs")
    assert len(synced) == 2


def test_a_folder_into_which_one_may_not_look_takes_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.open

    def open_no_folder(path: object, flags: int, *more: int) -> int:
        if path == tmp_path and flags == os.O_RDONLY:
            raise PermissionError(errno.EACCES, "Permission denied")
        return real(path, flags, *more)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "open", open_no_folder)
    write_whole(tmp_path / "sweep.json", b"new")
    assert (tmp_path / "sweep.json").read_bytes() == b"new"
    with LogWriter(tmp_path / "log.mcap") as log:
        log.add_metadata("scenario", {"toml": "x = 1"})
        log.sync()
    with LogReader(tmp_path / "log.mcap") as saved:
        assert saved.complete

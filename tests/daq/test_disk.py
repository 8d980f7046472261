"""What a sweep writes beside its logs is whole at every moment, whatever call fails."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from daq.errors import RecorderFailed
from daq.log.writer import write_whole


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

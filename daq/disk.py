"""Files and folders that are there after a loss of power, or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from daq.errors import RecorderFailed


def sync_folder(folder: Path) -> None:
    """Bring the names of its files to the disk, if one may look into it; raises OSError."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:  # where one may put things and not look
        return
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Make a folder, and those that it is in, and bring their names to the disk; raises OSError."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for made in missing:
        sync_folder(made.parent)


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file so that it is never half there, not even when the power fails; it keeps its mode."""
    unfinished = path.with_name(f".{path.name}.new")
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            with suppress(OSError):  # a new one has that of any other
                unfinished.chmod(path.stat().st_mode)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        raise RecorderFailed(f"cannot write {path}: {error.strerror}") from error

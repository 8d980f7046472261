"""Whether what a command makes can be kept, asked before it does anything."""

from pathlib import Path
from tempfile import TemporaryFile

from daq.errors import RattleError


def check_out(folder: Path) -> None:
    """Raise RattleError where a folder cannot be written, or made; it is made where something goes in."""
    for there in (folder.absolute(), *folder.absolute().parents):
        try:
            with TemporaryFile(dir=there):
                return
        except OSError as error:
            if there.is_file():
                raise RattleError(f"{there} is a file; name a folder") from error
            if not isinstance(error, FileNotFoundError | NotADirectoryError) or there.exists():
                raise RattleError(f"cannot write to {there}: {error.strerror}") from error


def require_new(out: Path, done: str) -> None:
    """Refuse a file that is there already, or cannot be written, before something is `done` for it."""
    if out.exists():
        raise RattleError(f"{out} is there already; remove it or name another, nothing was {done}")
    if not out.resolve().parent.is_dir():
        raise RattleError(f"{out.parent}: no such folder; nothing was {done}")
    check_out(out.parent)

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

"""Where the user's cache is, in which everything may be lost."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """The folder for what can be computed or measured again; need not exist, nor keep anything."""
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "rattle"
    try:
        return Path.home() / ".cache" / "rattle"
    except RuntimeError:  # a user whom the machine does not know
        return Path(os.devnull) / "rattle"

"""Which program wrote a log: its version, and the commit that it was run from."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Final

_PATIENCE_S: Final = 2.0
_ROOT: Final = Path(__file__).parents[2]


@cache
def software() -> dict[str, str]:
    """`software` and, where it is known, `commit`: what a log's `run` record says of its writer."""
    commit = commit_of(_ROOT) or _installed_commit()
    return {"software": f"rattle {version('rattle')}"} | ({"commit": commit} if commit else {})


def commit_of(root: Path, besides: Path | None = None) -> str:
    """The commit of a working tree with the root of this name, and whether it was changed; empty for none.

    A file `besides` may be changed.
    """
    git = shutil.which("git")
    if git is None or not (root / ".git").exists():
        return ""

    def told(*asked: str) -> str:
        command = [git, "--no-optional-locks", "-C", str(root), *asked]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=True)  # noqa: S603
        return done.stdout.strip()

    try:
        left_out = [f":!{besides.relative_to(root)}"] if besides else []
        changed = told("status", "--porcelain", "--untracked-files=no", "--", ".", *left_out)
        return told("rev-parse", "HEAD") + (", changed since" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return ""


def _installed_commit() -> str:
    """Of a package that pip took from a repository (PEP 610)."""
    try:
        told = json.loads(distribution("rattle").read_text("direct_url.json") or "{}")
        return str(told.get("vcs_info", {}).get("commit_id", ""))
    except (PackageNotFoundError, OSError, ValueError, AttributeError):
        return ""

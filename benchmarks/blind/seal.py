"""Answers are written and hashed before anything is diagnosed, and only opened again to be scored."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from benchmarks.blind.campaigns import Campaign

_DIGEST = "answers.sha256"


class SealBroken(ValueError):
    """The answers are not those that were hashed."""


def answers_file(folder: Path) -> Path:
    """Where the answers of a check lie."""
    return folder / "sealed" / "answers.json"


def seal(folder: Path, campaigns: Sequence[Campaign]) -> str:
    """Write the answers and, beside them, their SHA-256; returns it.

    Raises SealBroken where other answers are sealed in `folder` already.
    """
    file = answers_file(folder)
    text = json.dumps([campaign.as_json() for campaign in campaigns], indent=1)
    digest = _sha256(text)
    if file.exists() and _sha256(file.read_text()) != digest:
        raise SealBroken(f"{folder} holds other campaigns already; name another folder")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    (folder / _DIGEST).write_text(f"{digest}  {file.relative_to(folder)}\n")
    return digest


def unseal(folder: Path) -> tuple[Campaign, ...]:
    """Read the answers; raises SealBroken if their hash is not the one of when they were made."""
    text = answers_file(folder).read_text()
    expected = (folder / _DIGEST).read_text().split()[0]
    if _sha256(text) != expected:
        raise SealBroken(f"{answers_file(folder)} has changed: {_sha256(text)}, sealed as {expected}")
    return tuple(Campaign.from_json(each) for each in json.loads(text))


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

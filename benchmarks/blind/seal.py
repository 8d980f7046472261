"""Answers are written and hashed before anything is diagnosed, and only opened again to be scored.

The program is frozen before they are drawn: what it was then is sealed with them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.runner import program_digest
from benchmarks.kept_results import commit

_DIGEST = "answers.sha256"


class SealBroken(ValueError):
    """The answers are not those that were hashed."""


@dataclass(frozen=True, slots=True)
class Frozen:
    """The program before the draw: its commit ("+": files differ from it), its source's digest, the seed."""

    commit: str
    program_sha256: str
    seed: int


def answers_file(folder: Path) -> Path:
    """Where the answers of a check lie."""
    return folder / "sealed" / "answers.json"


def sealed(folder: Path, seed: int, draw: Callable[[int], Sequence[Campaign]]) -> tuple[Campaign, ...]:
    """The campaigns of a folder: sealed already with this seed, or drawn now, after the program is noted.

    Raises SealBroken where campaigns of another seed are sealed there, or the answers have changed.
    """
    if not answers_file(folder).exists():
        frozen = Frozen(commit(), program_digest(), seed)
        campaigns = draw(seed)
        print(f"answers sealed: sha256 {seal(folder, campaigns, frozen)}, commit {frozen.commit}", flush=True)
    elif frozen_of(folder).seed != seed:
        raise SealBroken(f"{folder} holds campaigns of another seed already; name another folder")
    return unseal(folder)


def seal(folder: Path, campaigns: Sequence[Campaign], frozen: Frozen) -> str:
    """Write the answers with the program that they are for and, beside them, their SHA-256; returns it.

    Raises SealBroken where other answers are sealed in `folder` already.
    """
    file = answers_file(folder)
    content = {"frozen": asdict(frozen), "campaigns": [campaign.as_json() for campaign in campaigns]}
    text = json.dumps(content, indent=1)
    digest = _sha256(text)
    if file.exists() and _sha256(file.read_text()) != digest:
        raise SealBroken(f"{folder} holds other campaigns already; name another folder")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    (folder / _DIGEST).write_text(f"{digest}  {file.relative_to(folder)}\n")
    return digest


def unseal(folder: Path) -> tuple[Campaign, ...]:
    """Read the answers; raises SealBroken if their hash is not the one of when they were made."""
    return tuple(Campaign.from_json(each) for each in json.loads(_opened(folder))["campaigns"])


def frozen_of(folder: Path) -> Frozen:
    """The program that the answers were drawn for; raises SealBroken like `unseal`."""
    return Frozen(**json.loads(_opened(folder))["frozen"])


def _opened(folder: Path) -> str:
    text = answers_file(folder).read_text()
    expected = (folder / _DIGEST).read_text().split()[0]
    if _sha256(text) != expected:
        raise SealBroken(f"{answers_file(folder)} has changed: {_sha256(text)}, sealed as {expected}")
    return text


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

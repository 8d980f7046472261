"""What a score needs of each campaign, kept as files, so that parts of a check on several machines add up."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.runner import CALIBRATED, cost_of
from benchmarks.kept_results import Results

_READ = frozenset(("verdict_probability", "selected", "gap", "cost", "remarks"))
_OF_EFFECTS = frozenset(("name", "location", "probability", "parameters", "shrink", "indistinguishable_from"))
"""What `answer_of` reads of a diagnosis, and of each effect in it; and whether it was cut short."""
_LAST_WORDS = 2000


def keep(folder: Path, seed: int, campaign: Campaign, results: Results) -> None:
    """Keep the answers of a campaign of a check with this seed, their costs and gaps.

    Raises ValueError for answers of another program, which lie in a folder that it was begun in.
    """
    names = [f"{campaign.name}{look}" for look in ("", CALIBRATED)]
    costs = {name: cost for name in names if (cost := cost_of(folder, name))}
    if any(cost.program_sha256 != results.digest for cost in costs.values()):
        raise ValueError(f"{folder} holds answers of another program: name another folder")
    files = [file for name in costs for file in (folder / "diagnoses" / name).glob("*.json")]
    files += (folder / "gaps").glob(f"{campaign.name}*.json")
    told = {str(file.relative_to(folder)): _read_of(file) for file in sorted(files)}
    for name, cost in costs.items():
        output = folder / "diagnoses" / name / "output.txt"
        if cost.exit_code != 0 and output.exists():
            told[str(output.relative_to(folder))] = output.read_text()[-_LAST_WORDS:]
    results.keep(_name(seed, campaign), {"campaign": _digest(campaign), "files": told})


def restore(folder: Path, seed: int, campaign: Campaign, results: Results) -> bool:
    """Put what was kept where a score looks for it; returns whether anything was, of this very campaign."""
    found = results.found(_name(seed, campaign))
    if found is None or found["campaign"] != _digest(campaign):
        return False
    for name, text in found["files"].items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return True


def _name(seed: int, campaign: Campaign) -> str:
    return f"seed_{seed}_{campaign.name}"


def _digest(campaign: Campaign) -> str:
    return hashlib.sha256(json.dumps(campaign.as_json(), sort_keys=True).encode()).hexdigest()


def _read_of(file: Path) -> str:
    """Its text; of a diagnosis what is read of it."""
    if file.name != "diagnosis.json":
        return file.read_text()
    told = json.loads(file.read_text())
    effects = [{key: each[key] for key in _OF_EFFECTS & each.keys()} for each in told["effects"]]
    return json.dumps({key: told[key] for key in _READ & told.keys()} | {"effects": effects})

"""Models of healthy rigs, made by `rattle calibrate` as a lab would: of its rigs, then of the one at hand.

Which healthy runs belong to which campaign is no secret and lies in a file of its own.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.blind.campaigns import Campaign, references_of
from benchmarks.blind.command import rattle

_USUAL_RIGS, _FEWEST_RIGS = 400, 100
_LONGEST_S = 3600.0


@dataclass(frozen=True, slots=True)
class Reference:
    """Healthy runs of a campaign's lab, each of another rig, and the one of the campaign's own rig."""

    lab: tuple[str, ...]
    same_rig: str


def write_references(folder: Path, campaigns: Sequence[Campaign]) -> None:
    """Write which healthy runs there are for each campaign."""
    told = {}
    for campaign in campaigns:
        if campaign.lab and campaign.kind != "reference":
            names = [each.name for each in references_of(campaigns, [campaign])]
            lab = tuple(name for name in names if name != campaign.same_rig)
            told[campaign.name] = asdict(Reference(lab, campaign.same_rig))
    _file(folder).write_text(json.dumps(told, indent=1))


def references(folder: Path) -> dict[str, Reference]:
    """The healthy runs for each campaign that has some."""
    told = json.loads(_file(folder).read_text()) if _file(folder).exists() else {}
    return {name: Reference(tuple(each["lab"]), each["same_rig"]) for name, each in told.items()}


def model_of(folder: Path, reference: Reference, effort: float = 1.0) -> Path | None:
    """The model of a campaign's rig, calibrated if it is not yet; None where that failed.

    At another `effort` so many times the usual number of rigs are simulated.
    """
    rigs = () if effort == 1.0 else ("--rigs", str(max(_FEWEST_RIGS, round(effort * _USUAL_RIGS))))
    lab = _calibrated(folder, reference.lab[0], reference.lab, ("--spread", *rigs))
    if lab is None:
        return None
    known = ("--model", str(lab), "--known-healthy")
    return _calibrated(folder, reference.same_rig, (reference.same_rig,), (*known, *rigs))


def logs_of(folder: Path, name: str) -> list[Path]:
    """The logs of a campaign, in the order of its runs."""
    return sorted((folder / "logs" / name).glob("*.mcap"))


def _calibrated(folder: Path, name: str, runs: Sequence[str], options: Sequence[str]) -> Path | None:
    model, done = (folder / "models" / f"{name}{end}" for end in (".toml", ".json"))
    if not done.exists():
        done.parent.mkdir(parents=True, exist_ok=True)
        began = time.monotonic()
        logs = [str(log) for run in runs for log in logs_of(folder, run)]
        cost = rattle(("calibrate", *logs, *options, "-o", str(model)), done.with_suffix(".txt"), _LONGEST_S)
        if cost.exit_code is not None and cost.exit_code < 0:
            raise RuntimeError(f"the calibration of {name} was ended by signal {-cost.exit_code}")
        done.write_text(json.dumps(asdict(cost)))
        state = "" if cost.exit_code == 0 else f"  FAILED (exit code {cost.exit_code})"
        print(f"calibrated by {', '.join(runs)}: {time.monotonic() - began:.0f} s{state}", flush=True)
    return model if model.exists() else None


def _file(folder: Path) -> Path:
    return folder / "references.json"

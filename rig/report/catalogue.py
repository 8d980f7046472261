"""The runs of a folder: what each was, its tags, and two of them side by side."""

from __future__ import annotations

import fnmatch
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from daq.disk import write_whole
from daq.errors import ConfigurationError, LogError, Problem
from daq.log.reader import LogReader, Origin
from rig.report.record import RunRecord, scenario_facts
from rig.report.summary import distance_to

TAGS: Final = "tags.json"
"""Beside the logs: their tags by the names of their files; no log is written to."""


@dataclass(frozen=True, slots=True)
class Run:
    """A log as a catalogue has it.

    `facts` are what it can be chosen by: rig, name, started, the keys of its scenario, notes by their own
    keys, and what its `run` record says. `damage` is why it cannot be read, empty where it can.
    """

    path: Path
    started: str
    name: str
    notes: Mapping[str, str]
    tags: tuple[str, ...]
    facts: Mapping[str, str]
    damage: str = ""

    def fits(self, wanted: Mapping[str, str]) -> bool:
        """Whether each fact is as wanted, where * stands for anything and case does not matter."""
        return all(_like(self.facts.get(key, ""), pattern) for key, pattern in wanted.items())


def runs_in(paths: Iterable[Path]) -> list[Run]:
    """The logs that are named, and those in folders that are, a sweep's points too; oldest first."""
    found: list[Run] = []
    for path in paths:
        logs = sorted(path.rglob("*.mcap")) if path.is_dir() else [path]
        found += [_entry(log, tags_of(log)) for log in logs]
    return sorted(found, key=lambda run: (run.started, run.path))


def tags_of(log: Path) -> tuple[str, ...]:
    """The tags of a log; raises like `tag`."""
    return tuple(_all_tags(log.parent).get(log.name, ()))


def tag(log: Path, add: Iterable[str] = (), drop: Iterable[str] = ()) -> tuple[str, ...]:
    """Give a log tags, or take some; returns what it has then.

    Raises ConfigurationError where those of its folder cannot be read, OSError where they cannot be kept.
    """
    tags = _all_tags(log.parent)
    kept = tuple(each for each in dict.fromkeys([*tags.get(log.name, ()), *add]) if each not in {*drop})
    tags[log.name] = list(kept)
    told = {name: each for name, each in sorted(tags.items()) if each}
    write_whole(log.parent / TAGS, json.dumps(told, indent=1, ensure_ascii=False).encode() + b"\n")
    return kept


def differences(one: Run, other: Run) -> list[tuple[str, str, str]]:
    """What was not the same in two runs: key, of the one, of the other."""
    keys = dict.fromkeys([*one.facts, *other.facts])
    both = [(key, one.facts.get(key, ""), other.facts.get(key, "")) for key in keys]
    return [each for each in both if each[1] != each[2] and each[0] not in ("id", "started", "tags")]


def side_by_side(one: RunRecord, other: RunRecord) -> RunRecord:
    """One run's measurement with the other's in place of the prediction, in what both measured.

    Raises ConfigurationError for runs of different rigs, or without a channel in common.
    """
    rigs = [run.facts.rig for run in (one, other)]
    common = [name for name in one.channels if name in one.measured and name in other.measured]
    if rigs[0] != rigs[1] or not common:
        said = f"{rigs[0] or 'no rig'} and {rigs[1] or 'no rig'}"
        allowed = "two runs of one rig with a channel in common"
        raise ConfigurationError("rattle runs --compare", [Problem("rig", said, allowed)])
    pair: tuple[tuple[Origin, RunRecord], ...] = (("measured", one), ("predicted", other))
    return replace(
        one,
        channels={name: one.channels[name] for name in common},
        traces={
            (origin, name): run.traces["measured", name]
            for origin, run in pair
            for name in common
            if ("measured", name) in run.traces
        },
        tallies={(origin, name): run.tallies["measured", name] for origin, run in pair for name in common},
        impacts=[
            replace(impact, origin=origin)
            for origin, run in pair
            for impact in run.impacts
            if impact.origin == "measured" and impact.channel in common
        ],
        speeds={origin: run.speeds["measured"] for origin, run in pair if "measured" in run.speeds},
        gaps=[*one.gaps, *other.gaps],
        verdict=None,
        names={"measured": "first", "predicted": "second"},
    )


def apart_db(both: RunRecord) -> tuple[float, float]:
    """How far the autospectra of two runs lie apart, and those of the first one's own halves, in dB."""
    return distance_to(both, "predicted")


def _entry(log: Path, tags: tuple[str, ...]) -> Run:
    try:
        with LogReader(log) as reader:
            facts, told = scenario_facts(reader.scenario), reader.metadata.get("run", {})
    except LogError as error:
        return Run(log, "", log.stem, {}, tags, {"tags": " ".join(tags)}, str(error))
    identity = {key: value for key, value in told.items() if "." not in key}
    known = {"name": facts.name, "rig": facts.rig, **facts.settings, **identity, **facts.notes}
    return Run(log, told.get("started", ""), facts.name, facts.notes, tags, {**known, "tags": " ".join(tags)})


def _all_tags(folder: Path) -> dict[str, list[str]]:
    """By the names of files; raises ConfigurationError for a file that says something else."""
    file = folder / TAGS
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        return {str(name): [str(tag) for tag in each] for name, each in told.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, AttributeError, TypeError) as error:
        allowed = 'what rattle runs --tag wrote: {"RUN.mcap": ["tag", ...]}; mend or delete it'
        raise ConfigurationError(str(file), [Problem("tags", str(error), allowed)]) from error


def _like(said: str, pattern: str) -> bool:
    return fnmatch.fnmatchcase(said.casefold(), pattern.casefold())

"""What of a recording cannot be used, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock
from daq.errors import LogError
from daq.log.reader import LogReader

_SPOILT = {Flag.OVERLOAD: "overloaded", Flag.OPEN_SENSOR: "open", Flag.NOT_FINITE: "not finite"}
_MISSING = "missing"
_MOSTLY = 0.5
"""Share of a channel that cannot be used, from which on the channel is left out instead of its time."""


@dataclass(frozen=True, slots=True)
class Lossy:
    """A channel's samples; `lost`, shape (n,), says which of them cannot be used, `why` in words."""

    series: SampleBlock
    lost: NDArray[np.bool_]
    why: tuple[str, ...]


def lost_of(log: LogReader, table: Mapping[str, SampleBlock]) -> dict[str, Lossy]:
    """What is lost of each channel: missing, flagged or not finite."""
    lost = {name: ~np.isfinite(series.values) for name, series in table.items()}
    why: dict[str, list[str]] = {name: [_MISSING] if lost[name].any() else [] for name in table}
    for _, block in log.blocks("measured", list(table)):
        first = table[block.channel].first_sample
        here = slice(max(block.first_sample - first, 0), max(block.end_sample - first, 0))
        for flag, word in _SPOILT.items():
            if block.flags & flag:
                lost[block.channel][here] = True
                why[block.channel].append(word)
    return {name: Lossy(table[name], lost[name], tuple(dict.fromkeys(why[name]))) for name in table}


def usable(
    path: Path, lost: Mapping[str, Lossy], reference: str
) -> tuple[dict[str, SampleBlock], NDArray[np.bool_], tuple[str, ...]]:
    """The channels that can be used, which samples of the `span` they share, shape (n,), and what is lost.

    A channel that is lost for half of the run or more is left out. Raises LogError where that is `reference`,
    which tells the cycles.
    """
    kept = {name: each for name, each in lost.items() if each.lost.mean() < _MOSTLY}
    if reference not in kept:
        each = lost[reference]
        raise LogError(
            f"{path}: {each.lost.mean():.0%} of {reference} {' and '.join(each.why)}; "
            "without it nobody knows the phase of a cycle"
        )
    table = {name: each.series for name, each in kept.items()}
    first, end = span(table)
    sound = np.ones(end - first, dtype=bool)
    remarks = [
        f"{name} is not used: {each.lost.mean():.0%} of it {' and '.join(each.why)}"
        for name, each in lost.items()
        if name not in kept
    ]
    alike: dict[str, list[str]] = {}
    for name, each in kept.items():
        spoilt = each.lost[first - each.series.first_sample : end - each.series.first_sample]
        sound &= ~spoilt
        if spoilt.any():
            alike.setdefault(f"{spoilt.mean():.1%} {' and '.join(each.why)}", []).append(name)
    for what, names in alike.items():
        whose = "all channels" if len(names) == len(kept) else ", ".join(names)
        remarks.append(f"{whose}: {what}; left out, in all channels")
    return table, sound, tuple(remarks)


def span(table: Mapping[str, SampleBlock]) -> tuple[int, int]:
    """First sample that all channels have, and the one after the last."""
    first = max(series.first_sample for series in table.values())
    return first, min(series.end_sample for series in table.values())

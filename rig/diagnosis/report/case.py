"""What the report of a diagnosis is made of, and the gaps of groups of its cells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.fingerprint.layout import Cell
from sim_twin.diagnosis.latent_force import LatentForce

Array = NDArray[np.float64]
Span = tuple[float, float]
_ALIKE = 0.7
"""Share of the largest gap from which on its neighbours are named with it."""


@dataclass(frozen=True, slots=True)
class RunFacts:
    """One run: its file's `name`, the scenario in a line, and the unit of each channel."""

    name: str
    scenario: str
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Case:
    """Findings with the diagnosis as its file holds it (interface.md), and what is known of the runs.

    `remarks` say what was lost of the recordings. `forces` are what the joints' forces lack, the largest
    first; none where nobody asked. `folder` holds the diagnosis. Gaps are 1 for a healthy rig.
    """

    findings: Findings
    diagnosis: Mapping[str, Any]
    runs: Sequence[RunFacts]
    remarks: Sequence[str]
    forces: Sequence[LatentForce] = ()
    folder: Path = Path()

    @property
    def verdict(self) -> str:
        """The most probable of "none", "effect" and "unknown"."""
        return self.findings.verdict

    @property
    def judged(self) -> list[Judged]:
        """Every effect, most probable first."""
        return sorted(self.findings.judged, key=lambda each: -each.probability)

    @property
    def selected(self) -> list[Judged]:
        """What the repaired twin has in, most probable first."""
        names = {cause.name for cause in self.findings.selected}
        return [each for each in self.judged if each.cause.name in names]

    @property
    def repaired(self) -> bool:
        """Whether a repaired twin was compared: one was selected, and there was time to simulate it."""
        return bool(self.findings.selected) and self.findings.repaired is not None

    @property
    def cells(self) -> tuple[Cell, ...]:
        """What was compared."""
        return self.findings.layout.cells

    @property
    def channels(self) -> list[str]:
        """Channels in the fingerprint, in its order."""
        return list(dict.fromkeys(cell.channel for cell in self.cells))

    @property
    def run_numbers(self) -> list[int]:
        """Numbers of the runs in the fingerprint."""
        return sorted({cell.run for cell in self.cells})

    def judged_of(self, name: str) -> Judged | None:
        """The judgement on an effect."""
        return next((each for each in self.findings.judged if each.cause.name == name), None)

    def run_name(self, number: int) -> str:
        """Name of a run, or its number where nobody gave one."""
        return self.runs[number].name if number < len(self.runs) else f"run {number + 1}"

    def unit(self, run: int, channel: str) -> str:
        """Unit of a channel; "" where nobody gave one."""
        return self.runs[run].units.get(channel, "") if run < len(self.runs) else ""

    def cell_gaps(self, after: bool) -> Array:
        """The gap of each cell, shape (cells,), to the nominal twin or `after` that to the repaired one."""
        gap = self.findings.gap
        return gap.cells_after / gap.unit_after if after else gap.cells_before / gap.unit_before

    def gap_of(self, chosen: Callable[[Cell], bool], after: bool = False) -> float:
        """Gap of the chosen cells; NaN where there are none."""
        gaps = zip(self.cells, self.cell_gaps(after), strict=True)
        kept = [value for cell, value in gaps if chosen(cell)]
        return float(np.sqrt(np.mean(np.square(kept)))) if kept else float("nan")

    def largest_channels(self) -> list[tuple[str, int, float]]:
        """Channels, largest gap first, each with the run in which it is largest, and the gap there."""
        found = [
            max(
                ((name, run, self.gap_of(within(name, run))) for run in self.run_numbers),
                key=lambda each: each[2],
            )
            for name in self.channels
        ]
        return sorted(found, key=lambda each: -each[2])

    def largest_span(self, channel: str, run: int, spans: Callable[[Cell], Span | None]) -> Span | None:
        """Where a channel's gap is largest over its bands or phases (`spans` tells which), and around.

        None where it is much the same everywhere, or where there are no spans.
        """
        sizes: dict[Span, float] = {}
        for cell, value in zip(self.cells, self.findings.gap.cells_before, strict=True):
            here = spans(cell)
            if here and within(channel, run)(cell) and not cell.partner:
                sizes[here] = max(float(value), sizes.get(here, 0.0))
        order = sorted(sizes)
        if not order:
            return None
        high = [sizes[here] >= _ALIKE * max(sizes.values()) for here in order]
        first = last = order.index(max(order, key=lambda here: sizes[here]))
        while first > 0 and high[first - 1]:
            first -= 1
        while last + 1 < len(order) and high[last + 1]:
            last += 1
        return None if (first, last) == (0, len(order) - 1) else (order[first][0], order[last][1])


def within(channel: str, run: int) -> Callable[[Cell], bool]:
    """Chooses the cells of a channel in a run."""
    return lambda cell: cell.channel == channel and cell.run == run

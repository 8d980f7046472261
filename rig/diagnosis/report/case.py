"""What the report of a diagnosis is made of, gaps of groups of its cells, and both in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.diagnosis.argument import in_unit
from rig.pages.words import DASH, estimate, span
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.fingerprint import Cell
from sim_twin.diagnosis.gap import FARTHEST
from sim_twin.diagnosis.identification import VALUES
from sim_twin.diagnosis.latent_force import LatentForce
from sim_twin.diagnosis.posterior import Estimate
from sim_twin.effects import Parameter

_UNITS = ("_hz", "_kg", "_nm", "_n_per_m15", "_n_per_m", "_ns_per_m", "_rad")


def plain(name: str) -> str:
    """An effect's name as words, or whose value was entered wrongly."""
    key = name.removeprefix(f"{VALUES}.")
    return name.replace("_", " ") if key == name else f"{key} of [model]"


def parameter_words(parameter: Parameter) -> str:
    """A parameter's name as words; its unit stands beside the number."""
    name = next(
        (parameter.name.removesuffix(end) for end in _UNITS if parameter.name.endswith(end)), parameter.name
    )
    return plain(name)


def place(cause: Cause) -> str:
    """Where a cause sits."""
    if cause.location == "sensor":
        return f"in the sensor of {cause.channel}"
    if cause.location == "clock":
        return f"in the clock of {cause.channel}"
    article = "" if cause.location[-1].isdigit() else "the "
    channel = f" ({cause.channel})" if cause.channel else ""
    return f"at {article}{cause.location}{channel}"


def what_and_where(cause: Cause) -> str:
    """An effect with its place."""
    return f"{plain(cause.name)} {place(cause)}"


def unit_words(unit: str) -> str:
    """A unit beside an axis."""
    return unit.replace("s2", "s²") or "-"


def floors(gap: float | None) -> str:
    """A gap."""
    return DASH if gap is None else f"{gap:.2f}"


def plausible(parameter: Parameter) -> str:
    """Where a parameter may lie once its effect is there."""
    return " or ".join(span(low, high, parameter.unit) for low, high in parameter.intervals)


def identified(parameter: Parameter, found: Estimate) -> bool:
    """Whether the runs narrow down what a parameter may be at all."""
    for low, high in parameter.intervals:
        if high - low < _NARROW * abs(high + low) / 2:  # to lie in it says it all
            continue
        inside, outside = (max(found.low, low), min(found.high, high)), (low, high)
        shares = [np.ptp(inside) / np.ptp(outside)] if inside[1] > inside[0] else []
        if shares and low > 0:  # a scale over decades
            shares.append(np.ptp(np.log(inside)) / np.ptp(np.log(outside)))
        if any(share > _OPEN for share in shares):
            return False
    return True


def cell_words(cell: Cell) -> str:
    """What a cell compares."""
    whose = cell.channel if cell.partner is None else f"{cell.channel} with {cell.partner}"
    if cell.band:
        return f"{whose}: {cell.what}, {cell.band[0]:.0f} to {cell.band[1]:.0f} Hz"
    if cell.phase:
        return f"{whose}: {cell.what}, {cell.phase[0]:.2f} to {cell.phase[1]:.2f} of the cycle"
    return f"{whose}: {cell.what}"


Array = NDArray[np.float64]
Span = tuple[float, float]
_OPEN = 0.6
"""Share of its plausible range, plain or by its logarithm, beyond which an interval says nothing."""
_NARROW = 0.2
_REACHED = 1 - 1e-6
_DRAWN = 3
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
    def subject(self) -> str:
        """Whose rig it is, as --subject names it; empty for one of rattle's own."""
        return str(self.diagnosis.get("provenance", {}).get("subject", ""))

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
        return self.findings.layout.cells

    @property
    def channels(self) -> list[str]:
        return list(dict.fromkeys(cell.channel for cell in self.cells))

    @property
    def run_numbers(self) -> list[int]:
        return sorted({cell.run for cell in self.cells})

    def run_name(self, number: int) -> str:
        return self.runs[number].name if number < len(self.runs) else f"run {number + 1}"

    def unit(self, run: int, channel: str) -> str:
        return self.runs[run].units.get(channel, "") if run < len(self.runs) else ""

    def cell_gaps(self, after: bool) -> Array:
        """The gap of each cell, shape (cells,), to the nominal twin or `after` that to the repaired one."""
        gap = self.findings.gap
        return gap.cells_after / gap.unit_after if after else gap.cells_before / gap.unit_before

    def cell_gap_words(self, cell: int, after: bool) -> str:
        """A cell's gap; the measure reaches no farther than `FARTHEST`."""
        gap = self.findings.gap
        floors_off = (gap.cells_after if after else gap.cells_before)[cell]
        return ("≥ " if floors_off > _REACHED * FARTHEST else "") + floors(self.cell_gaps(after)[cell])

    def cell_words_of(self, cell: int, numbers: Array) -> str:
        """What a fingerprint (numbers,) says of a cell, in the unit that people read it in."""
        starts, found = self.findings.layout.starts, self.cells[cell]
        at = slice(starts[cell], starts[cell + 1])
        mean, nominal = float(numbers[at].mean()), float(self.findings.nominal[at].mean())
        value, unit = in_unit(found, self.unit(found.run, found.channel), mean, nominal)
        return estimate(value, unit_words(unit) if unit else "")

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

    def drawn_channels(self) -> list[tuple[str, int]]:
        """The channels with the largest gaps that hold more than an angle, each with the run."""
        spectra = {(cell.channel, cell.run) for cell in self.cells if cell.what == "energy"}
        return [(name, run) for name, run, _ in self.largest_channels() if (name, run) in spectra][:_DRAWN]

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

"""Impacts in a contact force, and the half cycles of a beam between two stops.

A half cycle is all contact on one side before any on the other. The *first* of a half cycle is the peak of
its first contact, its *max* the largest force in it (Deck and Dubowsky's statistics of the beam).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

COUNTS_FROM = 0.15
"""Share of the largest force, of a run or typically of a cycle, from which a contact counts."""

RELEASED_BELOW = 0.02
"""Share of it below which a contact has ended: above a force channel's noise (0.05 N rms against some 20 N),
and above the ripple that an anti-alias filter leaves behind an impact."""

FAINTEST_N = 0.5
"""Ten times the noise of a healthy force channel: a record that never passes it holds no contact."""


@dataclass(frozen=True, slots=True)
class Levels:
    """Forces in N: a rise from `counts_from_n` on counts, below `released_below_n` it has ended."""

    counts_from_n: float
    released_below_n: float


def levels_of(largest: float) -> Levels:
    """The levels of a run whose largest force in N is `largest`, or is expected to be."""
    return Levels(COUNTS_FROM * largest, RELEASED_BELOW * largest)


@dataclass(frozen=True, slots=True)
class Impacts:
    """Contacts of one trace, every array of shape (m,) and in order of time.

    `index` is the sample of the peak, `start` and `end` bound the contact (end excluded).
    """

    index: NDArray[np.intp]
    start: NDArray[np.intp]
    end: NDArray[np.intp]
    peak_n: NDArray[np.float64]
    impulse_ns: NDArray[np.float64]
    contact_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True, slots=True)
class HalfCycles:
    """One row a half cycle, every array of shape (m,): side (+1 upper, -1 lower), *first* and *max* in N.

    It begins at sample `start`; `max_index` is that of its largest force, `contacts` how many there were.
    """

    side: NDArray[np.intp]
    start: NDArray[np.intp]
    first_n: NDArray[np.float64]
    max_index: NDArray[np.intp]
    max_n: NDArray[np.float64]
    contacts: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.side)


def largest_force(*forces: NDArray[np.floating]) -> float:
    """Largest finite sample in N of all `forces`; 0 where there is none."""
    return max((float(np.max(force, initial=0.0, where=np.isfinite(force))) for force in forces), default=0.0)


def find_impacts(force: NDArray[np.floating], sample_rate: float, largest: float | None = None) -> Impacts:
    """Contacts in `force` (N, positive in compression, shape (n,)) that count by `largest`.

    `largest` is the largest force of the run in N (default: of this trace). A sample that is not finite
    counts as no contact.
    """
    top = largest_force(force) if largest is None else largest
    return contacts_above(levels_of(top), force, sample_rate) if top >= FAINTEST_N else no_impacts()


def contacts_above(
    levels: Levels, force: NDArray[np.floating], sample_rate: float, longest_s: float = np.inf
) -> Impacts:
    """Contacts in `force` (shape (n,)) that count by `levels`, except those that last over `longest_s`.

    What lasts long is no impact but a preload, a stuck sensor or an offset. The unit need not be N.
    """
    from daq.signals.impact_events import ContactScanner

    scanner = ContactScanner(levels.released_below_n)
    rows = np.concatenate((scanner.add(force), scanner.finish()))
    return impacts_in(rows, levels, sample_rate, longest_s)


def impacts_in(
    rows: NDArray[np.float64], levels: Levels, sample_rate: float, longest_s: float = np.inf
) -> Impacts:
    """Those of the contacts that a `ContactScanner` found, shape (m, 6), that are impacts by `levels`."""
    # The compiler is loaded by what scans; a run that only records needs the levels alone.
    from daq.signals.impact_events import END, INDEX, PEAK, RISE, START, SUM

    if not len(rows):
        return no_impacts()
    lasts = rows[:, END] - rows[:, START]
    kept = rows[(rows[:, RISE] > levels.counts_from_n) & (lasts <= longest_s * sample_rate)]
    index, start, end = (kept[:, column].astype(np.intp) for column in (INDEX, START, END))
    return Impacts(index, start, end, kept[:, PEAK], kept[:, SUM] / sample_rate, (end - start) / sample_rate)


def joined(parts: Sequence[Impacts]) -> Impacts:
    """Impacts one after the other."""
    columns = (np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Impacts))
    return Impacts(*columns)


def half_cycles(
    upper: NDArray[np.floating],
    lower: NDArray[np.floating],
    sample_rate: float,
) -> HalfCycles:
    """Half cycles of two contact forces (N, positive in compression, equal length and start).

    Half cycles that the ends of the record cut are among them.
    """
    top = largest_force(upper, lower)
    sides = [find_impacts(force, sample_rate, top) for force in (upper, lower)]
    side = np.repeat([1, -1], [len(each) for each in sides])
    each = joined(sides)
    return merged(HalfCycles(side, each.start, each.peak_n, each.index, each.peak_n, np.ones_like(side)))


def merged(parts: HalfCycles) -> HalfCycles:
    """Whole half cycles from parts of them in any order, such as contacts."""
    order = np.argsort(parts.start, kind="stable")
    side, start, first, at, largest, contacts = (
        getattr(parts, field.name)[order] for field in fields(HalfCycles)
    )
    begins = np.flatnonzero(np.diff(side, prepend=0))
    ends = [*begins[1:], len(side)]
    most = np.array([b + np.argmax(largest[b:e]) for b, e in zip(begins, ends, strict=False)], np.intp)
    counts = np.add.reduceat(contacts, begins) if len(begins) else contacts
    return HalfCycles(side[begins], start[begins], first[begins], at[most], largest[most], counts)


def no_impacts() -> Impacts:
    """Not one."""
    nothing, no_number = np.empty(0, np.intp), np.empty(0)
    return Impacts(nothing, nothing, nothing, no_number, no_number, no_number)

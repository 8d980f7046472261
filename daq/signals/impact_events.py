"""Impacts block by block, bounces taken together as one event.

An impact is a quick rise: what a joint carries all the time, and what changes slowly, is none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from daq.signals.impacts import Impacts, Levels, impacts_in, no_impacts

START, END, INDEX, PEAK, SUM, RISE = range(6)
"""Columns of a contact: first sample, end (excluded), sample of the peak, peak, sum of its samples, rise."""

_OPEN, _COUNT, _FLOOR, _HELD = 6, 7, 8, 9
LONGEST_S = 1.0
"""A contact that lasts longer is no impact; it also bounds what has to wait for its end."""


class ContactScanner:
    """Contacts above a floor; one begins with the first sample over `above` beyond it and ends with the first
    that is not.

    The floor is 0 or, where it may `climb` by so much a sample, what the joint carried before: it falls with
    the force at once and follows it upwards no faster. The rise of a contact is that of its force over the
    floor. What is no number neither begins one nor moves the floor. With `held`, the share that is left of a
    magnitude a sample later, contacts are those of what rings. Sums are taken one by one, so that they do not
    depend on the cuts.
    """

    def __init__(self, above: float, climb: float = 0.0, held: float = 0.0) -> None:
        self._rule = above, climb, held
        self._state = np.zeros(10)
        self._state[_FLOOR] = np.inf if climb else 0.0

    @property
    def count(self) -> int:
        """Samples seen so far."""
        return int(self._state[_COUNT])

    @property
    def open_since(self) -> int | None:
        """First sample of the contact that lasts."""
        return int(self._state[START]) if self._state[_OPEN] else None

    def add(self, force: NDArray[np.floating]) -> NDArray[np.float64]:
        """Take the next samples, shape (n,); return the contacts that ended, shape (contacts, 6)."""
        locked = np.ascontiguousarray(force).view()
        locked.flags.writeable = False  # one compiled kernel for blocks of a card and of a log
        rows = np.empty((len(force) // 2 + 1, 6))
        return rows[: _scan(locked, *self._rule, self._state, rows)]

    def finish(self) -> NDArray[np.float64]:
        """The contact that the end of the record cuts, shape (0 or 1, 6)."""
        if not self._state[_OPEN]:
            return np.empty((0, 6))
        self._state[_OPEN], self._state[END] = 0.0, self._state[_COUNT]
        return self._state[None, :6].copy()


@njit(cache=True, nogil=True)
def _scan(
    force: NDArray[np.floating],
    above: float,
    climb: float,
    held: float,
    state: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> int:
    start, index, peak, total, rise = state[0], state[2], state[3], state[4], state[5]
    is_open, first, floor, level = state[6] != 0.0, state[7], state[8], state[9]
    found = 0
    for at in range(len(force)):
        value = float(force[at])
        known = np.isfinite(value)
        if known:
            value = abs(value) if held > 0.0 else max(value, 0.0)
            level = max(value, held * level)
            floor = min(level, floor + climb)
        if known and level > floor + above:
            if not is_open:
                is_open, start, peak, total, rise = True, first + at, -np.inf, 0.0, 0.0
            total += value
            rise = max(rise, level - floor)
            if value > peak:
                peak, index = value, first + at
        elif is_open:
            is_open = False
            rows[found, 0], rows[found, 1], rows[found, 2] = start, first + at, index
            rows[found, 3], rows[found, 4], rows[found, 5] = peak, total, rise
            found += 1
    state[0], state[2], state[3], state[4], state[5] = start, index, peak, total, rise
    state[6], state[7] = 1.0 if is_open else 0.0, first + len(force)
    state[8], state[9] = floor, level
    return found


class ImpactDetector:
    """Impacts on one sensor whose samples come in blocks of any size: rises that count by `levels`.

    A rise takes no longer than `within_s`: a force that climbs more slowly is carried, not struck. Of what
    rings, magnitudes are held for about `rings_s`, longer than half a period. The levels are given
    beforehand, because the largest force of a run is not known while it lasts.
    """

    def __init__(
        self,
        levels: Levels,
        sample_rate: float,
        within_s: float,
        rings_s: float = 0.0,
        longest_s: float = LONGEST_S,
    ) -> None:
        self._levels, self._sample_rate, self._longest_s = levels, sample_rate, longest_s
        climb = levels.counts_from_n / (within_s * sample_rate)
        held = float(np.exp(-1 / (rings_s * sample_rate))) if rings_s else 0.0
        self._scanner = ContactScanner(levels.released_below_n, climb, held)

    @property
    def settled(self) -> int:
        """All contacts that begin before this sample are out."""
        end, since = self._scanner.count, self._scanner.open_since
        if since is None:
            return end
        return max(since, end - int(self._longest_s * self._sample_rate) - 1)

    def add(self, force: NDArray[np.floating]) -> Impacts:
        """Take the next samples (N, shape (n,)); return the contacts that ended."""
        return self._impacts(self._scanner.add(force))

    def finish(self) -> Impacts:
        """The contact that the end of the record cuts."""
        return self._impacts(self._scanner.finish())

    def _impacts(self, contacts: NDArray[np.float64]) -> Impacts:
        return impacts_in(contacts, self._levels, self._sample_rate, self._longest_s)


@dataclass(frozen=True, slots=True)
class ImpactEvents:
    """Impacts with their bounces, one row an event, every array of shape (m,).

    `start` to `end` (excluded) are samples from the first contact to the end of the last, `index` that of
    the largest peak `peak_n`; `first_n` is the first contact's peak. Impulse and time of contact are added
    up over the `contacts`.
    """

    index: NDArray[np.intp]
    start: NDArray[np.intp]
    end: NDArray[np.intp]
    first_n: NDArray[np.float64]
    peak_n: NDArray[np.float64]
    impulse_ns: NDArray[np.float64]
    contact_s: NDArray[np.float64]
    contacts: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.index)


def impact_events(impacts: Impacts, sample_rate: float, within_s: float) -> ImpactEvents:
    """Events of `impacts`: what begins within `within_s` of the end of the last one is a bounce of it."""
    return _together(_single(impacts), sample_rate, within_s)


def _single(impacts: Impacts) -> ImpactEvents:
    """Each an event of its own."""
    return ImpactEvents(
        index=impacts.index,
        start=impacts.start,
        end=impacts.end,
        first_n=impacts.peak_n,
        peak_n=impacts.peak_n,
        impulse_ns=impacts.impulse_ns,
        contact_s=impacts.contact_s,
        contacts=np.ones(len(impacts), np.intp),
    )


def _together(events: ImpactEvents, sample_rate: float, within_s: float) -> ImpactEvents:
    """Those that follow each other within `within_s` as one, added up one after the other."""
    if not len(events):
        return events
    first = np.concatenate(([True], events.start[1:] - events.end[:-1] > within_s * sample_rate))
    begins, event = np.flatnonzero(first), np.cumsum(first) - 1
    ends = np.append(begins[1:], len(events))
    at = [begin + int(np.argmax(events.peak_n[begin:end])) for begin, end in zip(begins, ends, strict=True)]
    return ImpactEvents(
        index=events.index[at],
        start=events.start[begins],
        end=events.end[ends - 1],
        first_n=events.first_n[begins],
        peak_n=events.peak_n[at],
        impulse_ns=_sums(events.impulse_ns, event),
        contact_s=_sums(events.contact_s, event),
        contacts=_sums(events.contacts, event).astype(np.intp),
    )


def _sums(values: NDArray[Any], event: NDArray[np.intp]) -> NDArray[np.float64]:
    """Of the values of each event, one after the other: the cuts of blocks leave no trace in them."""
    return np.asarray(np.bincount(event, values), dtype=np.float64)


class BounceGrouper:
    """Events of contacts that come in parts, as `impact_events` finds them, each once it is over.

    One that never ends, on a sensor that is never still, is kept as one row.
    """

    def __init__(self, sample_rate: float, within_s: float) -> None:
        self._sample_rate, self._within_s = sample_rate, within_s
        self._waiting = _single(no_impacts())

    def add(self, impacts: Impacts, settled: int) -> ImpactEvents:
        """Take what `ImpactDetector.add` returned and its `settled` then; return the events that are over."""
        both = _columns(np.concatenate, self._waiting, _single(impacts))
        found = _together(both, self._sample_rate, self._within_s)
        over = len(found)
        if over and settled - int(found.end[-1]) <= self._within_s * self._sample_rate:
            over -= 1
        self._waiting = _columns(lambda column: column[0][over:], found)
        return _columns(lambda column: column[0][:over], found)

    def finish(self) -> ImpactEvents:
        """The events that wait for more at the end of the record."""
        waiting, self._waiting = self._waiting, _single(no_impacts())
        return waiting


def _columns(of: Callable[[list[NDArray[Any]]], NDArray[Any]], *parts: ImpactEvents) -> ImpactEvents:
    """An array of each field from those of the parts."""
    return ImpactEvents(*(of([getattr(part, each.name) for part in parts]) for each in fields(ImpactEvents)))

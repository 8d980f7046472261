"""What the operator's page shows, as one text: made anew a few times a second from the records that come."""

from __future__ import annotations

import json
import math
import time
from collections import deque
from collections.abc import Callable
from operator import itemgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.log.reader import CRANK_SPEED, CYCLE_PEAK, Origin, derived_name
from daq.log.records import RECORD_END, RECORD_START, STOPPING, Event, Impact
from rig.bounds import nearest
from rig.live import paths
from rig.live.picture import Layout
from rig.live.sketch import FRAMES
from rig.live.view import Dropped, Elsewhere, Levels, Outcome, Progress, Shown, Swept
from rig.pages.words import as_written, number
from rig.stream import Block, LastSeconds, Record, Shape
from sim_twin.rigs.channel_table import ENCODER_ANGLE

PERIOD_S: Final = 0.2
_SAID_AGAIN_S: Final = 1.0
"""Where nothing is new: the page would take a run that says nothing for dead."""
_SHARE: Final = 10
"""Of the time that it took to make one state: so long it waits at least before it makes the next."""
_TREND_S, _BIN_S = 30.0, 0.25
_CYCLES: Final = 8
_SLOWER, _BLOCK_S, _LONGEST_S = 1.2, 0.2, 4.0
"""The longest cycle in mean ones, and what comes at once: both are kept beside the cycles that are shown, up
to some seconds, of which many channels fill memory."""
_CYCLES_A_BIN: Final = 2  # then each has a whole one in it
_COLUMNS, _FEWEST_COLUMNS = 6000, 40
"""Of all pictures of a cycle together, and of one at least: a browser without a graphics card keeps up."""
_STEPS: Final = 1000
"""From the lower edge of a plot to the upper one; whole numbers are what JSON is quick at."""
_NO_CYCLE_S: Final = 0.05
_EVENTS: Final = 40

Array = NDArray[np.floating]


class _Trace:
    """The newest samples of one channel of one origin, and least and largest of every `bin_s`."""

    def __init__(self, kept_s: float, bin_s: float, wraps: bool) -> None:
        self.recent = LastSeconds(kept_s)
        self._bin_s = bin_s
        self.rate = 0.0
        self._wraps = wraps
        self._bins: dict[int, tuple[float, float]] = {}

    @property
    def end_s(self) -> float:
        return self.recent.end_sample / self.rate if self.rate else 0.0

    def add(self, block: SampleBlock) -> None:
        if block.end_sample <= self.recent.end_sample:
            self._bins.clear()  # another record begins
        self.rate = block.sample_rate
        self.recent.add(block)
        values, a_bin = self.seen(block.values), self._a_bin
        first = block.first_sample // a_bin
        starts = np.maximum(np.arange(first, (block.end_sample - 1) // a_bin + 1) * a_bin, block.first_sample)
        least, most = _extremes(values, starts - block.first_sample)
        for at, (low, high) in enumerate(zip(least.tolist(), most.tolist(), strict=True), first):
            before = self._bins.get(at, (math.nan, math.nan))
            self._bins[at] = min(low, before[0]), max(high, before[1])
        for old in [at for at in self._bins if at <= first - _TREND_S / self._bin_s]:
            del self._bins[old]

    @property
    def _a_bin(self) -> int:
        """In samples."""
        return max(round(self._bin_s * self.rate), 1)

    def seen(self, values: Array) -> Array:
        """As the page shows them: an angle, which grows for ever, as part of a turn."""
        return np.degrees(np.mod(values, math.tau)) if self._wraps else values

    def trend(self, first: int, count: int, over: bool) -> Array:
        """Least and largest in each bin from `first` on, shape (2, count).

        None of a bin that is under way, but for the first of all, until all is `over`.
        """
        whole = math.inf if over else max(self.recent.end_sample // self._a_bin, 1)
        return np.array(
            [self._bins[at] if at in self._bins and at < whole else (np.nan, np.nan)
             for at in range(first, first + count)]
        ).T  # fmt: skip

    def cycles(self, begin_s: float, cycle_s: float, columns: int) -> tuple[int, Array, Array] | None:
        """How many whole cycles there are, least and largest in each column of the newest, and of all.

        Both of shape (2, columns). Cycles begin at `begin_s` and every `cycle_s` before and after it.
        """
        if not self.rate:
            return None
        last = math.floor((self.end_s - begin_s) / cycle_s)  # the number of the cycle that is under way
        found = []
        for at in range(last - 1, last - 1 - _CYCLES, -1):
            edges = (begin_s + (at + np.arange(columns + 1) / columns) * cycle_s) * self.rate
            edge = np.ceil(edges).astype(np.int64)
            if edge[0] < self.recent.first_sample or edge[0] < 0:
                break
            found.append(_extremes(self.seen(self.recent.between(edge[0], edge[-1])), edge[:-1] - edge[0]))
        if not found:
            return None
        every = np.array(found)
        return len(found), every[0], np.stack((np.fmin.reduce(every[:, 0]), np.fmax.reduce(every[:, 1])))


def _extremes(values: Array, starts: NDArray[np.int64]) -> Array:
    """Least and largest from each start to the next, shape (2, n); NaN only where all are."""
    return np.stack((np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)))


class PageState:
    """Takes every record of a run and hands its state, as JSON, to `publish` a few times a second."""

    def __init__(self, publish: Callable[[bytes], None]) -> None:
        self._publish = publish
        self._elsewhere = ""
        self._progress = Progress("starting")
        self._layout = Layout("", {}, {})
        self._heard_ns = 0
        self._start_ns: int | None = None
        self._events: deque[tuple[int, str, str, str]] = deque(maxlen=_EVENTS)
        self._dropped = 0
        self._swept: Swept | None = None
        self._outcome: Outcome | None = None
        self._ended = False
        self._changed, self._due_s = True, 0.0
        self._lay_out()

    def _lay_out(self) -> None:
        layout = self._layout
        angles = self._wraps = layout.angles
        self._bin_s = max(_BIN_S, _CYCLES_A_BIN * (layout.cycle_s or 0.0))
        cycle_s = layout.cycle_s or _NO_CYCLE_S
        kept_s = max(min((_CYCLES + 1) * _SLOWER * cycle_s, _LONGEST_S), 3 * cycle_s) + _BLOCK_S
        self._traces = {
            (origin, name): _Trace(kept_s, self._bin_s, name in angles)
            for origin, names in layout.origins.items()
            for name in names
        }
        self._columns = max(_COLUMNS // max(len(self._traces), 1) // 2, _FEWEST_COLUMNS)
        self._columns = min(self._columns, 160)
        self._grid = 0.0, cycle_s
        self._banded = 0
        self._recorded = False
        self._drawn_ns: dict[Origin, int] = {}
        self._levels: dict[str, float] = {}
        self._most: dict[str, float] = {}
        self._impacts: dict[str, tuple[int, float, str]] = {}
        self._speeds: dict[Origin, float] = {}
        self._edges: dict[str, tuple[float, float]] = {}
        self._peaks = {derived_name("measured", name, CYCLE_PEAK) for name in layout.units}
        self._speed_of = {derived_name(origin, CRANK_SPEED): origin for origin in layout.origins}
        self._sketch = layout.picture.sketch(layout) if layout.picture else None

    def take(self, frame: Shown) -> None:
        """Note what a record says; cheap, whatever comes."""
        self._changed = True
        match frame:
            case Layout():  # of the next run, maybe
                self._layout, self._start_ns, self._outcome = frame, None, None
                self._events.clear()
                self._lay_out()
            case Progress():
                if frame.text != self._progress.text:
                    self._due_s = 0.0
                self._progress = frame
            case Levels(time_ns, most):
                self._heard_ns = time_ns
                self._note_levels(dict(zip(self._layout.origins.get("measured", ()), most, strict=False)))
            case Swept():
                self._swept = frame
            case Outcome():
                self._outcome = frame
            case Elsewhere(url):
                self._elsewhere = url
            case Dropped(records):
                self._dropped = records
            case Event():
                self._note_event(frame)
            case _:
                self._note(frame)

    def _note(self, record: Record) -> None:
        match record:
            case Impact():
                count, largest, _ = self._impacts.get(record.origin, (0, 0.0, ""))
                unit = self._layout.units.get(record.channel, "")
                self._impacts[record.origin] = count + 1, max(largest, record.peak), unit
            case Shape() if self._sketch is not None:
                self._sketch.note(record, *self._grid)
            case Block("derived", samples):
                self._note_derived(samples)
            case Block(origin, samples) if (origin, samples.channel) in self._traces:
                self._note_block(origin, samples)

    def _note_event(self, event: Event) -> None:
        self._recorded |= event.code in (RECORD_END, STOPPING)
        if event.code == RECORD_START:  # what a start reached is none of the record's
            self._most.clear()
        told = time.strftime("%H:%M:%S", time.localtime(event.time_ns / NS_PER_S))
        self._events.append((event.time_ns, event.level, told, event.text))

    def _note_levels(self, most: dict[str, float]) -> None:
        for name, level in most.items():
            if not math.isfinite(level) or name in self._wraps:
                continue
            self._levels[name] = float(level)
            if not self._recorded:  # what comes as the drive ramps down is none of the record's
                self._most[name] = max(float(level), self._most.get(name, 0.0))

    def _note_block(self, origin: Origin, samples: SampleBlock) -> None:
        if self._start_ns is None:
            self._start_ns = sample_time_ns(samples.time_ns, -samples.first_sample, samples.sample_rate)
        self._traces[origin, samples.channel].add(samples)
        end_ns = sample_time_ns(samples.time_ns, len(samples), samples.sample_rate)
        self._drawn_ns[origin] = max(self._drawn_ns.get(origin, 0), end_ns)
        if origin == "measured" and len(samples):
            level = float(np.fmax.reduce(np.abs(samples.values)))
            self._note_levels({samples.channel: level})

    def _note_derived(self, samples: SampleBlock) -> None:
        if samples.channel in self._peaks and self._start_ns is not None:
            # where cycles begin, anew with every block: a crank's revolutions are not all alike
            self._grid = (samples.time_ns - self._start_ns) / NS_PER_S, 1 / samples.sample_rate
        known = samples.values[np.isfinite(samples.values)]
        if samples.channel in self._speed_of and len(known):
            self._speeds[self._speed_of[samples.channel]] = float(known[-1])

    def end(self) -> None:
        """No more will come: say what there is."""
        self._ended, self._changed, self._due_s = True, True, 0.0
        self.look()

    def look(self) -> None:
        """Publish what is new, unless it was too lately that something was."""
        begin_s = time.monotonic()
        if begin_s < self._due_s + (0.0 if self._changed else _SAID_AGAIN_S):
            return
        spent_s = time.thread_time()
        self._publish(json.dumps(self._state(), separators=(",", ":")).encode())
        self._changed = False
        self._due_s = begin_s + max(PERIOD_S, _SHARE * (time.thread_time() - spent_s))

    def _state(self) -> dict[str, Any]:
        layout, progress = self._layout, self._progress
        measured = [self._traces["measured", name] for name in layout.origins.get("measured", ())]
        reached_s = max((each.end_s for each in measured or self._traces.values()), default=0.0)
        bin_s = self._bin_s
        bins = min(math.ceil(max(reached_s, 4.0) / bin_s), round(_TREND_S / bin_s))
        first_bin = max(math.ceil(reached_s / bin_s) - bins, 0)
        return {
            "title": layout.title,
            "stage": progress._asdict(),
            "ended": self._ended,
            "explore": self._elsewhere,
            "newest": self._newest(),
            "cycle_s": self._grid[1] if layout.cycle_s else None,
            "bin_s": bin_s,
            "trend_s": [first_bin * bin_s, (first_bin + bins) * bin_s],
            "colours": {
                layout.whose(each): list(paths.COLOURS[layout.whose(each)]) for each in layout.origins
            },
            "channels": [self._channel(name, first_bin, bins) for name in layout.units],
            "cycles": self._banded,
            "worst": self._worst(),
            "figures": self._figures(),
            "events": [told for _, *told in sorted(self._events, key=itemgetter(0))],
            "dropped": self._dropped,
            "outcome": None if self._outcome is None else _told(self._outcome),
            "swept": None if self._swept is None else self._swept._asdict(),
            "sketch": None if self._sketch is None else self._sketch.drawn(self._angles()),
        }

    def _worst(self) -> list[str]:
        """The channel that has come nearest to what it may reach, and how near; empty without one."""
        name = nearest(self._most, self._layout.bounds)
        return [name, self._layout.bounds[name].said(self._most[name])] if name else []

    def _newest(self) -> list[float | None]:
        """Unix time, s, of the newest that is drawn, measured and predicted; before it comes, of the levels.

        Nothing once the record is over: from then on nothing lags.
        """
        if self._recorded:
            return [None, None]
        ends_ns = self._drawn_ns.get("measured", self._heard_ns), self._drawn_ns.get("predicted", 0)
        return [each / NS_PER_S or None for each in ends_ns]

    def _channel(self, name: str, first_bin: int, bins: int) -> dict[str, Any]:
        layout, wraps = self._layout, name in self._wraps
        factor, unit = (1.0, "°") if wraps else as_written(layout.units[name])
        shown: list[tuple[str, list[Array | None]]] = []
        for origin in layout.origins:
            trace = self._traces.get((origin, name))
            if trace is not None:
                many, cycle, band = trace.cycles(*self._grid, self._columns) or (0, None, None)
                self._banded = max(many, self._banded)
                trend = trace.trend(first_bin, bins, self._recorded or self._ended) if trace.rate else None
                shown.append((layout.whose(origin), [cycle, band, trend]))
        drawn = [each * factor for _, parts in shown for each in parts if each is not None]
        low, high = (edge / factor for edge in self._edge(name, drawn))
        bounds = layout.bounds.get(name, (None, None, None))
        level, most = self._levels.get(name), self._most.get(name)
        if self._outcome is not None:  # all is over: what it came to
            level = most
        return {
            "name": name,
            "unit": unit,
            "edges": [number(low * factor), number(high * factor)],
            "traces": {whose: [_steps(each, low, high) for each in parts] for whose, parts in shown},
            "level": level,
            "peak": None if most is None else number(level, layout.units[name]),
            "most": most,
            "bounds": [each if each is not None and math.isfinite(each) else None for each in bounds],
        }

    def _edge(self, name: str, shown: list[Array]) -> tuple[float, float]:
        """Round values that all lie between; they shrink only where less than half of them is used."""
        finite = [each[np.isfinite(each)] for each in shown]
        finite = [each for each in finite if len(each)]
        if not finite:
            return -1.0, 1.0
        low, high = min(float(each.min()) for each in finite), max(float(each.max()) for each in finite)
        if name in self._edges:
            was_low, was_high = self._edges[name]
            if was_low <= low and high <= was_high and high - low > 0.4 * (was_high - was_low):
                return was_low, was_high
        if high - low <= 1e-6 * max(abs(low), abs(high)):  # a line, of a sensor that is silent or dead
            around = abs(high) / 2 or 1.0
            low, high = low - around, high + around
        step = 10.0 ** math.floor(math.log10(high - low)) / 2
        self._edges[name] = math.floor(low / step) * step, math.ceil(high / step) * step
        return self._edges[name]

    def _figures(self) -> list[list[str]]:
        """Rows of what is counted so far: what, measured, predicted."""
        rows = []
        whose: list[Origin] = [each for each in ("measured", "predicted") if self._layout.origins.get(each)]
        if self._speeds:
            rows.append(["crank speed", *(number(self._speeds.get(each), "rpm") for each in whose)])
        if self._impacts:
            found = [self._impacts.get(each, (0, math.nan, "")) for each in whose]
            rows.append(["impacts", *(str(count) for count, *_ in found)])
            rows.append(["largest", *(number(largest, unit) for _, largest, unit in found)])
        return [["", *map(self._layout.whose, whose)], *rows] if rows else []

    def _angles(self) -> dict[Origin, Array]:
        """The crank's angle in rad at equal steps of the newest whole cycle, by origin.

        Where no channel shows it, it turns evenly from where the cycle begins, at the mark.
        """
        begins_rad = getattr(self._layout.picture, "marker_angle_rad", 0.0)
        even = begins_rad + np.arange(FRAMES) * (math.tau / FRAMES)
        found: dict[Origin, Array] = {origin: even for (origin, _), each in self._traces.items() if each.rate}
        begin_s, cycle_s = self._grid
        for (origin, name), trace in self._traces.items():
            if (
                name in self._wraps and name != ENCODER_ANGLE.name and trace.rate
            ):  # that stands as it is mounted
                last = math.floor((trace.end_s - begin_s) / cycle_s) - 1
                times_s = begin_s + (last + np.arange(FRAMES) / FRAMES) * cycle_s
                at = np.floor(times_s * trace.rate).astype(np.int64)
                if at[0] >= max(trace.recent.first_sample, 0):
                    found[origin] = trace.recent.between(int(at[0]), int(at[-1]) + 1)[at - at[0]]
        return found


def _told(outcome: Outcome) -> dict[str, Any]:
    report = None if outcome.report is None else outcome.report.name
    return {"sentences": outcome.sentences, "well": outcome.well, "report": report}


def _steps(values: Array | None, low: float, high: float) -> list[list[int | None]] | None:
    """Rows as whole steps from `low` (0) to `high`; None where there is nothing."""
    if values is None:
        return None
    with np.errstate(invalid="ignore"):
        steps = np.rint((values.astype(np.float64) - low) * (_STEPS / (high - low)))
    if np.isfinite(steps).all():
        whole: list[list[int | None]] = steps.astype(int).tolist()
        return whole
    return [[int(each) if math.isfinite(each) else None for each in row] for row in steps.tolist()]

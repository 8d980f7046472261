"""Turns the records of a run into what Rerun shows."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Collection, Iterable, Iterator
from typing import Generic, TypeVar

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.log.reader import Origin
from daq.log.records import Event
from daq.signals.envelope import Envelope, envelopes
from daq.signals.spectrum import autospectrum
from rig.live import paths
from rig.live.axes import SpectrumPicture
from rig.live.picture import Layout, OwnViews, Stage
from rig.live.series import CycleFigurePlots, line_style, scalars
from rig.live.view import Dropped, OfThePage, Shown
from rig.stream import Block, LastSeconds, Record, Shape

Item = TypeVar("Item")
_Kind = tuple[int, float]
"""Samples of a block and their rate: envelopes of blocks alike are taken together."""

_STEP_S = 0.3
"""Traces, beam and peaks go out together, in lots of this length: the viewer's axis ends at the newest of
them, and one that ran ahead would leave the others blank there."""
_SPECTRUM_OVER_S = _SPECTRUM_PERIOD_S = 1.0
_SPECTRA_PER_S = 32
"""Those of 16 channels, measured and predicted; with more channels each is renewed less often."""
_LEVELS = {"info": rr.TextLogLevel.INFO, "warning": rr.TextLogLevel.WARN, "error": rr.TextLogLevel.ERROR}


class OverlayOrder(Generic[Item]):
    """Items in order of time (s), given out once both origins have come so far.

    The twin needs a moment longer than the sensors. Nothing waits longer than `patience_s` behind the newest
    item, so that a twin which is late or silent delays the view and does not stop it. `expected` are the
    origins that have channels. Items come out in lots that are `step_s` of data apart.
    """

    def __init__(self, expected: Collection[Origin], patience_s: float, step_s: float = 0.0) -> None:
        self._patience_s = patience_s
        self._step_s = step_s
        self._given_s = -math.inf
        self._newest: dict[Origin, float] = dict.fromkeys(expected, -math.inf)
        self._count = itertools.count()
        self._waiting: list[tuple[float, int, Item]] = []

    def note(self, origin: Origin, time_s: float) -> None:
        self._newest[origin] = max(self._newest.get(origin, -math.inf), time_s)

    def add(self, time_s: float, item: Item) -> None:
        heapq.heappush(self._waiting, (time_s, next(self._count), item))

    def ready(self) -> list[Item]:
        """Take out what both origins have reached, oldest first; nothing before another `step_s` has come."""
        newest = self._newest.values()
        reached = max(min(newest), max(newest) - self._patience_s)
        if reached < self._given_s + self._step_s:
            return []
        self._given_s = reached
        return self._take(reached)

    def rest(self) -> list[Item]:
        return self._take(math.inf)

    def _take(self, until_s: float) -> list[Item]:
        taken = []
        while self._waiting and self._waiting[0][0] <= until_s:
            taken.append(heapq.heappop(self._waiting)[2])
        return taken


class Scene:
    """A recording that is being filled, each record at its own time, measured and predicted together.

    Measured data waits up to `patience_s` for its prediction. Spectra, over the last second, are renewed once
    a second of each channel's own time, less often where there are many.
    """

    def __init__(self, recording: rr.RecordingStream, layout: Layout, patience_s: float) -> None:
        self._stage = Stage(recording, layout)
        self._recording = recording
        self._layout = layout
        expected = [origin for origin, names in layout.origins.items() if names]
        self._order = OverlayOrder[Record](expected or ["measured"], patience_s, _STEP_S)
        traces = sum(len(names) for names in layout.origins.values())
        self._spectrum_period_s = max(_SPECTRUM_PERIOD_S, traces / _SPECTRA_PER_S)
        self._figures = CycleFigurePlots(self._stage)
        self._play = layout.picture.play(self._stage) if layout.picture else None
        self._recent: dict[tuple[Origin, str], LastSeconds] = {}
        self._spectrum_due_s: dict[tuple[Origin, str], float] = {}
        own = layout.picture.views(layout) if layout.picture else OwnViews(())
        heard = [name for name in layout.units if name not in own.plain]
        self._spectra = {name: SpectrumPicture(recording, name) for name in heard}

    def open(self) -> None:
        """Log what stays: names, colours, what of the rig does not move."""
        for origin, names in self._layout.origins.items():
            for name in names:
                style = line_style(self._layout.whose(origin))
                self._recording.log(paths.trace(origin, name), style, static=True)
        self._figures.open()
        if self._play is not None:
            self._play.open()
        self._show_dropped(0)

    def show(self, frames: Iterable[Shown]) -> None:
        """Show each as soon as it is due, until there are no more."""
        for frame in frames:
            if isinstance(frame, OfThePage | Layout):
                continue
            match frame:
                case Dropped(records):
                    self._show_dropped(records)
                case Shape():
                    self._order.add(frame.time_s, frame)
                case Block("derived", samples):
                    self._order.add(self._stage.time_of(samples.time_ns), frame)
                case Block(origin, samples):
                    if self._stage.start_ns is None:
                        self._stage.start_ns = sample_time_ns(
                            samples.time_ns, -samples.first_sample, samples.sample_rate
                        )
                    end_s = samples.end_sample / samples.sample_rate
                    self._order.note(origin, end_s)
                    self._order.add(end_s, frame)
                case _:
                    self._order.add(self._stage.time_of(frame.time_ns), frame)
            self._show_due(self._order.ready())

    def finish(self) -> None:
        """Show what waited for more: no more will come."""
        self._show_due(self._order.rest())
        if self._play is not None:
            self._play.finish()

    def _show_due(self, due: list[Record]) -> None:
        lots: dict[tuple[Origin, str], list[SampleBlock]] = {}
        for record in due:
            match record:
                case Block("derived", samples):
                    self._figures.add(samples)
                case Block(origin, samples):
                    lots.setdefault((origin, samples.channel), []).append(samples)
                    if samples.channel in self._spectra:
                        self._renew_spectrum(origin, samples)
                case Event():
                    self._stage.at(self._stage.time_of(record.time_ns))
                    level = _LEVELS.get(record.level, rr.TextLogLevel.INFO)
                    self._recording.log(
                        paths.EVENTS, rr.TextLog(f"{record.source}: {record.text}", level=level)
                    )
            if self._play is not None:
                self._play.take(record)
        self._draw_traces(lots)

    def _show_dropped(self, count: int) -> None:
        text = f"{count} blocks not shown: this view was too slow. The log has them all."
        status = f"{self._layout.title}\n\n{text if count else 'No block dropped.'}"
        self._recording.log(paths.STATUS, rr.TextDocument(status), static=True)

    def _draw_traces(self, lots: dict[tuple[Origin, str], list[SampleBlock]]) -> None:
        """Send a trace's envelopes together: a browser pays for every batch, whatever is in it."""
        alike: dict[_Kind, list[NDArray[np.floating]]] = {}
        for block in itertools.chain(*lots.values()):
            alike.setdefault((len(block), block.sample_rate), []).append(block.values)
        chosen: dict[_Kind, Iterator[Envelope]] = {}
        for (count, sample_rate), rows in alike.items():
            points = max(round(self._layout.points_per_s * count / sample_rate), 4)
            chosen[count, sample_rate] = iter(envelopes(rows, points))
        for (origin, channel), blocks in lots.items():
            times, values = [], []
            for block in blocks:
                drawn = next(chosen[len(block), block.sample_rate])
                times_ns = (block.first_sample + drawn.indices) * (NS_PER_S / block.sample_rate)
                times.append(times_ns.round().astype("m8[ns]"))
                values.append(drawn.values)
            self._recording.send_columns(
                paths.trace(origin, channel),
                [rr.TimeColumn(paths.TIMELINE, duration=np.concatenate(times))],
                scalars(np.concatenate(values)),
            )

    def _renew_spectrum(self, origin: Origin, block: SampleBlock) -> None:
        key = origin, block.channel
        recent = self._recent.setdefault(key, LastSeconds(_SPECTRUM_OVER_S))
        recent.add(block)
        end_s = block.end_sample / block.sample_rate
        if end_s < self._spectrum_due_s.setdefault(key, _SPECTRUM_OVER_S):
            return
        self._spectrum_due_s[key] = end_s + self._spectrum_period_s
        count = round(_SPECTRUM_OVER_S * block.sample_rate)
        values = recent.between(recent.end_sample - count, recent.end_sample)
        self._stage.at(end_s)
        spectrum = autospectrum(values, block.sample_rate)
        self._spectra[block.channel].draw(self._layout.whose(origin), spectrum, block.sample_rate)

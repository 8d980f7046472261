"""Turns blocks, shapes and events into what Rerun shows; the same for a live run and a finished log."""

from __future__ import annotations

import numpy as np
import rerun as rr

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.log.reader import Origin
from daq.log.records import Event, Impact
from daq.signals.spectrum import autospectrum
from rig.crank.recent import Recent
from rig.live import paths
from rig.live.cycle_figures import CycleFigurePlots
from rig.live.frames import ShapeFrame
from rig.live.layout import Layout
from rig.live.picture import OwnViews, Stage
from rig.live.series import line_style
from rig.live.spectrum_picture import SpectrumPicture
from rig.live.trace import Trace

_SPECTRUM_OVER_S = 1.0
_SPECTRA_PER_S = 32
"""Those of 16 channels, measured and predicted; with more channels each is renewed less often."""
_LEVELS = {
    "info": rr.TextLogLevel.INFO,
    "warning": rr.TextLogLevel.WARN,
    "error": rr.TextLogLevel.ERROR,
}


class Scene:
    """A recording that is being filled; every method logs at the time of what it is given.

    Spectra, over the last second, are renewed every `spectrum_period_s` of each channel's own time.
    """

    def __init__(self, recording: rr.RecordingStream, layout: Layout, spectrum_period_s: float = 1.0) -> None:
        self._stage = Stage(recording, layout)
        self._recording = recording
        self._layout = layout
        traces = sum(len(names) for names in layout.origins.values())
        self._spectrum_period_s = max(spectrum_period_s, traces / _SPECTRA_PER_S)
        self._start_ns: int | None = None
        self._figures = CycleFigurePlots(self._stage)
        self._play = layout.picture.play(self._stage) if layout.picture else None
        self._traces: dict[tuple[Origin, str], Trace] = {}
        self._recent: dict[tuple[Origin, str], Recent] = {}
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

    def begin(self, block: SampleBlock) -> None:
        """Take sample 0 of the first block's record for the begin of all time."""
        if self._start_ns is None:
            self._start_ns = sample_time_ns(block.time_ns, -block.first_sample, block.sample_rate)

    def add_block(self, origin: Origin, block: SampleBlock) -> None:
        """Show a block's envelope, and what is computed from the blocks so far."""
        self.begin(block)
        self._trace(origin, block.channel).add(block)
        if self._play is not None:
            self._play.add_block(origin, block)
        if block.channel in self._spectra:
            self._renew_spectrum(origin, block)

    def add_derived(self, block: SampleBlock) -> None:
        """Show what was computed from blocks."""
        times_s = self.time_of(block.time_ns) + np.arange(len(block)) / block.sample_rate
        self._figures.add(times_s, block)
        if self._play is not None:
            self._play.add_derived(times_s, block)

    def add_impact(self, impact: Impact) -> None:
        """Show an impact, where the rig's picture has a place for it."""
        if self._play is not None:
            self._play.add_impact(self.time_of(impact.time_ns), impact)

    def add_shape(self, shape: ShapeFrame) -> None:
        """Show where the twin's rig is, where it has a picture."""
        if self._play is not None:
            self._play.add_shape(shape)

    def add_event(self, event: Event) -> None:
        """Show an event."""
        self._stage.at(self.time_of(event.time_ns))
        level = _LEVELS.get(event.level, rr.TextLogLevel.INFO)
        self._recording.log(paths.EVENTS, rr.TextLog(f"{event.source}: {event.text}", level=level))

    def time_of(self, time_ns: int) -> float:
        """Seconds from sample 0 to a time; 0 while no sample has come."""
        return 0.0 if self._start_ns is None else (time_ns - self._start_ns) / NS_PER_S

    def show_dropped(self, count: int) -> None:
        """Show how many blocks did not reach this view."""
        text = f"{count} blocks not shown: this view was too slow. The log has them all."
        status = f"{self._layout.title}\n\n{text if count else 'No block dropped.'}"
        self._recording.log(paths.STATUS, rr.TextDocument(status), static=True)

    def flush(self) -> None:
        """Send what waits for the next batch."""
        for trace in self._traces.values():
            trace.flush()

    def finish(self) -> None:
        """Show what waits for more: no more will come."""
        if self._play is not None:
            self._play.finish()
        self.flush()

    def _trace(self, origin: Origin, channel: str) -> Trace:
        key = origin, channel
        if key not in self._traces:
            path = paths.trace(origin, channel)
            self._traces[key] = Trace(self._recording, path, self._layout.points_per_s)
        return self._traces[key]

    def _renew_spectrum(self, origin: Origin, block: SampleBlock) -> None:
        key = origin, block.channel
        recent = self._recent.setdefault(key, Recent(_SPECTRUM_OVER_S))
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

"""Turns blocks, shapes and events into what Rerun shows; the same for a live run and a finished log."""

from __future__ import annotations

import numpy as np
import rerun as rr
from rerun.components import AggregationPolicy, MarkerShape

from daq.block import NS_PER_S, SampleBlock
from daq.log.reader import Origin
from daq.log.records import Event
from daq.signals import autospectrum
from rig.live import paths
from rig.live.frames import ShapeFrame
from rig.live.half_cycle_peaks import HalfCyclePeaks
from rig.live.layout import Layout
from rig.live.recent import Recent
from rig.live.spectrum_picture import SpectrumPicture
from rig.live.trace import Trace

_SPECTRUM_OVER_S = 1.0
_SPECTRA_PER_S = 32
"""Those of 16 channels, measured and predicted; with more channels each is renewed less often."""
_MARKERS = {
    "measured": MarkerShape.Circle,
    "nominal": MarkerShape.Cross,
    "predicted": MarkerShape.Diamond,
    "repaired": MarkerShape.Diamond,
}
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
        self._recording = recording
        self._layout = layout
        traces = sum(len(names) for names in layout.origins.values())
        self._spectrum_period_s = max(spectrum_period_s, traces / _SPECTRA_PER_S)
        self._start_ns: int | None = None
        self._peaks: dict[Origin, HalfCyclePeaks] = {origin: HalfCyclePeaks() for origin in layout.origins}
        self._traces: dict[tuple[Origin, str], Trace] = {}
        self._recent: dict[tuple[Origin, str], Recent] = {}
        self._spectrum_due_s: dict[tuple[Origin, str], float] = {}
        self._spectra = {name: SpectrumPicture(recording, name, unit) for name, unit in layout.units.items()}
        self._dropped = 0

    def open(self) -> None:
        """Log what stays: names, colours, the beam's stops."""
        for origin, names in self._layout.origins.items():
            for name in names:
                self._recording.log(paths.trace(origin, name), _line(self._layout.whose(origin)), static=True)
            if names:
                self._recording.log(paths.peaks(origin), _points(self._layout.whose(origin)), static=True)
        if self._layout.beam is not None:
            self._layout.beam.draw_fixed(self._recording)

    def add_block(self, origin: Origin, block: SampleBlock) -> None:
        """Show a block's envelope, and what is computed from the blocks so far."""
        if self._start_ns is None:
            self._start_ns = block.time_ns - round(block.first_sample * NS_PER_S / block.sample_rate)
        self._trace(origin, block.channel).add(block)
        for peak in self._peaks[origin].add(block):
            self._at(peak.time_s)
            self._recording.log(paths.peaks(origin), rr.Scalars(peak.force_n))
        self._renew_spectrum(origin, block)

    def add_shape(self, shape: ShapeFrame) -> None:
        """Show the beam, where the layout has one."""
        if self._layout.beam is not None:
            self._at(shape.time_s)
            self._layout.beam.draw(self._recording, shape.positions_m, shape.deflection_m)

    def add_event(self, event: Event) -> None:
        """Show an event."""
        self._at(self.time_of(event))
        level = _LEVELS.get(event.level, rr.TextLogLevel.INFO)
        self._recording.log(paths.EVENTS, rr.TextLog(f"{event.source}: {event.text}", level=level))

    def time_of(self, event: Event) -> float:
        """Seconds from sample 0 to the event; 0 while no sample has come."""
        return 0.0 if self._start_ns is None else (event.time_ns - self._start_ns) / NS_PER_S

    def show_dropped(self, count: int) -> None:
        """Show how many blocks did not reach this view."""
        text = f"{count} blocks not shown: this view was too slow. The log has them all."
        status = f"{self._layout.title}\n\n{text if count else 'No block dropped.'}"
        self._recording.log(paths.STATUS, rr.TextDocument(status), static=True)

    def flush(self) -> None:
        """Send what waits for the next batch."""
        for trace in self._traces.values():
            trace.flush()

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
        self._at(end_s)
        picture = self._spectra.get(block.channel)
        if picture is not None:
            picture.draw(
                self._layout.whose(origin), autospectrum(values, block.sample_rate), block.sample_rate
            )

    def _at(self, time_s: float) -> None:
        self._recording.set_time(paths.TIMELINE, duration=np.timedelta64(round(time_s * NS_PER_S), "ns"))


def _line(whose: str) -> rr.SeriesLines:
    return rr.SeriesLines(
        colors=[paths.COLOURS[whose]],
        names=[whose],
        widths=[paths.WIDTHS[whose]],
        aggregation_policy=AggregationPolicy.MinMax,  # the viewer's default averages, and peaks shrink
    )


def _points(whose: str) -> rr.SeriesPoints:
    return rr.SeriesPoints(
        colors=[paths.COLOURS[whose]], names=[whose], markers=[_MARKERS[whose]], marker_sizes=[3.0]
    )

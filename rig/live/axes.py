"""Plots that Rerun has not, of anything over anything on linear or logarithmic axes: lines in a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from daq.signals.spectrum import Autospectrum, log_bands
from rig.live import paths

DRAW_ORDER = {"measured": 2.0, "nominal": 2.5, "predicted": 3.0, "repaired": 3.0, "surrogate": 3.5}
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_AGAIN = 5
"""Pictures after which unchanged axes are drawn again."""


@dataclass(frozen=True, slots=True)
class Axis:
    """From `low` to `high`, with `ticks` at values and what is written there."""

    low: float
    high: float
    ticks: tuple[tuple[float, str], ...]
    logarithmic: bool = False

    def share(self, values: NDArray[np.float64] | Sequence[float]) -> NDArray[np.float64]:
        """Where `values` lie between `low` (0) and `high` (1), same shape."""
        given = np.asarray(values, dtype=np.float64)
        if not self.logarithmic:
            return (given - self.low) / (self.high - self.low)
        low, high = math.log10(self.low), math.log10(self.high)
        return np.asarray((np.log10(given) - low) / (high - low))


def decades(top: float, count: int, every: int = 1) -> Axis:
    """So many decades that `top` lies in the upper one or in the one below; a tick `every` so many."""
    last = math.ceil(math.log10(top))
    ticks = tuple((10.0**at, f"1e{at}") for at in range(last, last - count - 1, -every))
    return Axis(10.0 ** (last - count), 10.0**last, ticks, logarithmic=True)


def from_zero(top: float, ticks: int = 4) -> Axis:
    """Linear from 0, with at most so many round steps up to `top`."""
    step = round_step(top / ticks)
    count = math.ceil(top / step)
    return Axis(0.0, step * count, tuple((step * at, f"{step * at:g}") for at in range(count + 1)))


def round_step(least: float) -> float:
    """The next of 1, 2, 2.5, 5 times a power of ten."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next((step * decade for step in _STEPS if step * decade >= least * (1 - 1e-9)), 10.0 * decade)


@dataclass(frozen=True, slots=True)
class Frame:
    """Room for a plot: `width` to the right, `height` downward, `left`, `bottom` and `top` for labels."""

    width: float = 16.0
    height: float = 5.4
    left: float = 2.2
    bottom: float = 2.5
    top: float = 0.3

    def view(self, origin: str, name: str) -> rrb.Spatial2DView:
        """A view of what is drawn in it below `origin`."""
        across, down = (-self.left, self.width + 0.9), (-self.top, self.height + self.bottom)
        bounds = rrb.VisualBounds2D(x_range=across, y_range=down)
        return rrb.Spatial2DView(origin=origin, name=name, visual_bounds=bounds)


class AxesPicture:
    """A frame with grid, labels and `caption` at `path`.

    Drawn again when an axis changes and now and then besides: the viewer forgets what is old, and a page that
    is opened late would have no axes.
    """

    def __init__(
        self, recording: rr.RecordingStream, path: str, frame: Frame, caption: str | None = None
    ) -> None:
        self._recording, self._path, self._frame, self._caption = recording, path, frame, caption
        self._axes: tuple[Axis, Axis] | None = None
        self._fits = 0

    def fit(self, x: Axis, y: Axis) -> None:
        if self._axes != (x, y) or self._fits % _AGAIN == 0:
            self._axes = x, y
            width, height = self._frame.width, self._frame.height
            columns = x.share([value for value, _ in x.ticks]) * width
            rows = (1 - y.share([value for value, _ in y.ticks])) * height
            grid = [[(at, 0.0), (at, height)] for at in (*columns, width)]
            grid += [[(0.0, at), (width, at)] for at in rows]
            lines = rr.LineStrips2D(grid, colors=[paths.DIM], radii=rr.Radius.ui_points(0.4), draw_order=1.0)
            self._recording.log(f"{self._path}/axes", lines)
            places = [(at, height + 0.42 * self._frame.bottom) for at in columns]
            places += [(-0.5 * self._frame.left, at) for at in rows]
            texts = [text for _, text in (*x.ticks, *y.ticks)]
            if self._caption:
                places.append((width / 2, -0.75 * self._frame.top))
                texts.append(self._caption)
            labels = rr.Points2D(
                places, labels=texts, show_labels=True, colors=[paths.LABEL], radii=rr.Radius.ui_points(0.0)
            )
            self._recording.log(f"{self._path}/labels", labels)
        self._fits += 1

    def places(
        self, x: NDArray[np.float64] | Sequence[float], y: NDArray[np.float64] | Sequence[float]
    ) -> NDArray[np.float64]:
        """Where points lie in the plane, shape (n, 2); what is below the frame is drawn at its edge."""
        assert self._axes is not None  # noqa: S101  whoever draws has fitted before
        across, up = self._axes[0].share(x), self._axes[1].share(y)
        return np.column_stack((across * self._frame.width, np.minimum(1 - up, 1.0) * self._frame.height))

    def line(self, whose: str, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
        """Draw a line in the colour of `whose` it is, at the recording's current time; shapes (n,)."""
        line = rr.LineStrips2D(
            [self.places(x, y)],
            colors=[paths.COLOURS[whose]],
            radii=rr.Radius.ui_points(paths.WIDTHS[whose] / 2),
            draw_order=DRAW_ORDER[whose],
        )
        self._recording.log(f"{self._path}/{whose}", line)


SPECTRUM_FRAME = Frame()
BANDS = 240
_DECADES, _LABELLED = 12, 3
_LOWEST_HZ = 1.0


class SpectrumPicture:
    """One channel's measured and predicted autospectrum.

    The axes are drawn once, from the first spectrum, and again where the density outgrows them.
    """

    def __init__(self, recording: rr.RecordingStream, channel: str) -> None:
        self._axes = AxesPicture(recording, paths.spectrum(channel), SPECTRUM_FRAME)
        self._density: Axis | None = None

    def draw(self, whose: str, spectrum: Autospectrum, sample_rate: float) -> None:
        """Log the line of `spectrum` at the recording's current time."""
        seen = (spectrum.density > 0) & (spectrum.frequency_hz >= _LOWEST_HZ)
        if not seen.all():
            spectrum = Autospectrum(spectrum.frequency_hz[seen], spectrum.density[seen])
        if not len(spectrum.density):
            return
        largest = float(spectrum.density.max())
        if self._density is None or largest > self._density.high:
            self._density = decades(10 * largest, _DECADES, _LABELLED)
        highest_hz = sample_rate / 2
        count = math.floor(math.log10(highest_hz / _LOWEST_HZ)) + 1
        each = [_LOWEST_HZ * 10.0**at for at in range(count)]
        ticks = tuple((at, f"{at / 1000:.0f} kHz" if at >= 1000 else f"{at:.0f} Hz") for at in each)
        self._axes.fit(Axis(_LOWEST_HZ, highest_hz, ticks, logarithmic=True), self._density)
        heard = log_bands(spectrum, BANDS)
        self._axes.line(whose, heard.frequency_hz, heard.density)

"""What a view shows of a run, and what a rig adds to it: its picture in space, its own plots.

A rig's picture is a frozen dataclass of numbers and words: it is loaded where it is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.log.reader import SURROGATE, Origin
from rig.bounds import Bounds
from rig.derived.settings import role_of
from rig.live import paths
from rig.live.sketch import Sketch
from rig.pages.words import as_written
from rig.rigs import RIGS
from rig.stream import Record
from sim_twin.rigs.channel_table import Role

if TYPE_CHECKING:
    from sim_twin.twin import AnyTwin


@dataclass(frozen=True, slots=True)
class OwnViews:
    """Views that a rig adds.

    `side`: under each other at the right, each with its share of the height; `beside`: next to the traces,
    before the autospectra. `plain` channels tell how the rig moves rather than how it vibrates: no
    autospectrum, and a lower trace.
    """

    side: tuple[tuple[rrb.View | rrb.Container, float], ...]
    beside: tuple[rrb.View | rrb.Container, ...] = ()
    plain: frozenset[str] = frozenset()


def in_plot(unit: str) -> str:
    """A unit as people write it, of values that are drawn as they are."""
    factor, written = as_written(unit)
    return (written if factor == 1.0 else unit) or "-"


Point = tuple[float, float, float]


def looking(length_m: float, place: Point, target: Point, up: Point = (0.0, 0.0, 1.0)) -> rrb.EyeControls3D:
    """An eye whose `place` and `target` are in parts of a rig's length."""
    at, toward = (tuple(length_m * each for each in point) for point in (place, target))
    return rrb.EyeControls3D(position=at, look_target=toward, eye_up=up)


class Stage:
    """The recording that a view fills, and what it shows; `start_ns` is the time of sample 0, once known."""

    def __init__(self, recording: rr.RecordingStream, shown: Layout) -> None:
        self.recording, self.shown = recording, shown
        self.start_ns: int | None = None

    def time_of(self, time_ns: int) -> float:
        """Seconds from sample 0 to a time; 0 while no sample has come."""
        return 0.0 if self.start_ns is None else (time_ns - self.start_ns) / NS_PER_S

    def times_of(self, samples: SampleBlock) -> NDArray[np.float64]:
        """Those of a block's values, s since sample 0, shape (n,), by its own time."""
        return self.time_of(samples.time_ns) + np.arange(len(samples)) / samples.sample_rate

    def at(self, time_s: float) -> None:
        """What is logged from now on belongs to `time_s`, seconds since sample 0."""
        self.recording.set_time(paths.TIMELINE, duration=np.timedelta64(round(time_s * NS_PER_S), "ns"))

    def columns(self, path: str, times_s: NDArray[np.float64], columns: Iterable[Any]) -> None:
        """Send what an archetype's `columns` gave, a row for each of `times_s`, shape (n,)."""
        durations = (times_s * NS_PER_S).round().astype("m8[ns]")
        self.recording.send_columns(path, [rr.TimeColumn(paths.TIMELINE, duration=durations)], columns)


class Play(Protocol):
    """Fills a rig's views in the time line's process; each call does a bounded amount of work."""

    def open(self) -> None: ...

    def take(self, record: Record) -> None:
        """Show of a record what the rig has a view for."""

    def finish(self) -> None:
        """Show what waits for more: no more will come."""


class Picture(Protocol):
    """One rig as the view shows it; `rig` is its name."""

    rig: ClassVar[str]

    @classmethod
    def of(cls, twin: AnyTwin) -> Picture: ...

    def views(self, shown: Layout) -> OwnViews: ...

    def play(self, stage: Stage) -> Play: ...

    def sketch(self, shown: Layout) -> Sketch: ...


_POINTS_PER_S = 12_000
_FEWEST, _MOST = 800, 2_500


@dataclass(frozen=True, slots=True)
class Layout:
    """What is shown of a run: channels of all origins, drawn in their order, and the rig's picture.

    `units` has the unit of every channel, in the order of the views. `window_s` is how much of the newest
    data the plots show, None for everything. `derived`: channels that are computed from them. `cycle_s`: how
    long a cycle of the drive, or a revolution, is meant to last; None where nothing turns or swings evenly.
    """

    title: str
    units: Mapping[str, str]
    origins: Mapping[Origin, Sequence[str]]
    window_s: float | None = None
    derived: Sequence[str] = ()
    picture: Picture | None = None
    bounds: Mapping[str, Bounds] = field(default_factory=dict)
    cycle_s: float | None = None

    @property
    def angles(self) -> frozenset[str]:
        """Channels that are angles, which grow as long as a shaft turns."""
        return frozenset(name for name in self.units if role_of(name) is Role.ANGLE)

    def whose(self, origin: str) -> str:
        """The origin as the view names it: beside a nominal twin, the prediction is the repaired one."""
        if origin == SURROGATE:
            return "surrogate"
        return "repaired" if origin == "predicted" and self.origins.get("nominal") else origin

    @property
    def points_per_s(self) -> float:
        """Points per second and trace, so that a browser keeps up with all of them together."""
        traces = sum(len(names) for names in self.origins.values())
        return min(max(_POINTS_PER_S / max(traces, 1), _FEWEST), _MOST)


def picture_of(twin: AnyTwin) -> Picture | None:
    """The rig of a twin in space and its own plots; None for a rig that has no picture."""
    place = RIGS[twin.rig.kind].picture
    picture: Picture | None = resolve_name(place).of(twin) if place else None
    return picture


def layout_of(
    title: str,
    measured: Sequence[Channel],
    predicted: Sequence[Channel],
    picture: Picture | None = None,
    window_s: float | None = None,
    nominal: Sequence[Channel] = (),
    derived: Sequence[Channel] = (),
    surrogate: Sequence[Channel] = (),
    bounds: Mapping[str, Bounds] | None = None,
    cycle_s: float | None = None,
) -> Layout:
    """Layout of the channels of all origins: the measured first, then what is only predicted."""
    return Layout(
        title=title,
        units={channel.name: channel.unit for channel in (*measured, *predicted)},
        origins={
            "measured": [channel.name for channel in measured],
            "nominal": [channel.name for channel in nominal],
            "predicted": [channel.name for channel in predicted],
            **({SURROGATE: [channel.name for channel in surrogate]} if surrogate else {}),
        },
        derived=[channel.name for channel in derived],
        picture=picture,
        window_s=window_s,
        bounds=bounds or {},
        cycle_s=cycle_s,
    )

"""What a rig adds to the view beside the traces of its channels: its picture in space, its own plots.

A rig's picture is a frozen dataclass of numbers and words, because it travels to the view process as JSON.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from daq.block import NS_PER_S, SampleBlock
from rig.live import paths
from rig.live.displayed_channels import DisplayedChannels
from rig.stream import Record

if TYPE_CHECKING:  # the view process does without the twin, which takes seconds to import
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


class Stage:
    """The recording that a view fills, and what it shows; `start_ns` is the time of sample 0, once known."""

    def __init__(self, recording: rr.RecordingStream, shown: DisplayedChannels) -> None:
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
    """Fills a rig's views in the view process; each call does a bounded amount of work."""

    def open(self) -> None:
        """Log what stays."""
        ...

    def take(self, record: Record) -> None:
        """Show of a record what the rig has a view for."""
        ...

    def finish(self) -> None:
        """Show what waits for more: no more will come."""
        ...


class Picture(Protocol):
    """One rig as the view shows it; `rig` is its name."""

    rig: ClassVar[str]
    __dataclass_fields__: ClassVar[dict[str, Any]]

    @classmethod
    def of(cls, twin: AnyTwin) -> Picture:
        """The picture of a twin's rig."""
        ...

    def views(self, shown: DisplayedChannels) -> OwnViews:
        """How the rig's own views are arranged."""
        ...

    def play(self, stage: Stage) -> Play:
        """What fills them."""
        ...

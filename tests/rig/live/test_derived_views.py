"""What is derived has its place in the view: figures of cycles, speed, and impacts over the crank angle."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np
import pytest
import rerun as rr
from numpy.typing import NDArray
from rerun.blueprint import TimeSeriesView

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.log.records import Impact
from rig.live import paths
from rig.live.crank_plots import ImpactPicture
from rig.live.picture import Layout, Stage, layout_of
from rig.live.rigs.impact_beam import BeamPicture
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.scene import Scene
from rig.live.series import figure_views, scalars
from rig.stream import Block

START_NS = 1_790_000_000_000_000_000
FORCE, CRANK = Channel("contact.force_upper", "N"), Channel("crank.angle", "rad")
DERIVED = [
    Channel("contact.force_upper.cycle_peak", "N"),
    Channel("contact.force_upper.cycle_rms", "N"),
    Channel("predicted.contact.force_upper.cycle_peak", "N"),
    Channel("crank.speed", "rpm"),
]
PLANAR = PlanarCrankPicture(0.150, 0.564, 1e-3, 1e-3, 20.0)


class KeptRecording(rr.RecordingStream):
    """Keeps what is logged instead of sending it: entities by path, and times in s of columns by path."""

    def __init__(self) -> None:
        super().__init__("test")
        self.logged: dict[str, Any] = {}
        self.times_s: dict[str, list[float]] = {}

    def log(self, path: Any, entity: Any, *extra: Any, **options: Any) -> None:
        self.logged[str(path)] = entity

    def send_columns(self, path: Any, indexes: Any, columns: Any, **options: Any) -> None:
        (times,) = indexes
        self.times_s.setdefault(str(path), []).extend(
            each.total_seconds() for each in times.as_arrow_array().to_pylist()
        )


def impact(turns: float, peak: float, origin: str = "measured", at_s: float = 0.0) -> Impact:
    time_ns = START_NS + round(at_s * NS_PER_S)
    return Impact(time_ns, origin, "contact.force_upper", 0, 9, 4, peak, peak, 1e-3, 1e-3, 0, turns)


def layout(picture: BeamPicture | PlanarCrankPicture | None = None) -> Layout:
    return layout_of("run", [FORCE, CRANK], [FORCE], picture, derived=DERIVED)


def a_block(channel: str, values: list[float], rate: float, begin_s: float) -> SampleBlock:
    time_ns = START_NS + round(begin_s * NS_PER_S)
    return SampleBlock(channel, 0, time_ns, rate, np.array(values, np.float32))


def test_a_channel_with_figures_has_a_view_of_them_and_another_has_none() -> None:
    (view,) = figure_views(layout())
    assert isinstance(view, TimeSeriesView)
    assert view.name == "contact.force_upper, each cycle [N]"
    names = [channel.name for channel in DERIVED[:3]]
    assert view.contents == [f"+ {paths.derived(name)}" for name in names]


def test_derived_values_are_shown_at_their_own_times_also_before_any_block_is_shown() -> None:
    """Sample 0 of a series is the first whole cycle of the record, not its sample 0."""
    recording = KeptRecording()
    shown = layout(PLANAR)
    scene = Scene(recording, shown, 3.0)
    record = [Block("measured", a_block("contact.force_upper", [0.0] * 3000, 1000.0, 0.0))]
    found = [
        Block("derived", a_block("contact.force_upper.cycle_peak", [4.0, 5.0, 6.0], 20.0, 0.04)),
        Block("derived", a_block("crank.speed", [199.0, nan], 50.0, 0.5)),
    ]
    scene.show([*record, *found])
    scene.finish()
    assert recording.times_s[paths.derived("contact.force_upper.cycle_peak")] == pytest.approx(
        [0.04, 0.09, 0.14]
    )
    assert recording.times_s["/speed/measured"] == pytest.approx([0.5])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_scalars_are_the_columns_that_rerun_makes(dtype: type) -> None:
    values = np.array([1.5, nan, -2.0], dtype)
    (own,), (theirs,) = scalars(values), rr.Scalars.columns(scalars=values)
    assert own.component_descriptor() == theirs.component_descriptor()
    assert own.as_arrow_array().type == theirs.as_arrow_array().type
    assert str(own.as_arrow_array()) == str(theirs.as_arrow_array())


def dots(recording: KeptRecording, whose: str) -> NDArray[np.float64]:
    """Where the latest dots lie, shape (n, 2)."""
    (path,) = (path for path in recording.logged if path.endswith(f"/{whose}"))
    return np.array(recording.logged[path].positions.as_arrow_array().to_pylist())


def test_impacts_lie_at_their_crank_angle_and_one_without_angle_nowhere() -> None:
    recording = KeptRecording()
    shown = ImpactPicture(Stage(recording, layout()), "crank y", "m/s2")
    for turns, peak in ((7.0, 10.0), (8.25, 20.0), (9.5, 40.0), (nan, 30.0)):
        shown.add("measured", 0.1, impact(turns, peak))
    shown.finish()
    places = dots(recording, "measured")
    assert len(places) == 3
    across, down = places.T
    assert across[1] - across[0] == pytest.approx(across[2] - across[1])
    assert down[0] - down[1] == pytest.approx((down[1] - down[2]) / 2)


@pytest.mark.parametrize(("louder", "softer"), [("measured", "predicted"), ("predicted", "measured")])
def test_a_larger_peak_of_one_origin_changes_the_scale_of_both(louder: str, softer: str) -> None:
    recording = KeptRecording()
    shown = ImpactPicture(Stage(recording, layout()), "crank y", "m/s2")
    for whose, peak, at_s in ((softer, 10.0, 2.0), (louder, 10.0, 2.0), (louder, 80.0, 4.0)):
        shown.add(whose, at_s, impact(7.0, peak))
    shown.finish()
    assert dots(recording, softer)[0] == pytest.approx(dots(recording, louder)[0])


def test_impacts_of_the_beam_are_shown_where_their_origin_is() -> None:
    recording = KeptRecording()
    shown = layout(BeamPicture(0.28, 0.019, 0.127e-3))
    scene = Scene(recording, shown, 3.0)
    scene.show([impact(nan, 12.0, "predicted")])
    scene.finish()
    assert recording.logged[paths.peaks("predicted")].scalars.as_arrow_array().to_pylist() == [12.0]
    assert paths.peaks("measured") not in recording.logged

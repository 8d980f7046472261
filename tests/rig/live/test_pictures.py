"""Every rig has a picture, and a picture's mechanism is where the twin's is."""

from __future__ import annotations

import pickle
from dataclasses import replace
from math import pi

import numpy as np
import pytest

from daq.channel import Channel
from rig.files.scenario import parse_scenario
from rig.live.blueprint import blueprint, channel_view
from rig.live.crank_picture import CrankPicture
from rig.live.picture import layout_of, picture_of
from rig.live.rigs.impact_beam import BeamPicture
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.rigs.spatial_slider_crank import SpatialCrankPicture
from rig.rigs import RIGS as KINDS
from rig.twin.scenario_twin import predicted_channels, twin_of
from sim_twin.twin import AnyTwin
from tests.rig.synthetic_run import CHANNELS
from tests.sim_twin.every_rig import RIGS

DRIVES = {"impact_beam": 'frequency = "5 Hz"\namplitude = "9 N"'}
ACQUISITION = 'sample_rate = "25.6 kHz"\nduration = "1 s"'
ANGLES = np.linspace(0.1, 6.2, 9)


def nominal(rig: str, model: str = "") -> AnyTwin:
    drive = DRIVES.get(rig, 'speed = "200 rpm"')
    text = f'rig = "{rig}"\n[model]\n{model}\n[drive]\n{drive}\n[acquisition]\n{ACQUISITION}\n'
    return twin_of(parse_scenario(text, "test"))


def crank_picture(rig: str, model: str = "") -> CrankPicture:
    picture = picture_of(nominal(rig, model))
    assert isinstance(picture, CrankPicture)
    return picture


@pytest.mark.parametrize("rig", ["planar_slider_crank", "spatial_slider_crank"])
def test_a_picture_knows_at_which_angle_the_mark_comes(rig: str) -> None:
    twin = nominal(rig)
    picture = picture_of(replace(twin, rig=replace(twin.rig, marker_angle=0.7)))
    assert isinstance(picture, CrankPicture)
    assert picture.marker_angle_rad == 0.7


def test_every_rig_has_a_picture() -> None:
    assert all(kind.picture for kind in KINDS.values())
    kinds = [type(picture_of(nominal(rig))) for rig in RIGS]
    assert kinds == [BeamPicture, PlanarCrankPicture, SpatialCrankPicture]


@pytest.mark.parametrize("rig", RIGS)
def test_a_layout_with_a_picture_travels_to_another_process(rig: str) -> None:
    twin = nominal(rig)
    layout = layout_of("run", predicted_channels(twin), [], picture_of(twin), 2.0)
    assert pickle.loads(pickle.dumps(layout)) == layout  # noqa: S301 - our own


def test_beside_a_nominal_twin_the_prediction_is_called_repaired() -> None:
    alone, both = layout_of("run", CHANNELS, CHANNELS), layout_of("run", CHANNELS, CHANNELS, nominal=CHANNELS)
    assert [layout.whose("predicted") for layout in (alone, both)] == ["predicted", "repaired"]
    assert list(both.origins) == ["measured", "nominal", "predicted"]  # drawn in this order, the last on top


@pytest.mark.parametrize("count", [16, 64])
def test_a_page_of_reruns_holds_what_can_be_told_apart(count: int) -> None:
    channels = [Channel(f"beam.acceleration_{number:02d}", "m/s2") for number in range(count)]
    upright, _ = blueprint(layout_of("run", channels, channels, None)).root_container.contents
    traces, spectra = upright.contents
    for each, unit in ((traces, "m/s²"), (spectra, "(m/s²)²/Hz")):
        views = [view for page in each.contents for view in page.contents]
        assert [view.name for view in views] == [f"{channel.name} [{unit}]" for channel in channels]
        assert max(len(page.contents) for page in each.contents) <= 12
        assert {page.grid_columns for page in each.contents} == {3}


def test_a_surrogate_is_drawn_in_the_view_of_its_channel() -> None:
    layout = layout_of("run", CHANNELS, CHANNELS, surrogate=CHANNELS[:1])
    assert layout.whose(list(layout.origins)[-1]) == "surrogate"
    drawn = [channel_view(layout, channel.name).contents for channel in CHANNELS[:2]]
    assert [len(paths) for paths in drawn] == [3, 2]


@pytest.mark.parametrize("rig", RIGS)
def test_a_picture_speaks_of_channels_that_its_rig_has(rig: str) -> None:
    twin = nominal(rig)
    picture = picture_of(twin)
    assert picture is not None
    own = picture.views(layout_of("run", predicted_channels(twin), []))
    beside = {"crank.angle", "encoder.angle"}  # an encoder may be there beside a marker
    assert own.plain - beside <= set(twin.channels)
    if isinstance(picture, CrankPicture):
        shown = layout_of("run", predicted_channels(twin), [])
        assert picture.turning(shown) == picture.channels.ordered
        assert picture.heard(shown) == picture.channels.heard(twin.channels)
        assert picture.channels.marker in twin.channels
        assert picture.speed_rad_s == pytest.approx(200 * 2 * pi / 60)


@pytest.mark.parametrize(
    ("rig", "model"),
    [
        ("planar_slider_crank", ""),
        ("spatial_slider_crank", 'axis_angle = "90 deg"'),
        ("spatial_slider_crank", 'axis_angle = "65 deg"'),
    ],
)
def test_the_mechanism_is_where_the_twins_is(rig: str, model: str) -> None:
    twin, picture = nominal(rig, model), crank_picture(rig, model)
    poses = picture.poses(ANGLES)
    for number, angle in enumerate(ANGLES):
        truth = twin.model.truth(twin, 25_600.0, False)
        truth.change_drive(twin.drive, float(angle), 0.0)  # starts with centred joints
        points = truth.shape()
        flat = points.shape[1] == 2
        points = np.column_stack((points, np.zeros(len(points)))) if flat else points
        bearing, socket, slider = points[0], points[1], points[-1]
        crank, rod, last = ((pose.place[number], pose.turned[number]) for pose in poses)
        assert crank[0] == pytest.approx(bearing, abs=1e-12)
        assert crank[0] + crank[1] @ [picture.crank_m, 0, 0] == pytest.approx(socket, abs=1e-12)
        assert rod[0] == pytest.approx(socket, abs=1e-12)
        assert rod[0] + rod[1] @ [picture.rod_m, 0, 0] == pytest.approx(slider, abs=1e-12)
        assert last[0] == pytest.approx(slider, abs=1e-12)
        for _, turned in (crank, rod, last):
            assert turned @ turned.T == pytest.approx(np.eye(3), abs=1e-12)
            assert np.linalg.det(turned) == pytest.approx(1.0)


@pytest.mark.parametrize(("angle", "stroke_m"), [("90 deg", 0.100), ("65 deg", 0.0906)])
def test_the_slider_has_the_stroke_of_ideal_joints(angle: str, stroke_m: float) -> None:
    # The source's stroke: 100 mm, and 90.6 mm (3.6 in) at 65 degrees with intersecting axes.
    picture = crank_picture("spatial_slider_crank", f'axis_angle = "{angle}"')
    along = picture.poses(np.linspace(0, 2 * pi, 3601))[-1].place[:, 0]
    assert along.max() - along.min() == pytest.approx(stroke_m, abs=5e-5)


def test_journals_are_shown_where_they_are_in_their_bearings() -> None:
    planar = crank_picture("planar_slider_crank", 'clearance_1 = "2 mm"')
    points = np.array([[0, 0], [0.15, 0.001], [0.149, 0.0], [0.7, 0.0], [0.7, 0.0005]])
    assert planar.eccentricity(points) == pytest.approx(np.array([[1e-3, 1e-3], [0.0, 5e-4]]))
    assert [joint.clearance_m for joint in planar.joints()] == [2e-3, 1e-3]
    spatial = crank_picture("spatial_slider_crank")
    space = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.0501, 2e-4, -1e-4], [0.24, 1e-4, 2e-4]])
    expected = np.array([[1e-4, 2e-4], [1e-4, -1e-4], [1e-4, 2e-4]])
    assert spatial.eccentricity(space) == pytest.approx(expected)
    assert len(spatial.joints()) == len(expected)


def test_a_rig_without_a_picture_is_shown_without(monkeypatch: pytest.MonkeyPatch) -> None:
    twin = nominal("planar_slider_crank")
    without = replace(KINDS["planar_slider_crank"], picture="")
    monkeypatch.setattr("rig.live.picture.RIGS", {"planar_slider_crank": without})
    assert picture_of(replace(twin)) is None

"""The views of the slider-cranks as the operator sees them, in Rerun's own viewer without a screen."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rerun.experimental import ViewerClient

from daq.channel import Channel
from daq.log.reader import Origin
from rig.derived.derivation import Derivation, derived_channels
from rig.files.scenario import parse_scenario
from rig.live.crank_picture import CrankPicture
from rig.live.picture import layout_of
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.rigs.spatial_slider_crank import SpatialCrankPicture
from rig.live.view import LiveView
from rig.stream import Block, Shape, Stream
from tests.rig.derived.turning import CHANNELS, RATE, SPATIAL_CHANNELS, SPEED_HZ, blocks
from tests.rig.live.native_viewer import needs_vulkan, shows, viewer

SCENARIO = """
[drive]
speed = "200 rpm"

[acquisition]
sample_rate = "25.6 kHz"
duration = "5 s"
"""
SPEED_RAD_S = 2 * np.pi * SPEED_HZ
PLANAR = PlanarCrankPicture(0.150, 0.564, 1e-3, 1e-3, SPEED_RAD_S)
PLANAR_SHAPE = np.array([[0, 0], [0.15, 0], [0.1495, 5e-4], [0.7135, 5e-4], [0.7145, 0]])
SPATIAL = SpatialCrankPicture(
    0.05, 0.19, 3.2e-3, 1.2, (0.0, 0.0, 0.0), 6.5e-3, 25e-3, 0.25e-3, 0.25e-3, SPEED_RAD_S
)
SPATIAL_SHAPE = np.array([[0, 0, 0], [0.05, 0, 0], [0.0502, 0, 1e-4], [0.2402, 2e-4, -1e-4]])
pytestmark = [pytest.mark.long, pytest.mark.browser]


def seen(client: ViewerClient, folder: Path, wanted: dict[str, set[str]]) -> set[str]:
    """Those of the views, by the beginnings of their names, in which all the wanted colours can be seen."""
    found = set()
    for view in client.get_state().views:
        for name, origins in wanted.items():
            if view.name.startswith(name):
                client.save_screenshot(str(folder / "view.png"), view.view_id)
                with Image.open(folder / "view.png") as picture:
                    found |= {name} if all(shows(picture, origin) for origin in origins) else set()
    return found


def left_to_see(client: ViewerClient, folder: Path, wanted: dict[str, set[str]]) -> set[str]:
    try:
        return set(wanted) - seen(client, folder, wanted)
    except (RuntimeError, ConnectionError) as error:  # no picture of a view that is still being laid out
        return {str(error)}


@needs_vulkan
@pytest.mark.parametrize(
    ("picture", "channels", "shape", "impacts"),
    [
        (PLANAR, CHANNELS, PLANAR_SHAPE, "Impacts, crank y"),
        (SPATIAL, SPATIAL_CHANNELS, SPATIAL_SHAPE, "Impacts, guide"),
    ],
    ids=["planar", "spatial"],
)
def test_mechanism_journals_orders_impacts_and_speed_are_drawn(
    picture: CrankPicture, channels: tuple[Channel, ...], shape: np.ndarray, impacts: str, tmp_path: Path
) -> None:
    two = {"measured", "predicted"}
    wanted = {
        "Mechanism": two,
        impacts: two,
        **{f"{name} over orders": two for name in picture.channels.ordered},
    }
    wanted |= {"Predicted: where journals": {"predicted"}, "Crank speed": two}
    scenario = parse_scenario(f'rig = "{picture.rig}"\n{SCENARIO}')
    origins: dict[Origin, tuple[Channel, ...]] = {"measured": channels, "predicted": channels}
    found = derived_channels(origins, scenario)
    with LiveView(layout_of("a crank", channels, channels, picture, derived=found)) as live:
        names = {origin: [channel.name for channel in each] for origin, each in origins.items()}
        derivation = Derivation(live.offer, names, scenario)
        stream = Stream([live.offer, derivation])
        both = (blocks(channels, origin, 6.0) for origin in origins)
        for number, (first, second) in enumerate(zip(*both, strict=True)):
            stream(Block("measured", first))
            stream(Block("predicted", second))
            stream(Shape(first.end_sample / RATE, shape * (1 + 1e-4 * np.sin(number))))
        derivation.finish()
        with viewer("--connect", live.sink_url) as client:
            deadline = time.monotonic() + 60.0
            while missing := left_to_see(client, tmp_path, wanted):
                assert time.monotonic() < deadline, f"not drawn: {missing}"
            assert [view.reports for view in client.get_state().views if view.reports] == []
        assert live.dropped == 0

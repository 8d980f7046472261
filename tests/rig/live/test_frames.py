import io
from math import nan

import numpy as np
import pytest

from daq.block import Flag, SampleBlock
from daq.log.records import Event, Impact
from rig.live import frames
from rig.live.layout import Layout, layout_of
from rig.live.rigs.impact_beam import BeamPicture
from rig.stream import Block, Shape
from tests.rig.synthetic_run import CHANNELS


def read(data: bytes) -> list[frames.Frame]:
    return list(frames.read_frames(io.BytesIO(data)))


def test_a_block_arrives_as_it_was_sent() -> None:
    values = np.linspace(-1.0, 1.0, 100, dtype=np.float32)
    block = SampleBlock(
        "contact.force_upper", 2**40, 1_790_000_000_123_456_789, 51_200.25, values, Flag.OVERLOAD
    )
    (frame,) = read(frames.encode(Block("predicted", block)))
    assert isinstance(frame, Block)
    assert frame.origin == "predicted"
    assert np.array_equal(frame.samples.values, values)
    for field in ("channel", "first_sample", "time_ns", "sample_rate", "flags"):
        assert getattr(frame.samples, field) == getattr(block, field)


def test_an_unwrapped_angle_keeps_its_double_precision() -> None:
    block = SampleBlock("crank.angle", 0, 0, 1.0, np.array([1e5 + 1e-9, 2e5]))
    (frame,) = read(frames.encode(Block("measured", block)))
    assert isinstance(frame, Block)
    assert frame.samples.values.tolist() == [1e5 + 1e-9, 2e5]


def test_frames_follow_each_other() -> None:
    event = Event(5, "warning", "daq_card", "overload", "über dem Bereich\n")
    shape = frames.encode(Shape(0.25, np.array([[0.0, 0.28], [0.0, 1e-4], [1.0, 2.0]])))
    found = read(shape + frames.encode(event) + frames.encode(frames.Dropped(7)))
    assert isinstance(found[0], Shape)
    assert found[0].points_m == pytest.approx(np.array([[0.0, 0.28], [0.0, 1e-4], [1.0, 2.0]]))
    assert found[1:] == [event, frames.Dropped(7)]


@pytest.mark.parametrize("turns", [12.75, nan])
def test_an_impact_arrives_as_it_was_found(turns: float) -> None:
    impact = Impact(
        1_790_000_000_123_456_789, "predicted", "socket.force", 7, 20, 9, 12.5, 11.0, 1e-3, 2e-4, 1, turns
    )
    (frame,) = read(frames.encode(impact))
    assert repr(frame) == repr(impact)  # NaN is not equal to itself


@pytest.mark.parametrize("length", [1, 7, 9, 30])
def test_a_sender_that_dies_within_a_frame_ends_the_stream(length: int) -> None:
    whole = frames.encode(frames.Dropped(1))
    assert read(whole + whole[:length]) == [frames.Dropped(1)]


def test_a_layout_travels_as_text() -> None:
    layout = layout_of("run", CHANNELS, CHANNELS[:2], BeamPicture(0.28, 0.019, 0.127e-3), 0.5)
    assert Layout.from_json(layout.to_json()) == layout


def test_beside_a_nominal_twin_the_prediction_is_called_repaired() -> None:
    alone, both = layout_of("run", CHANNELS, CHANNELS), layout_of("run", CHANNELS, CHANNELS, nominal=CHANNELS)
    assert [layout.whose("predicted") for layout in (alone, both)] == ["predicted", "repaired"]
    assert list(both.origins) == ["measured", "nominal", "predicted"]  # drawn in this order, the last on top

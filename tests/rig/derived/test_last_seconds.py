import numpy as np

from daq.block import SampleBlock
from rig.stream import LastSeconds


def block(first: int, *values: float) -> SampleBlock:
    return SampleBlock("drive.force", first, 0, 10.0, np.array(values, np.float32))


def test_old_samples_are_forgotten_and_missing_ones_are_nan() -> None:
    recent = LastSeconds(seconds=0.5)
    recent.add(block(0, 1.0, 2.0))
    recent.add(block(4, 5.0, 6.0))
    assert np.array_equal(recent.between(1, 6), [2.0, np.nan, np.nan, 5.0, 6.0], equal_nan=True)
    recent.add(block(6, 7.0))
    assert (recent.first_sample, recent.end_sample) == (4, 7)


def test_a_stream_that_starts_again_forgets_the_old_one() -> None:
    recent = LastSeconds(seconds=100.0)
    recent.add(block(50, 1.0))
    recent.add(block(0, 2.0))
    assert (recent.first_sample, recent.end_sample) == (0, 1)

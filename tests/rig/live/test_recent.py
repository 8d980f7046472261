import numpy as np

from daq.block import SampleBlock
from rig.live.half_cycle_peaks import HalfCyclePeaks
from rig.live.recent import Recent
from tests.rig.synthetic_run import CHANNELS, PEAK_N, blocks


def block(first: int, *values: float) -> SampleBlock:
    return SampleBlock("drive.force", first, 0, 10.0, np.array(values, np.float32))


def test_old_samples_are_forgotten_and_missing_ones_are_nan() -> None:
    recent = Recent(seconds=0.5)
    recent.add(block(0, 1.0, 2.0))
    recent.add(block(4, 5.0, 6.0))
    assert np.array_equal(recent.between(1, 6), [2.0, np.nan, np.nan, 5.0, 6.0], equal_nan=True)
    recent.add(block(6, 7.0))
    assert (recent.first_sample, recent.end_sample) == (4, 7)


def test_a_stream_that_starts_again_forgets_the_old_one() -> None:
    recent = Recent(seconds=100.0)
    recent.add(block(50, 1.0))
    recent.add(block(0, 2.0))
    assert (recent.first_sample, recent.end_sample) == (0, 1)


def test_half_cycles_are_reported_once_each_while_the_run_goes_on() -> None:
    peaks = HalfCyclePeaks()
    found = [peak for each in blocks(CHANNELS, "measured", 8.0) for peak in peaks.add(each)]
    times = np.array([peak.time_s for peak in found])
    assert np.allclose(np.diff(times), 0.025, atol=1e-4)  # a half cycle of the drive, to some samples
    # 320 in 8 s, but the last tenth of a second has not come on both sides, and one half cycle is open.
    assert len(found) == 315
    forces = [peak.force_n for peak in found]
    assert np.allclose(forces, PEAK_N["measured"], rtol=5e-3)

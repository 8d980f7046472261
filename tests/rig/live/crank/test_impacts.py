import numpy as np
import pytest
from numpy.typing import NDArray

from daq.block import SampleBlock
from rig.live.crank.impact_peaks import BlowsByAngle, ImpactPeaks
from rig.live.crank.turns import EncoderTurns
from tests.rig.live.crank.turning import (
    BLOW_AT,
    BLOW_MS2,
    BLOW_N,
    SPEED_HZ,
    acceleration,
    encoder_rad,
    force,
    in_blocks,
    noise,
    turns,
)

SECONDS = 6.0
WAY = turns(SECONDS)
REVOLUTIONS = np.floor(WAY[-1] - BLOW_AT) - np.floor(WAY[0] - BLOW_AT)


def blows(values: NDArray[np.floating], unit: str, length: int = 2560) -> BlowsByAngle:
    """All blows of a channel, placed by an encoder."""
    peaks, found, encoder = ImpactPeaks(unit), BlowsByAngle(1000), EncoderTurns("crank.angle")
    pairs = zip(
        in_blocks("x", values, length), in_blocks("crank.angle", encoder_rad(WAY), length), strict=True
    )
    for block, angle in pairs:
        found.add(peaks.add(block))
        encoder.add(angle)
        found.place(encoder)
    return found


@pytest.mark.parametrize("length", [700, 2560])
def test_contacts_of_a_force_have_their_angle_and_their_peak(length: int) -> None:
    found = blows(force(WAY), "N", length).newest
    assert len(found) == REVOLUTIONS
    middle = BLOW_AT + 0.5e-3 * SPEED_HZ
    assert [blow.place for blow in found] == pytest.approx([middle] * len(found), abs=2e-3 * SPEED_HZ)
    # The noise's largest of the samples about the crest, four times its rms.
    assert [blow.peak for blow in found] == pytest.approx([BLOW_N] * len(found), abs=0.2)


def test_an_acceleration_shows_its_blows_and_not_its_ringing() -> None:
    found = blows(acceleration(WAY), "m/s2").newest
    assert len(found) == REVOLUTIONS
    assert [blow.place for blow in found] == pytest.approx([BLOW_AT] * len(found), abs=1e-3 * SPEED_HZ)
    # A pulse of 0.1 ms lies mostly above 1 kHz; where the samples fall in it changes its crest.
    assert all(0.5 * BLOW_MS2 < blow.peak < 1.1 * BLOW_MS2 for blow in found)


@pytest.mark.parametrize(("unit", "rms"), [("N", 0.05), ("m/s2", 0.05)])
def test_noise_alone_holds_no_impact(unit: str, rms: float) -> None:
    assert not blows(noise(len(WAY), rms).astype(np.float32), unit).newest


def test_a_sampling_rate_too_low_for_blows_shows_none() -> None:
    peaks = ImpactPeaks("m/s2")
    values = noise(20_000, 50.0).astype(np.float32)
    assert not len(peaks.add(SampleBlock("x", 0, 0, 2000.0, values)))


def test_blows_wait_for_their_angle_but_not_for_ever() -> None:
    found, encoder = BlowsByAngle(5), EncoderTurns("crank.angle")
    peaks = ImpactPeaks("N")
    for block in in_blocks("x", force(WAY)):
        found.add(peaks.add(block))
    assert not found.place(encoder)
    for angle in in_blocks("crank.angle", encoder_rad(WAY)):
        encoder.add(angle)
    assert found.place(encoder)
    assert len(found.newest) == 5
    assert not found.place(encoder)


def test_after_a_hole_impacts_are_found_where_they_are() -> None:
    peaks = ImpactPeaks("N")
    values, half = force(WAY), len(WAY) // 2
    found = [
        index
        for block in (*in_blocks("x", values[: half - 3000]), *in_blocks("x", values[half:], first=half))
        for index in peaks.add(block).index.tolist()
    ]
    middle = BLOW_AT + 0.5e-3 * SPEED_HZ
    assert len(found) >= REVOLUTIONS - 1
    assert WAY[found] % 1.0 == pytest.approx(middle, abs=2e-3 * SPEED_HZ)

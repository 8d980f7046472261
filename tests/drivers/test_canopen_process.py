"""The emulated encoder in a process of its own, at full rate."""

from __future__ import annotations

import time

import numpy as np

from daq.block import Flag
from drivers.canopen_cia406.emulator.process import EncoderSetup, start_encoder
from tests.drivers.encoders import CALM_MS, opened, slow_shaft, socketcand

FRAMES = 2500
SHARE = 0.25  # of a core at 1 kHz, 4 % on an idle machine; twice the rate must leave half a core for the rest


def test_two_seconds_and_a_half_at_1_khz_without_loss() -> None:
    setup = EncoderSetup(heartbeat_ms=CALM_MS)
    with start_encoder(slow_shaft, setup) as emulator, opened(socketcand(emulator.address)) as encoder:
        encoder.start()
        encoder.read(10)
        before = time.process_time()
        numbers = []
        for _ in range(FRAMES // 100):
            block = encoder.read(100)
            assert (block.gaps, block.flags) == ((), Flag.GOOD)
            numbers.append(block.number)
        share = (time.process_time() - before) / (FRAMES * encoder.period_s)
        statistics = encoder.statistics
        notices = encoder.take_notices()
    assert np.array_equal(np.concatenate(numbers), np.arange(10, 10 + FRAMES))
    assert (statistics.missing, statistics.duplicates, statistics.reordered, notices) == (0, 0, 0, ())
    print(f"driver at 1 kHz: {share:.1%} of a core")
    assert share < SHARE

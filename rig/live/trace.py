"""One channel's samples as a line: envelopes, sent in batches that are worth their overhead."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from daq.block import NS_PER_S, SampleBlock
from daq.signals.envelope import envelope
from rig.live import paths

_BATCH_S = 0.5
"""A browser pays for every batch, whatever is in it, so that small ones are costly."""


class Trace:
    """Keeps the envelope of the newest blocks of one channel until a batch of them is full."""

    def __init__(self, recording: rr.RecordingStream, path: str, points_per_s: float) -> None:
        self._recording = recording
        self._path = path
        self._points_per_s = points_per_s
        self._times: list[NDArray[np.timedelta64]] = []
        self._values: list[NDArray[np.floating]] = []
        self._waiting_s = 0.0

    def add(self, block: SampleBlock) -> None:
        """Take a block, and send the batch if that fills it."""
        seconds = len(block) / block.sample_rate
        chosen = envelope(block.values, max(round(self._points_per_s * seconds), 4))
        times_ns = (block.first_sample + chosen.indices) * (NS_PER_S / block.sample_rate)
        self._times.append(times_ns.round().astype("m8[ns]"))
        self._values.append(chosen.values)
        self._waiting_s += seconds
        if self._waiting_s >= _BATCH_S:
            self.flush()

    def flush(self) -> None:
        """Send what waits."""
        if not self._values:
            return
        self._recording.send_columns(
            self._path,
            [rr.TimeColumn(paths.TIMELINE, duration=np.concatenate(self._times))],
            rr.Scalars.columns(scalars=np.concatenate(self._values)),
        )
        self._times, self._values, self._waiting_s = [], [], 0.0

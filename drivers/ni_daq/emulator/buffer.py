"""What a running task has measured and nobody has read yet."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import DTypeLike, NDArray

from drivers.ni_daq.emulator.wiring import DaqmxError


class SampleBuffer:
    """Rows of samples, kept until they are read or overwritten; one thread puts, another reads."""

    def __init__(self, rows: int, size: int, dtype: DTypeLike = np.float64) -> None:
        self._ring: NDArray[Any] = np.zeros((rows, size), dtype=dtype)
        self._made = self._taken = 0
        self._fault: DaqmxError | None = None
        self._changed = threading.Condition()

    @property
    def made(self) -> int:
        """Samples per channel so far."""
        return self._made

    @property
    def available(self) -> int:
        """Samples per channel that wait to be read."""
        return self._made - self._taken

    def put(self, values: NDArray[Any]) -> None:
        """Keep the next samples, shape (rows, n) with n up to the size."""
        count = values.shape[1]
        with self._changed:
            size = self._ring.shape[1]
            first = self._made % size
            head = min(count, size - first)
            self._ring[:, first : first + head] = values[:, :head]
            self._ring[:, : count - head] = values[:, head:]
            self._made += count
            self._changed.notify_all()

    def fail(self, fault: DaqmxError) -> None:
        """Let whoever waits for samples that will not come know why."""
        with self._changed:
            self._fault = self._fault or fault
            self._changed.notify_all()

    def read(self, count: int, timeout_s: float) -> NDArray[Any]:
        """Return the next `count` samples, shape (rows, count); waits for ever where `timeout_s` < 0."""
        with self._changed:
            self._changed.wait_for(
                lambda: self.available >= count or self._fault is not None,
                None if timeout_s < 0 else timeout_s,
            )
            if self.available > self._ring.shape[1]:
                text = "samples were overwritten before they were read"
                raise DaqmxError(DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE, text)
            if self.available < count:
                text = f"{self.available} of {count} samples within {timeout_s:g} s"
                raise self._fault or DaqmxError(DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE, text)
            values = self._ring.take(range(self._taken, self._taken + count), axis=1, mode="wrap")
            self._taken += count
        return values

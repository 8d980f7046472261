"""The DAQmx tasks behind a card: one for all analog inputs, and one a counter that follows its clock."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from nidaqmx.constants import AcquisitionType, TaskMode, Timescale, TimestampEvent
from nidaqmx.errors import DaqError, DaqWarning, Error
from nidaqmx.stream_readers import AnalogMultiChannelReader, CounterReader
from numpy.typing import NDArray

from daq.block import NS_PER_S
from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.sensors import CounterSensor, Decoder, known_sensor

_STAMP_WAIT_S = 0.1
"""How long the stamp of the first sample may take; until it is there nothing is read."""


class AnalogTask:
    """All analog inputs, sampled by the chassis's own clock. Methods raise nidaqmx errors."""

    def __init__(self, task: Any, channels: Sequence[CardChannel], buffer_s: float) -> None:
        self._task, self._buffer_s = task, buffer_s
        self._scales = np.array([[known_sensor(channel).scale(channel) or 1.0] for channel in channels])
        marks = [(row, channel.mark) for row, channel in enumerate(channels)]
        self._offsets = {row: mark.offset for row, mark in marks if mark is not None and mark.offset}
        self._raw: NDArray[np.float64] = np.empty((len(channels), 0))
        self._reader = AnalogMultiChannelReader(task.in_stream)
        self._reader.verify_array_shape = False  # it would cost a call for each read

    @property
    def stream(self) -> Any:
        """Where the device tells of itself."""
        return self._task.in_stream

    def set_rate(self, rate_hz: float) -> float:
        """Ask for a rate and return that which the device takes instead, in Hz."""
        timing = self._task.timing
        # DAQmx stops a task rather than overwrite what nobody has read. Its own choice from 10 kHz on is
        # 100,000 samples for each channel: 1.95 s at 51.2 kHz.
        buffer = max(round(rate_hz * self._buffer_s), 2)
        timing.cfg_samp_clk_timing(rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=buffer)
        return float(timing.samp_clk_rate)

    def rates_near(self, asked: float) -> list[float]:
        """Return the rates that the device has around `asked`; leaves it at another one."""
        # DAQmx takes the next higher rate that the device has; asking for ever less finds the next lower one.
        near = {self.set_rate(asked)}
        for step in range(1, 40):
            try:
                rate = self.set_rate(asked * 0.98**step)
            except DaqError:
                break
            near.add(rate)
            if rate < asked:
                break
        return sorted(near)

    def commit(self) -> None:
        """Reserve and program the hardware, so that `start` has nothing left to do but to start it."""
        self._task.control(TaskMode.TASK_COMMIT)

    def stamp_by_host(self) -> bool:
        """Have the first sample stamped in the host's time; False for a device that stamps nothing.

        Network-synchronized ones do, and by themselves: NI-DAQmx manual, "Timestamps".
        """
        timing = self._task.timing
        if timing.first_samp_timestamp_enable:
            timing.first_samp_timestamp_timescale = Timescale.USE_HOST
            return True
        return False

    def started_ns(self) -> int:
        """The stamp of the first sample, Unix epoch, ns; a warning that it is inaccurate is raised too."""
        with warnings.catch_warnings():
            warnings.simplefilter("error", DaqWarning)
            # A late or inaccurate stamp comes with a DaqWarning, which by default would only be printed.
            stamp = self._task.wait_for_valid_timestamp(TimestampEvent.FIRST_SAMPLE, _STAMP_WAIT_S)
        return round(float(stamp.timestamp()) * NS_PER_S)

    def start(self) -> None:
        """Start the sample clock, and with it the counters."""
        self._task.start()

    def stop(self) -> None:
        self._task.stop()

    def close(self) -> None:
        """Give the inputs back; silent where the device is gone."""
        give_back(self._task)

    def waiting(self) -> int:
        """Samples of each channel that are in the driver's buffer."""
        return int(self._task.in_stream.avail_samp_per_chan)

    def read(self, count: int, timeout_s: float) -> NDArray[np.float64]:
        """Return the next samples in the channels' units, shape (channels, n); n < `count` if fewer came."""
        if self._raw.shape[1] != count:
            # Kept from read to read: a block is nearly always as long as the one before.
            self._raw = np.empty((len(self._raw), count))
        came = self._reader.read_many_sample(self._raw, count, timeout_s)
        values: NDArray[np.float64] = self._raw[:, :came] * self._scales
        for row, offset in self._offsets.items():
            values[row] += offset
        return values


class CounterTask:
    """One counter, read at the edges of another task's sample clock. Methods raise nidaqmx errors.

    It has to be started before that clock, so that its first sample is the clock's first.
    """

    def __init__(self, task: Any, channel: CardChannel) -> None:
        self._task, self.channel = task, channel
        self._sensor: CounterSensor = known_sensor(channel)
        self._decode: Decoder = self._sensor.decoder(channel)
        self._raw: NDArray[Any] = np.empty(0, dtype=self._sensor.dtype)
        reader = CounterReader(task.in_stream)
        reader.verify_array_shape = False
        self._read = getattr(reader, self._sensor.read)

    def follow(self, clock: str, rate_hz: float, buffer_s: float) -> None:
        """Be sampled by the terminal `clock`, which runs at `rate_hz`."""
        self._task.timing.cfg_samp_clk_timing(
            rate_hz,
            # The analog task's clock: counts and voltages of one instant have one index.
            source=clock,
            sample_mode=AcquisitionType.CONTINUOUS,
            samps_per_chan=max(round(rate_hz * buffer_s), 2),
        )

    def start(self) -> None:
        """Arm; counting from now on, samples with the clock's first edge."""
        self._decode = self._sensor.decoder(self.channel)
        self._task.start()

    def stop(self) -> None:
        self._task.stop()

    def close(self) -> None:
        """Give the counter back; silent where the device is gone."""
        give_back(self._task)

    def read(self, count: int, timeout_s: float) -> NDArray[np.float64]:
        """Return the next samples in the channel's unit, shape (n,); n < `count` where it fell behind."""
        if len(self._raw) != count:
            self._raw = np.empty(count, dtype=self._sensor.dtype)
        return self._decode(self._raw[: self._read(self._raw, count, timeout_s)])


def give_back(task: Any) -> None:
    """Close a task; silent where the device is gone, for then there is nothing to give back."""
    with suppress(Error, ValueError):
        task.close()

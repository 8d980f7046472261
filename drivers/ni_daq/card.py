"""An NI card that samples continuously; the same code for the local driver and a gRPC device server."""

from __future__ import annotations

from datetime import UTC, date, datetime
from typing import Any

import nidaqmx
import numpy as np
from nidaqmx.constants import AcquisitionType
from nidaqmx.errors import DaqError, Error, RpcError
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.system import System
from numpy.typing import NDArray

from daq import Channel, Clock, Flag, SystemClock
from daq.errors import ConfigurationError, DeviceLost, InstrumentAbsent, InstrumentRefused
from drivers.ni_daq import session
from drivers.ni_daq.channels import KINDS, CardChannel, CardSettings, problems
from drivers.ni_daq.faults import UNSUPPORTED, translated
from drivers.protocols import CardReading

RATE_TOLERANCE = 10e-6
WAIT_MARGIN_S = 1.0  # how much later than its last sample a block may come
FULL_SCALE = 0.99999  # a 24-bit code at full scale reads a little below the range


class NiDaqCard:
    """An `AcquisitionCard` over nidaqmx; its channels are those of `settings`, in that order."""

    def __init__(self, settings: CardSettings, clock: Clock | None = None) -> None:
        self.settings = settings
        self.name, self.address = settings.name, settings.grpc or "the NI driver of this machine"
        self.channels: tuple[Channel, ...] = tuple(channel.describe() for channel in settings.channels)
        self.identity = ""
        self.sample_rate = 0.0
        self.warnings = _expired(settings.channels, _today(clock or SystemClock()))
        self._scales = np.array([[channel.scale or 1.0] for channel in self.channels])
        self._limits = np.array([[channel.range * FULL_SCALE] for channel in settings.channels])
        self._rows = {channel.physical: row for row, channel in enumerate(settings.channels)}
        self._grpc_channel: Any = None
        self._task: Any = None
        self._reader: Any = None
        self._raw: NDArray[np.float64] = np.empty((len(self.channels), 0))
        self._next_sample = 0
        self._status = {Flag.OVERLOAD: "overloaded_chans", Flag.OPEN_SENSOR: "open_chans"}

    def open(self) -> None:
        """Connect, check that all devices and channels are there, declare the sensors, set the clock."""
        found = problems(self.settings)
        if found:
            raise ConfigurationError(self.name, found)
        try:
            if self.settings.grpc is not None:
                self._grpc_channel = session.connect(self.name, self.settings.grpc)
            with self._translated("looking for its devices"):
                self._check_devices(self._system())
            self._create_task()
            self._set_clock()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Give the device back; silent where it is gone, for then there is nothing to give back."""
        task, self._task, self._reader = self._task, None, None
        channel, self._grpc_channel = self._grpc_channel, None
        try:
            if task is not None:
                task.close()
        except (Error, ValueError):
            pass
        finally:
            if channel is not None:
                channel.close()

    def start(self) -> None:
        """Start the sample clock."""
        with self._translated("starting"):
            self._opened().start()
        self._next_sample = 0

    def stop(self) -> None:
        """Stop the sample clock."""
        with self._translated("stopping"):
            self._opened().stop()

    @property
    def total_acquired(self) -> int:
        """Samples per channel taken since `start`."""
        with self._translated("counting samples"):
            return int(self._opened().in_stream.total_samp_per_chan_acquired)

    def read(self, count: int) -> CardReading:
        """Wait for the next `count` samples of every channel; see `AcquisitionCard.read`.

        The device's overload and open-sensor status covers what it took since it was last asked, which may be
        a little more than the block; a value at or beyond the channel's range marks its own block.
        """
        task = self._opened()
        if self._raw.shape[1] != count:
            self._raw = np.empty((len(self.channels), count))
        with self._translated(f"reading samples {self._next_sample} to {self._next_sample + count}"):
            self._reader.read_many_sample(self._raw, count, count / self.sample_rate + WAIT_MARGIN_S)
            reported = self._reported(task.in_stream)
        first, self._next_sample = self._next_sample, self._next_sample + count
        values = self._raw * self._scales
        return CardReading(first, values, self._flags(values, reported))

    def _opened(self) -> Any:
        if self._task is None:
            raise DeviceLost(self.name, self.address, "the card is not open")
        return self._task

    def _options(self) -> Any:
        # A session belongs to one task or system, so each gets its own over the one channel.
        return None if self._grpc_channel is None else nidaqmx.GrpcSessionOptions(self._grpc_channel, "")

    def _system(self) -> Any:
        return System.local() if self._grpc_channel is None else System.remote(self._options())

    def _check_devices(self, system: Any) -> None:
        present = {device.name: device for device in system.devices}
        wanted: dict[str, list[str]] = {}
        for physical in self._rows:
            wanted.setdefault(physical.partition("/")[0], []).append(physical)
        missing: list[str] = []
        identities: list[str] = []
        for device, physicals in wanted.items():
            if device not in present:
                missing += [f"{physical} (no device {device})" for physical in physicals]
                continue
            offered = set(present[device].ai_physical_chans.channel_names)
            missing += [f"{physical} (no such input)" for physical in physicals if physical not in offered]
            identities.append(_identity(present[device]))
        if missing:
            there = ", ".join(sorted(present)) or "no device at all"
            what = f"missing: {', '.join(missing)}; present: {there}"
            raise InstrumentAbsent(self.name, self.address, what, "the physical channels in the bench file")
        self.identity = "; ".join(identities)

    def _create_task(self) -> None:
        with self._translated("creating the task"):
            self._task = nidaqmx.Task(grpc_options=self._options())
        for channel in self.settings.channels:
            with self._translated(f"declaring {channel.name} on {channel.physical} as {channel.kind}"):
                KINDS[channel.kind].add(self._task, channel)
        self._reader = AnalogMultiChannelReader(self._task.in_stream)
        self._reader.verify_array_shape = False  # it would cost a call for each read

    def _set_clock(self) -> None:
        asked = self.settings.sample_rate_hz
        with self._translated(f"setting the sample rate to {asked:g} Hz"):
            self.sample_rate = self._coerced_rate(asked)
            if abs(self.sample_rate / asked - 1.0) <= RATE_TOLERANCE:
                return
            near = ", ".join(f"{rate:.7g}" for rate in self._rates_near(asked))
        raise InstrumentRefused(
            self.name,
            self.address,
            f"it has no sample rate of {asked:g} Hz; near it are {near} Hz",
            "acquisition.sample_rate in the scenario",
            "rate",
        )

    def _coerced_rate(self, rate_hz: float) -> float:
        buffer = max(round(rate_hz * self.settings.buffer_s), 2)
        self._task.timing.cfg_samp_clk_timing(
            rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=buffer
        )
        return float(self._task.timing.samp_clk_rate)

    def _rates_near(self, asked: float) -> list[float]:
        # DAQmx takes the next higher rate that the device has; asking for ever less finds the next lower one.
        near = {self.sample_rate}
        for step in range(1, 40):
            try:
                rate = self._coerced_rate(asked * 0.98**step)
            except DaqError:
                break
            near.add(rate)
            if rate < asked:
                break
        return sorted(near)

    def _reported(self, in_stream: Any) -> dict[Flag, set[str]]:
        reported: dict[Flag, set[str]] = {}
        for flag, attribute in list(self._status.items()):
            try:
                # DAQmx wants the question whether there are any before the one which they are.
                if getattr(in_stream, f"{attribute}_exist"):
                    reported[flag] = set(getattr(in_stream, attribute))
            except RpcError:
                raise
            except DaqError as error:
                if error.error_code not in UNSUPPORTED:
                    raise
                del self._status[flag]
                self.warnings += (f"{self.name} does not report {attribute}",)
        return reported

    def _flags(self, values: NDArray[np.float64], reported: dict[Flag, set[str]]) -> tuple[Flag, ...]:
        flags = [Flag.GOOD] * len(self.channels)
        for flag, names in reported.items():
            for row in (self._rows[name] for name in names if name in self._rows):
                flags[row] |= flag
        beyond = np.any(np.abs(values) >= self._limits, axis=1)
        finite = np.all(np.isfinite(values), axis=1)
        for row in range(len(flags)):
            flags[row] |= Flag.OVERLOAD if beyond[row] else Flag.GOOD
            flags[row] |= Flag.GOOD if finite[row] else Flag.NOT_FINITE
        return tuple(flags)

    def _translated(self, doing: str) -> Any:
        return translated(self.name, self.address, doing)


def _identity(device: Any) -> str:
    simulated = ", simulated" if device.is_simulated else ""
    return f"{device.name}: {device.product_type}, serial {device.serial_num:X}{simulated}"


def _today(clock: Clock) -> date:
    return datetime.fromtimestamp(clock.unix_ns() / 1e9, UTC).date()


def _expired(channels: tuple[CardChannel, ...], today: date) -> tuple[str, ...]:
    return tuple(
        f"{channel.name}: the calibration of {channel.sensor or 'sensor'} {channel.serial} "
        f"expired on {channel.valid_until.isoformat()}"
        for channel in channels
        if channel.valid_until is not None and channel.valid_until < today
    )

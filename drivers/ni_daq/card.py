"""An NI card that samples continuously; the same code for the local driver and a gRPC device server."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, date, datetime
from typing import Any

import nidaqmx
import numpy as np
from nidaqmx.errors import DaqError, DaqWarning, Error
from nidaqmx.system import System
from numpy.typing import NDArray

from daq.block import NS_PER_S, Flag
from daq.channel import Channel
from daq.clock import Clock, SystemClock, wall_less_monotonic_ns
from daq.errors import ConfigurationError, DeviceLost, InstrumentAbsent, InstrumentRefused, RecorderFailed
from drivers.ni_daq import session
from drivers.ni_daq.channels import CardChannel, CardSettings, problems
from drivers.ni_daq.quality import QualityWatch
from drivers.ni_daq.sensors import described, known_sensor
from drivers.ni_daq.survey import Survey, survey
from drivers.ni_daq.tasks import AnalogTask, CounterTask, give_back
from drivers.protocols.card import CardReading, Finding

RATE_TOLERANCE = 10e-6  # of the rate asked for: from there on the operator is told
LARGEST_RATE_ERROR = 0.01  # of the rate asked for: beyond it the run is refused, below it told
WAIT_MARGIN_S = 0.4
"""How much later than its last sample a block may come: a chassis hands on what it has every few ms, over USB
or a network, and a run bears no half second in which nobody was let run either."""
MOST_AT_ONCE = 4
"""Blocks that one call brings: where many threads share two cores it takes as long as a block lasts, however
few samples it is for."""
_STATUS = {
    "overloaded_chans": Flag.OVERLOAD,
    "open_chans": Flag.OPEN_SENSOR,
    "excit_fault_chans": Flag.OPEN_SENSOR,
    "pll_unlocked_chans": Flag.CLOCK_NOT_LOCKED,
}
_SELDOM, _EVERY = "pll_unlocked_chans", 4
"""Readings between questions about a clock: each is a call. What blinds a guard is asked with each."""
_FAULTS = {"excit_fault_chans": "the supply of its sensor is short-circuited or overloaded"}


class NiDaqCard:
    """An `AcquisitionCard` over nidaqmx; its channels are those of `settings`, in that order.

    Counters are started first and wait for the first edge of the analog task's sample clock, so that sample 0
    is the same for all.
    """

    def __init__(self, settings: CardSettings, clock: Clock | None = None) -> None:
        self.settings = settings
        modules = sorted({channel.physical.partition("/")[0] for channel in settings.channels})
        self.name = settings.name
        self.address = settings.grpc or f"the NI driver of this machine ({', '.join(modules)})"
        self.channels: tuple[Channel, ...] = tuple(described(channel) for channel in settings.channels)
        self.identity = ""
        self.sample_rate = 0.0
        self._clock = clock or SystemClock()
        today = datetime.fromtimestamp(self._clock.unix_ns() / NS_PER_S, UTC).date()
        self._expired = tuple(_expired(settings.channels, today))
        self.warnings = self._expired
        self.sheets: dict[str, str] = {}
        """What each sensor says of itself, in words; once it is open."""
        self._rows = {channel.physical: row for row, channel in enumerate(settings.channels)}
        self._analog_rows = [self._rows[channel.physical] for channel in _on(settings, "ai")]
        self._grpc_channel: Any = None
        self._analog: AnalogTask | None = None
        self._counters: list[CounterTask] = []
        self._armed = self._stamps = False  # committed but not started; whether the device stamps its start
        self._watch = QualityWatch((), 0.0)
        self._next_sample = 0
        self._fetched = np.empty((len(self.channels), 0))  # read from the device and not handed out yet
        self._arrived_s = self._least_lag_s = 0.0
        self._reported: list[tuple[str, int]] = []  # what the device said of them, by row
        self._asked = list(_STATUS)
        self._readings = 0
        self._unlocked: tuple[int, ...] = ()  # rows whose clock was not locked when last asked about

    def open(self) -> None:
        """Connect, check devices, channels and data sheets, declare the sensors, set the clock."""
        found = problems(self.settings)
        if found:
            raise ConfigurationError(self.name, found)
        self.warnings, self._stamps = self._expired, False
        self._asked = list(_STATUS)
        try:
            if self.settings.grpc is not None:
                self._grpc_channel = session.connect(self.name, self.settings.grpc)
            with self._translated("looking for its devices"):
                remote = self._grpc_channel is not None
                system = System.remote(self._options()) if remote else System.local()
                seen = survey(system, self.settings.channels, self._new_task)
            self._accept(seen)
            channels = _on(self.settings, "ai")
            self._analog = AnalogTask(self._declared(channels), channels, self.settings.buffer_s)
            self._set_clock(self._analog)
            # The start is stamped by this host's clock; that of a device server may be another machine's.
            if self.settings.grpc is None or seen.simulated:
                with suppress(Error):  # whatever device or server has against it: a run does without
                    self._stamps = self._analog.stamp_by_host()
            for channel in _on(self.settings, "ctr"):
                counter = CounterTask(self._declared([channel]), channel)
                self._counters.append(counter)
                sample_clock = f"/{seen.chassis}/ai/SampleClock"
                with self._translated(f"clocking {_label(counter)} by {sample_clock}"):
                    counter.follow(sample_clock, self.sample_rate, self.settings.buffer_s)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Give the device back; silent where it is gone, for then there is nothing to give back."""
        analog, self._analog = self._analog, None
        counters, self._counters = self._counters, []
        self._armed = False
        channel, self._grpc_channel = self._grpc_channel, None
        try:
            if analog is not None:
                analog.close()
            for counter in counters:
                counter.close()
        finally:
            if channel is not None:
                channel.close()

    def arm(self) -> None:
        """Start the counters, which wait for the sample clock's first edge, and commit the analog task."""
        analog = self._opened()
        for counter in self._counters:
            with self._translated(f"starting {_label(counter)}"):
                counter.start()
        with self._translated("reserving its inputs"):
            analog.commit()
        self._watch = QualityWatch(self.settings.channels, self.sample_rate)
        self._next_sample = self._readings = 0
        self._fetched = self._fetched[:, :0]
        self._armed = True

    def start(self) -> None:
        """Start the sample clock; arms before, where that has not been done."""
        analog = self._opened()
        if not self._armed:
            self.arm()
        self._armed = False
        with self._translated("starting"):
            analog.start()
        self._least_lag_s = self._clock.monotonic_s()

    def started_s(self) -> float | None:
        """When sample 0 was taken, by the device's own stamp; see `AcquisitionCard.started_s`."""
        if not self._stamps:
            return None
        with self._translated("asking when it started"):
            try:
                stamp_ns = self._opened().started_ns()
            except (DaqError, DaqWarning):  # late or inaccurate: as good as none
                return None
        return (stamp_ns - wall_less_monotonic_ns(self._clock)) / NS_PER_S

    def stop(self) -> None:
        with self._translated("stopping"):
            self._opened().stop()
        for counter in self._counters:
            with self._translated(f"stopping {_label(counter)}"):
                counter.stop()

    def read(self, count: int) -> CardReading:
        """Wait for the next `count` samples of every channel; see `AcquisitionCard.read`.

        The device's status covers what it took since it was last asked, which may be a little more than the
        block, and of its clock four readings; what the values themselves tell marks their own block. Where
        samples have piled up in the device, one call brings several blocks, handed out one by one, and its
        status comes with the newest.
        """
        if self._fetched.shape[1] < count:
            self._fetch(count)
        first, values = self._next_sample, self._fetched[:, :count]
        self._next_sample, self._fetched = first + count, self._fetched[:, count:]
        flags = self._watch.flags(values)
        faults: list[Finding] = []
        if not self._fetched.shape[1]:
            for attribute, row in self._reported:
                flags[row] |= _STATUS[attribute]
                if attribute in _FAULTS:
                    faults.append(Finding(self.channels[row].name, "supply", _FAULTS[attribute]))
        return CardReading(first, values, tuple(flags), self._arrived_s, self._watch.findings(values, faults))

    def _fetch(self, count: int) -> None:
        """Bring the next `count` samples, or a few times as many, and what the device says of them."""
        analog, kept = self._opened(), self._fetched
        first = self._next_sample + kept.shape[1]
        blocks = self._piled_up(analog, first, count)
        wait_s = WAIT_MARGIN_S + (count / self.sample_rate if blocks == 1 else 0.0)
        count *= blocks
        doing = f"reading samples {first} to {first + count}"
        values = np.empty((len(self.channels), count))
        with self._translated(doing):
            samples = analog.read(count, wait_s)
            # Before anything is made of them: this is what the card's clock is fitted to.
            self._arrived_s = self._clock.monotonic_s()
            self._reported = self._status(analog.stream)
        # Rows come in the order of the channels in the bench file, whatever inputs and counters they are on.
        values[self._analog_rows] = self._whole(samples, count, doing)
        for counter in self._counters:
            doing_so = f"{doing} of {_label(counter)}"
            with self._translated(doing_so):
                # The clock has sampled them already; all that is left to wait for is their way here.
                counted = counter.read(count, WAIT_MARGIN_S)
            values[self._rows[counter.channel.physical]] = self._whole(counted, count, doing_so)
        self._fetched = np.concatenate((kept, values), axis=1) if kept.size else values

    def _piled_up(self, analog: AnalogTask, first: int, count: int) -> int:
        """How many blocks of `count` samples to read from `first` on: one, or those that wait."""
        lag_s = self._clock.monotonic_s() - first / self.sample_rate
        self._least_lag_s = min(self._least_lag_s, lag_s)
        if lag_s - self._least_lag_s < 2 * count / self.sample_rate:
            return 1
        with self._translated("asking how many samples wait"):
            blocks = analog.waiting() // count
        if blocks < 2:
            self._least_lag_s = lag_s  # it is the clocks that differ
        return min(max(blocks, 1), MOST_AT_ONCE)

    def _whole(self, values: NDArray[np.float64], count: int, doing: str) -> NDArray[np.float64]:
        came = values.shape[-1]
        if came < count:
            raise RecorderFailed(f"{self.name} at {self.address}: {doing}: only {came} of them came")
        return values

    def _opened(self) -> AnalogTask:
        if self._analog is None:
            raise DeviceLost(self.name, self.address, "the card is not open")
        return self._analog

    def _options(self) -> Any:
        # A session belongs to one task or system, so each gets its own over the one channel.
        return None if self._grpc_channel is None else nidaqmx.GrpcSessionOptions(self._grpc_channel, "")

    def _new_task(self) -> Any:
        return nidaqmx.Task(grpc_options=self._options())

    def _accept(self, seen: Survey) -> None:
        what = f"missing: {', '.join(seen.absent)}" if seen.absent else ""
        what = "; ".join([text for text in (what, *seen.wrong) if text])
        check = "the physical channels and sensors in the bench file"
        if seen.absent:
            # Absent before wrong: of what is not there nothing else can be said.
            there = ", ".join(seen.present) or "no device at all"
            raise InstrumentAbsent(self.name, self.address, f"{what}; present: {there}", check)
        if seen.wrong:
            raise InstrumentRefused(self.name, self.address, what, check)
        self.identity = seen.identity
        sheets = {name: str(sheet.serial) for name, sheet in seen.sheets.items()}
        units = {channel.name: channel.unit for channel in self.settings.channels}
        self.sheets = {name: sheet.told(units[name]) for name, sheet in seen.sheets.items()}
        self.channels = tuple(
            described(replace(channel, serial=channel.serial or sheets.get(channel.name, "")))
            for channel in self.settings.channels
        )

    def _declared(self, channels: list[CardChannel]) -> Any:
        with self._translated("creating a task"):
            task = self._new_task()
        try:
            for channel in channels:
                with self._translated(f"declaring {channel.name} on {channel.physical} as {channel.kind}"):
                    known_sensor(channel).declare(task, channel)
        except BaseException:
            give_back(task)
            raise
        return task

    def _set_clock(self, analog: AnalogTask) -> None:
        asked = self.settings.sample_rate_hz
        with self._translated(f"setting the sample rate to {asked:g} Hz"):
            self.sample_rate = analog.set_rate(asked)
            error = self.sample_rate / asked - 1.0
            if abs(error) <= LARGEST_RATE_ERROR:
                if abs(error) > RATE_TOLERANCE:
                    text = f"{self.name} samples at {self.sample_rate:.7g} Hz instead of {asked:.7g} Hz"
                    self.warnings += (f"{text} ({error * 1e6:+.0f} ppm)",)
                return
            # A divided clock has few rates; the operator is told which are near.
            near = ", ".join(f"{rate:.7g}" for rate in analog.rates_near(asked))
        raise InstrumentRefused(
            self.name,
            self.address,
            f"it has no sample rate of {asked:g} Hz; near it are {near} Hz",
            "acquisition.sample_rate in the scenario",
            "rate",
        )

    def _status(self, stream: Any) -> list[tuple[str, int]]:
        """What the device says of its channels, each with its row; of its clock, its last word."""
        reported: list[tuple[str, int]] = []
        for attribute in list(self._asked):
            if attribute == _SELDOM and self._readings % _EVERY:
                reported += [(attribute, row) for row in self._unlocked]
                continue
            try:
                # DAQmx wants the question whether there are any before the one which they are.
                names = getattr(stream, attribute) if getattr(stream, f"{attribute}_exist") else ()
            except DaqError as error:
                if error.error_code not in session.UNSUPPORTED:
                    raise
                self._asked.remove(attribute)
                self.warnings += (f"{self.name} does not report {attribute}",)
            else:
                reported += [(attribute, self._rows[name]) for name in names if name in self._rows]
        self._unlocked = tuple(row for attribute, row in reported if attribute == _SELDOM)
        self._readings += 1
        return reported

    def _translated(self, doing: str) -> Any:
        return session.translated(self.name, self.address, doing)


def _on(settings: CardSettings, kind: str) -> list[CardChannel]:
    return [channel for channel in settings.channels if channel.input == kind]


def _label(counter: CounterTask) -> str:
    return f"{counter.channel.name} ({counter.channel.physical})"


def _expired(channels: tuple[CardChannel, ...], today: date) -> Iterator[str]:
    for channel in channels:
        parts = {channel.sensor or "sensor": channel, **channel.stages}
        for what, part in parts.items():
            if part.valid_until is not None and part.valid_until < today:
                until = part.valid_until.isoformat()
                yield f"{channel.name}: the calibration of {what} {part.serial} expired on {until}"

"""The tasks of the emulated device server: what a client has declared, and what runs of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeVar

from nidaqmx.error_codes import DAQmxErrors

from drivers.ni_daq.emulator.acquisition import Acquisition, CounterRun, SampleBuffer
from drivers.ni_daq.emulator.converter import CounterInput
from drivers.ni_daq.emulator.wiring import DaqmxError, Input

T = TypeVar("T")

STAMP_ENABLED, STAMP_TIMESCALE = 0x3139, 0x313B  # first_samp_timestamp_enable, ..._timescale
DEFAULT_BUFFER = 100_000  # samples per channel at 10 kHz to 1 MHz: NI-DAQmx manual, "Buffer size"


@dataclass(slots=True)
class Task:
    """A task with analog inputs, with one counter whose sample clock is the terminal `clock`, or with a line.

    `client` is who created or used it last, as gRPC names the far end of a connection.
    """

    name: str
    client: str = ""
    line: str = ""
    inputs: list[Input] = field(default_factory=list)
    counter: CounterInput | None = None
    clock: str = ""
    sample_rate: float = 0.0
    buffer_size: int = DEFAULT_BUFFER
    acquisition: Acquisition | None = None
    counting: CounterRun | None = None
    attributes: dict[tuple[str, int], float] = field(default_factory=dict)
    reported: tuple[str, ...] = ()

    @property
    def stamped(self) -> bool:
        """Whether its first sample is stamped, as that of an analog task is by itself."""
        return bool(self.inputs)

    def running(self) -> Acquisition:
        """Return the running acquisition; raises where only a counter runs, or nothing."""
        if self.acquisition is None or not self.acquisition.started:
            raise DaqmxError(DAQmxErrors.SAMPLES_WILL_NEVER_BE_AVAILABLE, "the task is not running")
        return self.acquisition

    def buffer(self) -> SampleBuffer:
        """Return what has been measured; raises where nothing runs."""
        if self.counting is not None:
            return self.counting.buffer
        return self.running().buffer

    @property
    def channels(self) -> list[str]:
        """Names of its channels, which are those of their inputs."""
        return [item.physical for item in self.inputs] + ([self.counter.physical] if self.counter else [])

    def stop(self) -> None:
        if self.acquisition is not None:
            self.acquisition.stop()
        if self.counting is not None:
            text = "the task was stopped"
            self.counting.buffer.fail(DaqmxError(DAQmxErrors.SAMPLES_WILL_NEVER_BE_AVAILABLE, text))
        self.acquisition = self.counting = None

    def report(self, names: Callable[[Acquisition], tuple[str, ...]]) -> bool:
        """Say whether there is anything to report, and keep it for the question which."""
        self.reported = names(self.running())
        return bool(self.reported)


READ_UINT32: Mapping[int, Callable[[Task], int]] = MappingProxyType(
    {
        0x217B: lambda task: len(
            task.channels
        ),  # num_chans: a call before each read, unless verify_array_shape is off
        0x1223: lambda task: task.buffer().available,  # avail_samp_per_chan
        0x31E8: lambda task: (
            task.buffer().available
        ),  # how many a read takes by default, asked of drivers from 24.5 on
    }
)
# DAQmx wants the question whether there are any before the one which they are; clipped, open, shorted inputs,
# and those whose clock is not locked, of which this card has none.
READ_BOOL: Mapping[int, Callable[[Task], bool]] = MappingProxyType(
    {
        0x2174: lambda task: task.report(Acquisition.clipped_inputs),
        0x3100: lambda task: task.report(lambda acquisition: acquisition.open_inputs),
        0x3088: lambda task: task.report(lambda acquisition: acquisition.shorted_inputs),
        0x3118: lambda task: task.report(lambda _: ()),
    }
)
READ_STRING: Mapping[int, Callable[[Task], str]] = MappingProxyType(
    dict.fromkeys((0x2175, 0x3101, 0x3089, 0x3119), lambda task: ", ".join(task.reported))
)
TASK_STRING: Mapping[int, Callable[[Task], str]] = MappingProxyType(
    {0x1276: lambda task: task.name, 0x1273: lambda task: ", ".join(task.channels)}
)


def lookup(table: Mapping[int, T], attribute: int) -> T:
    """Return an attribute; raises `DaqmxError` for one that the card has not."""
    if attribute not in table:
        text = f"this card has no attribute {attribute:#x}"
        raise DaqmxError(DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT, text)
    return table[attribute]

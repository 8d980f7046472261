"""The calls of NI's gRPC device server that a continuous analog task needs."""

# ruff: noqa: D102, N802 - the calls are named and described by NI's nidaqmx.proto

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc
from nidaqmx.constants import AccelSensitivityUnits, AccelUnits
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import NDArray

from daq import Clock
from daq.errors import ConfigurationError, Problem
from drivers.ni_daq.emulator.acquisition import Acquisition, DriveInbox
from drivers.ni_daq.emulator.wiring import EXCITATION_A, CardWiring, DaqmxError, Input, coerced_rate
from drivers.protocols import Plant

T = TypeVar("T")

STANDARD_GRAVITY = 9.80665
DEFAULT_BUFFER = 100_000  # samples per channel at 10 kHz to 1 MHz: NI-DAQmx manual, "Buffer size"
VERSION = {0x1272: 25, 0x1923: 0, 0x2F22: 0}  # major, minor, update of the driver


@dataclass(slots=True)
class _Task:
    name: str
    inputs: list[Input] = field(default_factory=list)
    sample_rate: float = 0.0
    buffer_size: int = DEFAULT_BUFFER
    acquisition: Acquisition | None = None
    clipped: tuple[str, ...] = ()

    def running(self) -> Acquisition:
        if self.acquisition is None:
            raise DaqmxError(DAQmxErrors.SAMPLES_WILL_NEVER_BE_AVAILABLE, "the task is not running")
        return self.acquisition

    def stop(self) -> None:
        if self.acquisition is not None:
            self.acquisition.stop()
            self.acquisition = None

    def clipped_exist(self) -> bool:
        self.clipped = self.running().clipped_inputs()
        return bool(self.clipped)


_READ_UINT32: dict[int, Callable[[_Task], int]] = {
    0x217B: lambda task: len(task.inputs),
    0x1223: lambda task: task.running().available,
    0x31E8: lambda task: task.running().available,
}
_READ_BOOL: dict[int, Callable[[_Task], bool]] = {
    0x2174: _Task.clipped_exist,
    0x3100: lambda task: bool(task.running().open_inputs),
}
_READ_STRING: dict[int, Callable[[_Task], str]] = {
    0x2175: lambda task: ", ".join(task.clipped),
    0x3101: lambda task: ", ".join(task.running().open_inputs),
}
_TASK_STRING: dict[int, Callable[[_Task], str]] = {
    0x1276: lambda task: task.name,
    0x1273: lambda task: ", ".join(item.physical for item in task.inputs),
}


class CardServicer(nidaqmx_pb2_grpc.NiDAQmxServicer):  # type: ignore[misc]
    """A device server with one card, which one task at a time may run. Calls raise `DaqmxError`."""

    def __init__(self, plant: Plant, wiring: CardWiring, inbox: DriveInbox, clock: Clock) -> None:
        self._plant, self._wiring, self._inbox, self._clock = plant, wiring, inbox, clock
        self._devices = wiring.devices()
        unknown = {wire.plant_channel for wire in wiring.wires.values()} - set(plant.channels)
        if unknown:
            allowed = f"one of {', '.join(plant.channels)}"
            problems = [Problem("plant channel", name, allowed) for name in sorted(unknown)]
            raise ConfigurationError("wiring of the emulated card", problems)
        self._tasks: dict[str, _Task] = {}
        self._lock = threading.Lock()

    def close(self) -> None:
        """Stop every task."""
        with self._lock:
            for task in self._tasks.values():
                task.stop()

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = _lookup(VERSION, request.attribute_raw)
        return messages.GetSystemInfoAttributeUInt32Response(value=value)

    def GetSystemInfoAttributeString(self, request: Any, context: Any) -> Any:
        value = _lookup({0x193B: ", ".join(self._devices)}, request.attribute_raw)
        return messages.GetSystemInfoAttributeStringResponse(value=value)

    def GetDeviceAttributeString(self, request: Any, context: Any) -> Any:
        inputs = self._device(request.device_name)
        values = {0x0631: self._wiring.product_type, 0x231E: ", ".join(inputs)}
        return messages.GetDeviceAttributeStringResponse(value=_lookup(values, request.attribute_raw))

    def GetDeviceAttributeUInt32(self, request: Any, context: Any) -> Any:
        self._device(request.device_name)
        values = {0x0632: self._wiring.serial + list(self._devices).index(request.device_name)}
        return messages.GetDeviceAttributeUInt32Response(value=_lookup(values, request.attribute_raw))

    def GetDeviceAttributeBool(self, request: Any, context: Any) -> Any:
        self._device(request.device_name)
        return messages.GetDeviceAttributeBoolResponse(value=_lookup({0x22CA: True}, request.attribute_raw))

    def CreateTask(self, request: Any, context: Any) -> Any:
        with self._lock:
            number = len(self._tasks)
            while (name := request.session_name or f"task{number}") in self._tasks:
                if request.session_name:
                    raise DaqmxError(DAQmxErrors.INVALID_TASK, f"there is a task {name} already")
                number += 1
            self._tasks[name] = _Task(name)
        return messages.CreateTaskResponse(task={"name": name}, new_session_initialized=True)

    def ClearTask(self, request: Any, context: Any) -> Any:
        self._task(request).stop()
        with self._lock:
            del self._tasks[request.task.name]
        return messages.ClearTaskResponse()

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        self._add(request, Input(request.physical_channel, 1.0, request.max_val))
        return messages.CreateAIVoltageChanResponse()

    def CreateAIForceIEPEChan(self, request: Any, context: Any) -> Any:
        volts_per_unit = request.sensitivity * 1e-3
        self._add_iepe(request, Input(request.physical_channel, volts_per_unit, request.max_val, iepe=True))
        return messages.CreateAIForceIEPEChanResponse()

    def CreateAIAccelChan(self, request: Any, context: Any) -> Any:
        per_g = request.sensitivity
        if request.sensitivity_units_raw == AccelSensitivityUnits.MILLIVOLTS_PER_G.value:
            per_g *= 1e-3
        in_g = request.units_raw == AccelUnits.G.value
        volts_per_unit = per_g if in_g else per_g / STANDARD_GRAVITY
        self._add_iepe(request, Input(request.physical_channel, volts_per_unit, request.max_val, iepe=True))
        return messages.CreateAIAccelChanResponse()

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:
        task = self._task(request)
        task.sample_rate = coerced_rate(request.rate)
        task.buffer_size = max(int(request.samps_per_chan), 2)
        return messages.CfgSampClkTimingResponse()

    def GetTimingAttributeDouble(self, request: Any, context: Any) -> Any:
        values = {0x1344: self._task(request).sample_rate}
        return messages.GetTimingAttributeDoubleResponse(value=_lookup(values, request.attribute_raw))

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:
        value = _lookup(_TASK_STRING, request.attribute_raw)(self._task(request))
        return messages.GetTaskAttributeStringResponse(value=value)

    def GetTaskAttributeUInt32(self, request: Any, context: Any) -> Any:
        values = {0x2181: len(self._task(request).inputs)}
        return messages.GetTaskAttributeUInt32Response(value=_lookup(values, request.attribute_raw))

    def GetBufferAttributeUInt32(self, request: Any, context: Any) -> Any:
        values = {0x186C: self._task(request).buffer_size}
        return messages.GetBufferAttributeUInt32Response(value=_lookup(values, request.attribute_raw))

    def GetReadAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = _lookup(_READ_UINT32, request.attribute_raw)(self._task(request))
        return messages.GetReadAttributeUInt32Response(value=value)

    def GetReadAttributeUInt64(self, request: Any, context: Any) -> Any:
        values = {0x192A: self._task(request).running().made}
        return messages.GetReadAttributeUInt64Response(value=_lookup(values, request.attribute_raw))

    def GetReadAttributeBool(self, request: Any, context: Any) -> Any:
        value = _lookup(_READ_BOOL, request.attribute_raw)(self._task(request))
        return messages.GetReadAttributeBoolResponse(value=value)

    def GetReadAttributeString(self, request: Any, context: Any) -> Any:
        value = _lookup(_READ_STRING, request.attribute_raw)(self._task(request))
        return messages.GetReadAttributeStringResponse(value=value)

    def StartTask(self, request: Any, context: Any) -> Any:
        task = self._task(request)
        with self._lock:
            if any(other.acquisition is not None for other in self._tasks.values()):
                raise DaqmxError(DAQmxErrors.PAL_RESOURCE_RESERVED, "the card is in use by a running task")
            task.acquisition = Acquisition(
                self._plant,
                self._wiring,
                task.inputs,
                task.sample_rate,
                task.buffer_size,
                self._inbox,
                self._clock,
            )
            task.acquisition.start()
        return messages.StartTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:
        self._task(request).stop()
        return messages.StopTaskResponse()

    def ReadAnalogF64(self, request: Any, context: Any) -> Any:
        values = self._task(request).running().read(request.num_samps_per_chan, request.timeout)
        return _packed(values)

    def GetErrorString(self, request: Any, context: Any) -> Any:
        return messages.GetErrorStringResponse(error_string=f"DAQmx error {request.error_code}")

    def _device(self, name: str) -> list[str]:
        if name not in self._devices:
            raise DaqmxError(DAQmxErrors.INVALID_DEVICE_ID, f"there is no device {name}")
        return self._devices[name]

    def _task(self, request: Any) -> _Task:
        task = self._tasks.get(request.task.name)
        if task is None:
            raise DaqmxError(DAQmxErrors.INVALID_TASK, f"there is no task {request.task.name}")
        return task

    def _add_iepe(self, request: Any, item: Input) -> None:
        if abs(request.current_excit_val - EXCITATION_A) > 1e-6:
            text = f"excitation of {request.current_excit_val * 1e3:g} mA; the card has 2 mA"
            raise DaqmxError(DAQmxErrors.INVALID_ATTRIBUTE_VALUE, text)
        self._add(request, item)

    def _add(self, request: Any, item: Input) -> None:
        task = self._task(request)
        device = item.physical.partition("/")[0]
        if item.physical not in self._devices.get(device, ()):
            text = f"there is no physical channel {item.physical}"
            raise DaqmxError(DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST, text)
        if any(item.physical == other.physical for other in task.inputs):
            raise DaqmxError(DAQmxErrors.CHAN_ALREADY_IN_TASK, f"{item.physical} is in the task already")
        wire = self._wiring.wires.get(item.physical)
        highest_v = item.maximum * item.volts_per_unit
        if highest_v > (5.0 if wire is None else wire.range_v) * (1.0 + 1e-6):
            text = f"{item.physical}: {item.maximum:g} is {highest_v:g} V, more than the input takes"
            raise DaqmxError(DAQmxErrors.INVALID_ATTRIBUTE_VALUE, text)
        task.inputs.append(item)


def _lookup(table: Mapping[int, T], attribute: int) -> T:
    if attribute not in table:
        text = f"this card has no attribute {attribute:#x}"
        raise DaqmxError(DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT, text)
    return table[attribute]


def _packed(values: NDArray[np.float64]) -> Any:
    # A packed `repeated double` is the bytes of the array; adding numbers one by one takes far longer.
    data = np.ascontiguousarray(values, dtype="<f8").tobytes()
    length, prefix = len(data), bytearray(b"\x12")
    while length > 0x7F:
        prefix.append(length & 0x7F | 0x80)
        length >>= 7
    prefix.append(length)
    response = messages.ReadAnalogF64Response.FromString(bytes(prefix) + data)
    response.samps_per_chan_read = values.shape[1]
    return response

"""NI's gRPC device server on loopback: the calls about what is there, and those that tasks need."""

# ruff: noqa: N802 - the calls are named and described by NI's nidaqmx.proto

# Attributes have the numbers by which nidaqmx asks for them; beside each stands its property there.

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import grpc
import numpy as np
from google.protobuf.timestamp_pb2 import Timestamp
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc
from nidaqmx.constants import (
    AccelSensitivityUnits,
    AccelUnits,
    AngleUnits,
    EncoderType,
    ForceIEPESensorSensitivityUnits,
    TaskMode,
    Timescale,
    TimestampEvent,
)
from nidaqmx.error_codes import DAQmxErrors

from daq.clock import Clock
from daq.errors import ConfigurationError, Problem
from drivers.ni_daq.emulator.acquisition import Acquisition, CounterRun, DriveInbox
from drivers.ni_daq.emulator.converter import AngleCount, CounterInput, EdgeCount, Measure, PulseFrequency
from drivers.ni_daq.emulator.tasks import (
    READ_BOOL,
    READ_STRING,
    READ_UINT32,
    STAMP_ENABLED,
    STAMP_TIMESCALE,
    TASK_STRING,
    Task,
    lookup,
)
from drivers.ni_daq.emulator.wiring import (
    EXCITATION_A,
    CardWiring,
    CounterWire,
    DaqmxError,
    Input,
    Teds,
    chassis_of,
    coerced_rate,
)
from drivers.protocols.card import Plant

STANDARD_GRAVITY = 9.80665  # m/s2, in which clients give sensitivities
HEARING_THRESHOLD_PA = 20e-6  # from which they give decibels
_DECODINGS = {EncoderType.X_1.value: 1, EncoderType.X_2.value: 2, EncoderType.X_4.value: 4}
_ESTABLISHED = "01"
_LEAST_COUNTER_BUFFER = 10_000  # samples
VERSION = {0x1272: 25, 0x1923: 0, 0x2F22: 0}  # major, minor, update of the driver


class DeviceCalls(nidaqmx_pb2_grpc.NiDAQmxServicer):  # type: ignore[misc]
    """What needs no task. Calls raise `DaqmxError`."""

    def __init__(self, wiring: CardWiring) -> None:
        self._wiring = wiring
        self._devices = wiring.devices()
        self._counters = wiring.counters_of()
        self._sheets: dict[str, Teds] = {}

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = lookup(VERSION, request.attribute_raw)
        return messages.GetSystemInfoAttributeUInt32Response(value=value)

    def GetSystemInfoAttributeString(self, request: Any, context: Any) -> Any:
        value = lookup({0x193B: ", ".join(self._devices)}, request.attribute_raw)  # device_names
        return messages.GetSystemInfoAttributeStringResponse(value=value)

    def GetDeviceAttributeString(self, request: Any, context: Any) -> Any:
        name = self._device(request.device_name)
        values = {
            0x0631: self._wiring.product(name),  # product_type
            0x231E: ", ".join(self._devices[name]),  # ai_physical_chans
            0x2324: ", ".join(self._counters.get(name, ())),  # ci_physical_chans
        }
        chassis = chassis_of(name)
        if chassis is not None:
            values[0x29B7] = chassis  # compact_daq_chassis_device
        return messages.GetDeviceAttributeStringResponse(value=lookup(values, request.attribute_raw))

    def GetDeviceAttributeUInt32(self, request: Any, context: Any) -> Any:
        name = self._device(request.device_name)
        values = {0x0632: self._wiring.serial + list(self._devices).index(name)}  # serial_num
        return messages.GetDeviceAttributeUInt32Response(value=lookup(values, request.attribute_raw))

    def GetDeviceAttributeDoubleArray(self, request: Any, context: Any) -> Any:
        most_v = self._wiring.range_v(self._device(request.device_name))
        values = {0x2990: [-most_v, most_v]}  # ai_voltage_rngs
        return messages.GetDeviceAttributeDoubleArrayResponse(value=lookup(values, request.attribute_raw))

    def GetDeviceAttributeBool(self, request: Any, context: Any) -> Any:
        name = self._device(request.device_name)
        values = {0x22CA: True, 0x2FD6: bool(self._devices[name])}  # is_simulated, hwteds_supported
        return messages.GetDeviceAttributeBoolResponse(value=lookup(values, request.attribute_raw))

    def ConfigureTEDS(self, request: Any, context: Any) -> Any:
        wire = self._wiring.wires.get(request.physical_channel)
        if wire is None or wire.teds is None or not wire.connected:
            text = f"no TEDS sensor on {request.physical_channel}"
            raise DaqmxError(DAQmxErrors.TEDS_SENSOR_NOT_DETECTED, text)
        self._sheets[request.physical_channel] = wire.teds
        return messages.ConfigureTEDSResponse()

    def GetPhysicalChanAttributeUInt32(self, request: Any, context: Any) -> Any:
        values = {0x21DC: self._sheet(request.physical_channel).serial}  # teds_serial_num
        return messages.GetPhysicalChanAttributeUInt32Response(value=lookup(values, request.attribute_raw))

    def _sheet(self, physical: str) -> Teds:
        if physical not in self._sheets:
            text = f"{physical} has not been configured with TEDS"
            raise DaqmxError(DAQmxErrors.TEDS_SENSOR_NOT_DETECTED, text)
        return self._sheets[physical]

    def _device(self, name: str) -> str:
        if name not in self._devices:
            raise DaqmxError(DAQmxErrors.INVALID_DEVICE_ID, f"there is no device {name}")
        return name


def _of_task(response: Any, values: Mapping[int, Callable[[Task], object]]) -> Any:
    """A call for one of the attributes of a task."""

    def call(self: CardServicer, request: Any, context: Any) -> Any:
        return response(value=lookup(values, request.attribute_raw)(self._task(request)))

    return call


class CardServicer(DeviceCalls):
    """A device server with one card, which one task at a time may run, and a task for each of its counters.

    Calls raise `DaqmxError`.
    """

    def __init__(self, plant: Plant[Any], wiring: CardWiring, inbox: DriveInbox[Any], clock: Clock) -> None:
        super().__init__(wiring)
        self._plant, self._inbox, self._clock = plant, inbox, clock
        wired = {wire.plant_channel for wire in wiring.wires.values()}
        wired |= {wire.plant_channel for wire in wiring.counters.values()}
        unknown = wired - {"", *plant.channels}
        if unknown:
            allowed = f"one of {', '.join(plant.channels)}"
            problems = [Problem("plant channel", name, allowed) for name in sorted(unknown)]
            raise ConfigurationError("wiring of the emulated card", problems)
        self._tasks: dict[str, Task] = {}
        self._lines = wiring.lines
        self._lock = threading.Lock()

    def put_lines(self, lines: Mapping[str, bool]) -> None:
        """What is on the digital inputs from now on; one that is not among them cannot be read."""
        self._lines = lines

    def heard(self, request: Any, client: str) -> None:
        """Take note of whose a task is; before a new one, free those whose client has gone without a word."""
        if isinstance(request, messages.CreateTaskRequest):
            with self._lock:
                for left in [each for each in self._tasks.values() if not _is_connected(each.client)]:
                    left.stop()
                    del self._tasks[left.name]
        elif hasattr(request, "task") and (task := self._tasks.get(request.task.name)) is not None:
            task.client = client

    def close(self) -> None:
        with self._lock:
            for task in self._tasks.values():
                task.stop()

    def CreateTask(self, request: Any, context: Any) -> Any:
        with self._lock:
            # An empty session name asks for one that is not taken, as the real server gives.
            number = len(self._tasks)
            while (name := request.session_name or f"task{number}") in self._tasks:
                if request.session_name:
                    raise DaqmxError(DAQmxErrors.INVALID_TASK, f"there is a task {name} already")
                number += 1
            self._tasks[name] = Task(name, context.peer())
        return messages.CreateTaskResponse(task={"name": name}, new_session_initialized=True)

    def ClearTask(self, request: Any, context: Any) -> Any:
        self._task(request).stop()
        with self._lock:
            del self._tasks[request.task.name]
        return messages.ClearTaskResponse()

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        self._add(request, 1.0)
        return messages.CreateAIVoltageChanResponse()

    def CreateAIForceIEPEChan(self, request: Any, context: Any) -> Any:
        self._add_iepe(request, request.sensitivity * 1e-3)
        return messages.CreateAIForceIEPEChanResponse()

    def CreateAIAccelChan(self, request: Any, context: Any) -> Any:
        per_g = request.sensitivity
        if request.sensitivity_units_raw == AccelSensitivityUnits.MILLIVOLTS_PER_G.value:
            per_g *= 1e-3
        in_g = request.units_raw == AccelUnits.G.value
        self._add_iepe(request, per_g if in_g else per_g / STANDARD_GRAVITY)
        return messages.CreateAIAccelChanResponse()

    def CreateAIMicrophoneChan(self, request: Any, context: Any) -> Any:
        largest_pa = HEARING_THRESHOLD_PA * 10 ** (request.max_snd_press_level / 20)
        self._add_iepe(request, request.mic_sensitivity * 1e-3, largest_pa)
        return messages.CreateAIMicrophoneChanResponse()

    def CreateTEDSAIForceIEPEChan(self, request: Any, context: Any) -> Any:
        teds = self._sheet(request.physical_channel)
        self._add_iepe(request, teds.volts_per_unit)
        self._keep(request, {0x2F81: teds.volts_per_unit * 1e3})  # ai_force_iepe_sensor_sensitivity
        return messages.CreateTEDSAIForceIEPEChanResponse()

    def CreateTEDSAIAccelChan(self, request: Any, context: Any) -> Any:
        teds = self._sheet(request.physical_channel)
        self._add_iepe(request, teds.volts_per_unit)
        self._keep(request, {0x0692: teds.volts_per_unit * STANDARD_GRAVITY * 1e3})  # ai_accel_sensitivity
        return messages.CreateTEDSAIAccelChanResponse()

    def GetChanAttributeDouble(self, request: Any, context: Any) -> Any:
        kept = self._task(request).attributes
        values = {number: value for (channel, number), value in kept.items() if channel == request.channel}
        return messages.GetChanAttributeDoubleResponse(value=lookup(values, request.attribute_raw))

    def GetChanAttributeInt32(self, request: Any, context: Any) -> Any:
        values = {
            0x2F82: ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON.value,
            0x219C: AccelSensitivityUnits.MILLIVOLTS_PER_G.value,
        }
        return messages.GetChanAttributeInt32Response(value_raw=lookup(values, request.attribute_raw))

    def SetChanAttributeBool(self, request: Any, context: Any) -> Any:
        lookup({0x2ED0: None}, request.attribute_raw)  # ci_freq_enable_averaging
        if request.value:
            text = "averaging wants two pulses between any two samples, which slow shafts do not give"
            raise DaqmxError(DAQmxErrors.INVALID_ATTRIBUTE_VALUE, text)
        return messages.SetChanAttributeBoolResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:
        decoding = lookup(_DECODINGS, request.decoding_type_raw)
        turn = math.tau if request.units_raw == AngleUnits.RADIANS.value else 360.0
        per_unit = request.pulses_per_rev * decoding / turn
        initial = round(request.initial_angle * per_unit)
        # The register counts; the client's angles are turned into counts as DAQmx does.
        at_index = round(request.zidx_val * per_unit) if request.zidx_enable else None
        self._add_counter(request, lambda wire: AngleCount(wire, decoding, initial, at_index))
        return messages.CreateCIAngEncoderChanResponse()

    def CreateCICountEdgesChan(self, request: Any, context: Any) -> Any:
        self._add_counter(request, EdgeCount)
        return messages.CreateCICountEdgesChanResponse()

    def CreateCIFreqChan(self, request: Any, context: Any) -> Any:
        task = self._task(request)  # of which the rate is not known yet
        self._add_counter(request, lambda wire: PulseFrequency(wire, task.sample_rate), np.float64)
        return messages.CreateCIFreqChanResponse()

    def CreateDIChan(self, request: Any, context: Any) -> Any:
        if request.lines not in self._wiring.lines:
            text = f"there is no digital line {request.lines}"
            raise DaqmxError(DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST, text)
        if any(task.line == request.lines for task in self._tasks.values()):
            raise DaqmxError(DAQmxErrors.PAL_RESOURCE_RESERVED, f"{request.lines} is in use")
        self._task(request).line = request.lines
        return messages.CreateDIChanResponse()

    def ReadDigitalLines(self, request: Any, context: Any) -> Any:
        if (on := self._lines.get(self._task(request).line)) is None:
            raise DaqmxError(DAQmxErrors.DEV_CANNOT_BE_ACCESSED, "the module does not answer")
        return messages.ReadDigitalLinesResponse(
            read_array=bytes([on]), samps_per_chan_read=1, num_bytes_per_samp=1
        )

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:
        task = self._task(request)
        task.clock = request.source
        task.sample_rate = request.rate if request.source else coerced_rate(request.rate)
        task.buffer_size = max(int(request.samps_per_chan), 2)
        return messages.CfgSampClkTimingResponse()

    GetTimingAttributeDouble = _of_task(
        messages.GetTimingAttributeDoubleResponse,
        {0x1344: lambda task: task.sample_rate},  # samp_clk_rate
    )

    def GetTimingAttributeBool(self, request: Any, context: Any) -> Any:
        values = {STAMP_ENABLED: self._task(request).stamped} if self._wiring.stamps_start else {}
        return messages.GetTimingAttributeBoolResponse(value=lookup(values, request.attribute_raw))

    def SetTimingAttributeInt32(self, request: Any, context: Any) -> Any:
        lookup({STAMP_TIMESCALE: None} if self._wiring.stamps_start else {}, request.attribute_raw)
        if request.value_raw != Timescale.USE_HOST.value:
            text = "this card stamps its first sample in the host's time only"
            raise DaqmxError(DAQmxErrors.INVALID_ATTRIBUTE_VALUE, text)
        return messages.SetTimingAttributeInt32Response()

    def WaitForValidTimestamp(self, request: Any, context: Any) -> Any:
        if not self._wiring.stamps_start or request.timestamp_event_raw != TimestampEvent.FIRST_SAMPLE.value:
            text = "this card has no such timestamp"
            raise DaqmxError(DAQmxErrors.WAIT_FOR_VALID_TIMESTAMP_NOT_SUPPORTED, text)
        stamp = Timestamp()
        stamp.FromNanoseconds(self._task(request).running().started_ns)
        return messages.WaitForValidTimestampResponse(timestamp=stamp)

    GetTaskAttributeString = _of_task(messages.GetTaskAttributeStringResponse, TASK_STRING)
    GetTaskAttributeUInt32 = _of_task(
        messages.GetTaskAttributeUInt32Response,
        {0x2181: lambda task: len(task.channels)},  # number_of_channels
    )
    GetBufferAttributeUInt32 = _of_task(
        messages.GetBufferAttributeUInt32Response,
        {0x186C: lambda task: task.buffer_size},  # input_buf_size
    )
    GetReadAttributeUInt32 = _of_task(messages.GetReadAttributeUInt32Response, READ_UINT32)
    GetReadAttributeUInt64 = _of_task(
        messages.GetReadAttributeUInt64Response,
        {0x192A: lambda task: task.buffer().made},  # total_samp_per_chan_acquired
    )
    GetReadAttributeBool = _of_task(messages.GetReadAttributeBoolResponse, READ_BOOL)
    GetReadAttributeString = _of_task(messages.GetReadAttributeStringResponse, READ_STRING)

    def TaskControl(self, request: Any, context: Any) -> Any:
        if request.action_raw != TaskMode.TASK_COMMIT.value:
            text = f"this card knows no task action {request.action_raw} but to commit"
            raise DaqmxError(DAQmxErrors.FUNCTION_NOT_SUPPORTED_FOR_DEVICE, text)
        task = self._task(request)
        with self._lock:
            self._commit(task)
        return messages.TaskControlResponse()

    def StartTask(self, request: Any, context: Any) -> Any:
        task = self._task(request)
        with self._lock:
            counter = task.counter
            if task.line:
                return messages.StartTaskResponse()
            if counter is None:
                self._commit(task).start()
                return messages.StartTaskResponse()
            for other in self._tasks.values():
                if other.counting is not None and other.channels == task.channels:
                    raise DaqmxError(DAQmxErrors.PAL_RESOURCE_RESERVED, f"{counter.physical} is in use")
            wire = self._wiring.counters.get(counter.physical)
            row = None if wire is None else self._plant.channels.index(wire.plant_channel)
            size = max(task.buffer_size, _LEAST_COUNTER_BUFFER)
            task.counting = CounterRun(counter.measure(wire or CounterWire("")), row, counter.dtype, size)
            for other in self._tasks.values():
                if other.acquisition is not None and task.clock == _clock_of(other):
                    other.acquisition.attach(task.counting)
        return messages.StartTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:
        self._task(request).stop()
        return messages.StopTaskResponse()

    def ReadAnalogF64(self, request: Any, context: Any) -> bytes:
        values = self._task(request).running().buffer.read(request.num_samps_per_chan, request.timeout)
        # A packed `repeated double` is the bytes of the array; adding numbers one by one takes far longer.
        data = np.ascontiguousarray(values, dtype="<f8")
        length, prefix = data.nbytes, bytearray(b"\x12")
        while length > 0x7F:
            prefix.append(length & 0x7F | 0x80)
            length >>= 7
        prefix.append(length)
        rest = messages.ReadAnalogF64Response(samps_per_chan_read=values.shape[1])
        return b"".join((prefix, data.data, rest.SerializeToString()))

    def ReadCounterU32Ex(self, request: Any, context: Any) -> Any:
        (values,) = self._task(request).buffer().read(request.num_samps_per_chan, request.timeout)
        return messages.ReadCounterU32ExResponse(read_array=values.tolist(), samps_per_chan_read=len(values))

    def ReadCounterF64Ex(self, request: Any, context: Any) -> Any:
        (values,) = self._task(request).buffer().read(request.num_samps_per_chan, request.timeout)
        return messages.ReadCounterF64ExResponse(read_array=values.tolist(), samps_per_chan_read=len(values))

    def GetErrorString(self, request: Any, context: Any) -> Any:
        return messages.GetErrorStringResponse(error_string=f"DAQmx error {request.error_code}")

    def _task(self, request: Any) -> Task:
        task = self._tasks.get(request.task.name)
        if task is None:
            raise DaqmxError(DAQmxErrors.INVALID_TASK, f"there is no task {request.task.name}")
        return task

    def _commit(self, task: Task) -> Acquisition:
        """The task's acquisition, ready to start; under the lock, for gRPC calls come in several threads."""
        if task.acquisition is not None and not task.acquisition.started:
            return task.acquisition
        # A card has one analog converter clock: a second task with analog inputs would need it as well.
        if any(other.acquisition is not None for other in self._tasks.values()):
            raise DaqmxError(DAQmxErrors.PAL_RESOURCE_RESERVED, "the card is in use by a running task")
        acquisition = Acquisition(
            self._plant,
            self._wiring,
            task.inputs,
            task.sample_rate,
            task.buffer_size,
            self._inbox,
            self._clock,
        )
        for other in self._tasks.values():
            if other.counting is not None and other.clock == _clock_of(task):
                acquisition.attach(other.counting)
        task.acquisition = acquisition
        return acquisition

    def _keep(self, request: Any, attributes: dict[int, float]) -> None:
        task = self._task(request)
        task.attributes |= {(request.physical_channel, key): value for key, value in attributes.items()}

    def _add_counter(
        self, request: Any, measure: Callable[[CounterWire], Measure], dtype: type[np.generic] = np.uint32
    ) -> None:
        task = self._task(request)
        if request.counter not in self._counters.get(request.counter.partition("/")[0], ()):
            text = f"there is no counter {request.counter}"
            raise DaqmxError(DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST, text)
        if task.channels:
            text = "a task can hold one counter only"
            raise DaqmxError(DAQmxErrors.CHAN_ALREADY_IN_TASK, text)
        task.counter = CounterInput(request.counter, measure, dtype)

    def _add_iepe(self, request: Any, volts_per_unit: float, largest: float | None = None) -> None:
        if abs(request.current_excit_val - EXCITATION_A) > 1e-6:
            text = f"excitation of {request.current_excit_val * 1e3:g} mA; the card has 2 mA"
            raise DaqmxError(DAQmxErrors.INVALID_ATTRIBUTE_VALUE, text)
        self._add(request, volts_per_unit, largest, iepe=True)

    def _add(
        self, request: Any, volts_per_unit: float, largest: float | None = None, iepe: bool = False
    ) -> None:
        task = self._task(request)
        maximum = request.max_val if largest is None else largest
        item = Input(request.physical_channel, volts_per_unit, maximum, iepe=iepe)
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


def _clock_of(task: Task) -> str:
    device = task.inputs[0].physical.partition("/")[0]
    return f"/{chassis_of(device) or device}/ai/SampleClock"


def _is_connected(client: str) -> bool:
    """Whether the far end of a connection is still there, by the kernel's table: gRPC tells no servicer."""
    far = f":{int(client.rpartition(':')[2]):04X}"
    tables = [Path(f"/proc/net/{table}") for table in ("tcp", "tcp6")]
    lines = [line.split() for table in tables if table.exists() for line in table.read_text().splitlines()]
    return any(line[2].endswith(far) and line[3] == _ESTABLISHED for line in lines)


CALLS_AT_ONCE = 8  # a read waits in its call; others must get through


class _DaqmxErrors(grpc.ServerInterceptor):
    """Sends a `DaqmxError` the way NI's server does: status UNKNOWN and the code in the trailing metadata.

    The servicer hears who calls.
    """

    def __init__(self, heard: Callable[[Any, str], None]) -> None:
        self._heard = heard

    def intercept_service(self, continuation: Callable[..., Any], details: Any) -> Any:
        handler = continuation(details)
        if handler is None or handler.unary_unary is None:
            return handler

        def call(request: Any, context: Any) -> Any:
            try:
                self._heard(request, context.peer())
                return handler.unary_unary(request, context)
            except DaqmxError as error:
                # From here nidaqmx takes the code of its DaqError.
                context.set_trailing_metadata((("ni-error", str(error.code)),))
                context.abort(grpc.StatusCode.UNKNOWN, str(error))

        def wire(response: Any) -> Any:
            return response if isinstance(response, bytes) else handler.response_serializer(response)

        return grpc.unary_unary_rpc_method_handler(call, handler.request_deserializer, wire)


class CardServer:
    """Serves a `CardServicer` on 127.0.0.1."""

    def __init__(self, servicer: CardServicer) -> None:
        self._servicer = servicer
        self._server: Any = None

    def open(self) -> str:
        """Listen on a free port; return `host:port`."""
        self._server = grpc.server(
            ThreadPoolExecutor(CALLS_AT_ONCE), interceptors=[_DaqmxErrors(self._servicer.heard)]
        )
        nidaqmx_pb2_grpc.add_NiDAQmxServicer_to_server(self._servicer, self._server)
        port = self._server.add_insecure_port("127.0.0.1:0")
        self._server.start()
        return f"127.0.0.1:{port}"

    def close(self) -> None:
        """Stop the tasks, then the server."""
        self._servicer.close()
        self._server.stop(grace=None).wait()

"""The calls of NI's gRPC device server about what is there: system, devices, sensors' data sheets."""

# ruff: noqa: N802 - the calls are named and described by NI's nidaqmx.proto

from __future__ import annotations

from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc
from nidaqmx.error_codes import DAQmxErrors

from drivers.ni_daq.emulator.tasks import lookup
from drivers.ni_daq.emulator.wiring import CardWiring, DaqmxError, Teds, chassis_of

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
        value = lookup({0x193B: ", ".join(self._devices)}, request.attribute_raw)
        return messages.GetSystemInfoAttributeStringResponse(value=value)

    def GetDeviceAttributeString(self, request: Any, context: Any) -> Any:
        name = self._device(request.device_name)
        values = {
            0x0631: self._wiring.product(name),
            0x231E: ", ".join(self._devices[name]),
            0x2324: ", ".join(self._counters.get(name, ())),
        }
        chassis = chassis_of(name)
        if chassis is not None:
            values[0x29B7] = chassis
        return messages.GetDeviceAttributeStringResponse(value=lookup(values, request.attribute_raw))

    def GetDeviceAttributeUInt32(self, request: Any, context: Any) -> Any:
        name = self._device(request.device_name)
        values = {0x0632: self._wiring.serial + list(self._devices).index(name)}
        return messages.GetDeviceAttributeUInt32Response(value=lookup(values, request.attribute_raw))

    def GetDeviceAttributeBool(self, request: Any, context: Any) -> Any:
        name = self._device(request.device_name)
        values = {0x22CA: True, 0x2FD6: bool(self._devices[name])}
        return messages.GetDeviceAttributeBoolResponse(value=lookup(values, request.attribute_raw))

    def ConfigureTEDS(self, request: Any, context: Any) -> Any:
        wire = self._wiring.wires.get(request.physical_channel)
        if wire is None or wire.teds is None or not wire.connected:
            text = f"no TEDS sensor on {request.physical_channel}"
            raise DaqmxError(DAQmxErrors.TEDS_SENSOR_NOT_DETECTED, text)
        self._sheets[request.physical_channel] = wire.teds
        return messages.ConfigureTEDSResponse()

    def GetPhysicalChanAttributeUInt32(self, request: Any, context: Any) -> Any:
        values = {0x21DC: self._sheet(request.physical_channel).serial}
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

"""Looks at what is there before anything is armed: devices, inputs, chassis, sensors' data sheets."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError

from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.sensors import known_sensor
from drivers.ni_daq.session import UNSUPPORTED

_OFFERS = {"ai": "ai_physical_chans", "ctr": "ci_physical_chans"}  # what lists them
_ROUNDING = 1 + 1e-9
TOLERANCE = 0.01
"""Of the sensitivity: twice what calibrations of a healthy sensor differ by."""
ABSENT = UNSUPPORTED | {  # no sheet to read: nothing is wrong with a sensor that has none
    DAQmxErrors.TEDS_SENSOR_NOT_DETECTED.value,
    DAQmxErrors.TEDS_NOT_SUPPORTED.value,
    DAQmxErrors.NO_TEDS_TERMINAL_BLOCK.value,
    DAQmxErrors.CANT_CONFIGURE_TEDS_FOR_CHAN.value,
    DAQmxErrors.INCAPABLE_TEDS_INTERFACE_CONTROLLING_DEVICE_SPECD.value,
    DAQmxErrors.CONFIGURED_TEDS_INTERFACE_DEV_NOT_DETECTED.value,
}
# The sheet is of another kind than the channel, or of a template that DAQmx cannot read.
UNREADABLE = {
    DAQmxErrors.TEDS_INCOMPATIBLE_SENSOR_AND_MEAS_TYPE.value,
    DAQmxErrors.TEDS_LEGACY_TEMPLATE_ID_INVALID_OR_UNSUPPORTED.value,
    DAQmxErrors.TEDS_TEMPLATE_PARAMETERS_NOT_SUPPORTED.value,
    DAQmxErrors.TEDS_SENSOR_DATA_ERROR.value,
    DAQmxErrors.PARSING_TEDS_DATA.value,
    DAQmxErrors.CORRUPTED_TEDS_MEMORY.value,
}


@dataclass(frozen=True, slots=True)
class DataSheet:
    """Serial number and, where DAQmx finds one for the channel's kind, sensitivity in V per unit.

    `fault` says why a sheet that is there could not be read.
    """

    serial: int
    sensitivity: float | None = None
    fault: str = ""

    def told(self, unit: str) -> str:
        """In words."""
        scale = "" if self.sensitivity is None else f", {1e3 * self.sensitivity:.4g} mV per {unit}"
        return f"TEDS: serial {self.serial}{scale}"


def read_sheet(device: Any, channel: CardChannel, new_task: Callable[[], Any]) -> DataSheet | None:
    """Return the sheet of the sensor on `channel`, None where there is none. Raises nidaqmx errors."""
    try:
        if not device.hwteds_supported:
            return None
        physical = device.ai_physical_chans[channel.physical]
        # Reads the sheet over the sensor's own wire, which takes its time.
        physical.configure_teds()
        serial = int(physical.teds_serial_num)
    except DaqError as error:
        if error.error_code in ABSENT:
            return None
        if error.error_code in UNREADABLE:
            return DataSheet(0, fault=_line(error))
        raise
    ask = known_sensor(channel).sheet
    if ask is None:
        return DataSheet(serial)
    try:
        task = new_task()
        try:
            return DataSheet(serial, ask(task, channel))
        finally:
            task.close()  # declared only to ask for the sensitivity: it must not hold the input
    except DaqError as error:
        if error.error_code not in UNREADABLE:
            raise
        return DataSheet(serial, fault=_line(error))


def mismatches(channel: CardChannel, sheet: DataSheet) -> Iterator[str]:
    """Say where the sheet and the bench file differ; a bench file without a serial number differs in none."""
    where = f"{channel.name} on {channel.physical}"
    if sheet.fault:
        yield f"{where}: its TEDS cannot be read ({sheet.fault})"
        return
    # A TEDS holds nothing but a number, an operator writes SN0123.
    numbers = re.findall(r"\d+", channel.serial)
    digits = (numbers[-1].lstrip("0") or "0") if numbers else ""
    if channel.serial and digits != str(sheet.serial):
        yield f"{where}: serial {sheet.serial} by its TEDS, {channel.serial} in the bench file"
    if sheet.sensitivity is not None and abs(sheet.sensitivity / channel.sensitivity - 1.0) > TOLERANCE:
        per = f"V per {channel.unit}"
        yield (
            f"{where}: sensitivity {sheet.sensitivity:.5g} {per} by its TEDS,"
            f" {channel.sensitivity:.5g} {per} in the bench file"
        )


def _line(error: DaqError) -> str:
    return f"DAQmx {error.error_code}, {' '.join(str(error).split())[:120]}"


@dataclass(slots=True)
class Survey:
    """What was found: `absent` and `wrong` say all that keeps the channels from being measured.

    `chassis` owns the sample clock; `sheets` are the TEDS found, by the channel's name; `simulated`: none of
    the devices is real.
    """

    present: tuple[str, ...] = ()
    identity: str = ""
    simulated: bool = False
    chassis: str = ""
    sheets: dict[str, DataSheet] = field(default_factory=dict)
    absent: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


def survey(system: Any, channels: Sequence[CardChannel], new_task: Callable[[], Any]) -> Survey:
    """Look at every device that the channels name. Raises nidaqmx errors.

    All must be modules of one chassis, whose modules share its sample clock; another chassis has a clock of
    its own, which is not synchronised here but refused.
    """
    devices = {device.name: device for device in system.devices}
    found = Survey(tuple(sorted(devices)))
    wanted: dict[str, list[CardChannel]] = {}
    for channel in channels:
        wanted.setdefault(channel.device, []).append(channel)
    identities: list[str] = []
    for name, there in wanted.items():
        if name not in devices:
            found.absent += [f"{channel.physical} (no device {name})" for channel in there]
            continue
        device, chassis = devices[name], _chassis(devices[name])
        simulated = ", simulated" if device.is_simulated else ""
        identities.append(f"{name}: {device.product_type}, serial {device.serial_num:X}{simulated}")
        found.chassis = found.chassis or chassis
        if chassis != found.chassis:
            other = f"{name} is in {chassis}, which does not share the sample clock of {found.chassis}"
            found.wrong += [f"{channel.name} on {channel.physical}: {other}" for channel in there]
        found.wrong += _too_large(device, [channel for channel in there if channel.input == "ai"])
        for channel in _offered(found, device, there):
            sheet = read_sheet(device, channel, new_task) if channel.input == "ai" else None
            if sheet is not None:
                found.sheets[channel.name] = sheet
                found.wrong += mismatches(channel, sheet)
    found.identity = "; ".join(identities)
    known = [devices[name] for name in wanted if name in devices]
    found.simulated = bool(known) and all(device.is_simulated for device in known)
    return found


def _too_large(device: Any, channels: Sequence[CardChannel]) -> Iterator[str]:
    """Say which ranges reach farther than inputs of their module do, each in its own words."""
    try:
        most_v = max(map(abs, device.ai_voltage_rngs), default=inf) if channels else inf
    except DaqError as error:
        if error.error_code not in UNSUPPORTED:
            raise
        return
    for channel in channels:
        if channel.full_scale_v > _ROUNDING * most_v:
            where = f"{channel.name} on {channel.physical}"
            told = f"{channel.range:g} {channel.unit}, is {channel.full_scale_v:g} V"
            yield f"{where}: its range, {told}, and an input of the {device.product_type} takes {most_v:g} V"


def _chassis(device: Any) -> str:
    try:
        return str(device.compact_daq_chassis_device.name)
    except DaqError as error:
        if error.error_code not in UNSUPPORTED:
            raise
        return str(device.name)  # not a module: it has a clock of its own


def _offered(found: Survey, device: Any, channels: Sequence[CardChannel]) -> list[CardChannel]:
    there: list[CardChannel] = []
    for kind, attribute in _OFFERS.items():
        # A module is asked only for what the bench file expects of it.
        asked = [channel for channel in channels if channel.input == kind]
        offered = set(getattr(device, attribute).channel_names) if asked else set()
        there += [channel for channel in asked if channel.physical in offered]
        found.absent += [
            f"{channel.physical} (no such input)" for channel in asked if channel.physical not in offered
        ]
    return there

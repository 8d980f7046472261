"""What a sensor says of itself: its electronic data sheet (IEEE 1451.4), held against the bench file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError

from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.faults import UNSUPPORTED
from drivers.ni_daq.kinds import ANALOG

TOLERANCE = 0.01
"""Of the sensitivity: twice what calibrations of a healthy sensor differ by."""
ABSENT = UNSUPPORTED | {
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


def read_sheet(device: Any, channel: CardChannel, new_task: Callable[[], Any]) -> DataSheet | None:
    """Return the sheet of the sensor on `channel`, None where there is none. Raises nidaqmx errors."""
    try:
        if not device.hwteds_supported:
            return None
        physical = device.ai_physical_chans[channel.physical]
        physical.configure_teds()
        serial = int(physical.teds_serial_num)
    except DaqError as error:
        return _without_sheet(error)
    try:
        return DataSheet(serial, _sensitivity(channel, new_task))
    except DaqError as error:
        if error.error_code not in UNREADABLE:
            raise
        return DataSheet(serial, fault=_line(error))


def _without_sheet(error: DaqError) -> DataSheet | None:
    if error.error_code in ABSENT:
        return None
    if error.error_code in UNREADABLE:
        return DataSheet(0, fault=_line(error))
    raise error


def _sensitivity(channel: CardChannel, new_task: Callable[[], Any]) -> float | None:
    sheet = ANALOG[channel.kind].sheet
    if sheet is None:
        return None
    task = new_task()
    try:
        return sheet(task, channel)
    finally:
        task.close()


def mismatches(channel: CardChannel, sheet: DataSheet) -> Iterator[str]:
    """Say where the sheet and the bench file differ; a bench file without a serial number differs in none."""
    where = f"{channel.name} on {channel.physical}"
    if sheet.fault:
        yield f"{where}: its TEDS cannot be read ({sheet.fault})"
        return
    if channel.serial and _digits(channel.serial) != str(sheet.serial):
        yield f"{where}: serial {sheet.serial} by its TEDS, {channel.serial} in the bench file"
    if sheet.sensitivity is not None and abs(sheet.sensitivity / channel.sensitivity - 1.0) > TOLERANCE:
        per = f"V per {channel.unit}"
        yield (
            f"{where}: sensitivity {sheet.sensitivity:.5g} {per} by its TEDS,"
            f" {channel.sensitivity:.5g} {per} in the bench file"
        )


def _digits(serial: str) -> str:
    """The number in a serial: a TEDS holds nothing but a number, an operator writes SN0123."""
    numbers = re.findall(r"\d+", serial)
    return numbers[-1].lstrip("0") or "0" if numbers else ""


def _line(error: DaqError) -> str:
    return f"DAQmx {error.error_code}, {' '.join(str(error).split())[:120]}"

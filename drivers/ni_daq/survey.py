"""Looks at what is there before anything is armed: devices, inputs, chassis, sensors' data sheets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from nidaqmx.errors import DaqError

from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.faults import UNSUPPORTED
from drivers.ni_daq.teds import DataSheet, mismatches, read_sheet

_OFFERS = {"ai": "ai_physical_chans", "ctr": "ci_physical_chans"}


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
        identities.append(_identity(devices[name]))
        _look_at_chassis(found, devices[name], there)
        for channel in _offered(found, devices[name], there):
            _look_at_sensor(found, devices[name], channel, new_task)
    found.identity = "; ".join(identities)
    known = [devices[name] for name in wanted if name in devices]
    found.simulated = bool(known) and all(device.is_simulated for device in known)
    return found


def _identity(device: Any) -> str:
    simulated = ", simulated" if device.is_simulated else ""
    return f"{device.name}: {device.product_type}, serial {device.serial_num:X}{simulated}"


def _look_at_chassis(found: Survey, device: Any, channels: Sequence[CardChannel]) -> None:
    chassis = _chassis(device)
    found.chassis = found.chassis or chassis
    if chassis != found.chassis:
        other = f"{device.name} is in {chassis}, which does not share the sample clock of {found.chassis}"
        found.wrong += [f"{channel.name} on {channel.physical}: {other}" for channel in channels]


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
        asked = [channel for channel in channels if channel.input == kind]
        offered = set(getattr(device, attribute).channel_names) if asked else set()
        there += [channel for channel in asked if channel.physical in offered]
        found.absent += [
            f"{channel.physical} (no such input)" for channel in asked if channel.physical not in offered
        ]
    return there


def _look_at_sensor(found: Survey, device: Any, channel: CardChannel, new_task: Callable[[], Any]) -> None:
    sheet = read_sheet(device, channel, new_task) if channel.input == "ai" else None
    if sheet is not None:
        found.sheets[channel.name] = sheet
        found.wrong += mismatches(channel, sheet)

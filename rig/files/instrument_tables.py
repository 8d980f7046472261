"""Tables of a bench file with more to them than their keys: the card with its channels (which sensor, on
which input, with which chain behind it), and an encoder on a CAN bus with its interface."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from daq.quantity import settings_of
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.ni_daq.channels import CardChannel, CardSettings
from drivers.ni_daq.sensing import (
    HIGHEST_FULL_SCALE_V,
    INPUT_WORDS,
    LOWEST_FULL_SCALE_V,
    keys_of,
    sort_of_input,
)
from drivers.ni_daq.sensors import SENSORS, AnalogSensor, known_sensor
from drivers.protocols.instrument import misplaced
from rig.files.faults import Faults, dotted
from rig.files.quantity import QuantityError, si_unit, si_value, written
from rig.files.table import read_table, sound_values, unknown_keys
from rig.rigs import channel_names, declared, unit_of
from sim_twin.rigs.channel_table import Role

_VOLT: Final = "V"


def read_card(table: object, key: str, faults: Faults) -> CardSettings | None:
    """Return the card with those channels that are sound; what is wrong with it or others is in `faults`."""
    if not isinstance(table, dict):
        faults.add(key, table, f"a table [{key}]")
        return None
    plain = {name: value for name, value in table.items() if name != "channels"}
    card = read_table(CardSettings, plain, key, faults)
    channels = _read_channels(table.get("channels", []), f"{key}.channels", faults)
    return None if card is None else dataclasses.replace(card, channels=channels)


def _read_channels(tables: object, key: str, faults: Faults) -> tuple[CardChannel, ...]:
    if not isinstance(tables, list) or not tables:
        faults.add(key, tables, f"at least one table [[{key}]]")
        return ()
    _note_twice(tables, key, "name", faults)
    _note_twice(tables, key, "physical", faults)
    inputs = [table.get("physical") for table in tables if isinstance(table, dict)]
    if inputs and all(isinstance(name, str) and sort_of_input(name) == "ctr" for name in inputs):
        faults.add(f"{key}.physical", inputs[0], f"{INPUT_WORDS['ai']} too, whose clock samples the counters")
    channels: list[CardChannel] = []
    for number, table in enumerate(tables, start=1):
        name = table.get("name") if isinstance(table, dict) else None
        # `daq_card.channels."yoke.force"`, or the table's number where it has no name
        here = dotted(key, name) if isinstance(name, str) and name else f"{key}[{number}]"
        if (channel := _channel(table, here, faults)) is not None:
            channels.append(channel)
    return tuple(channels)


def _note_twice(tables: list[Any], key: str, field: str, faults: Faults) -> None:
    given = [str(table[field]) for table in tables if isinstance(table, dict) and field in table]
    # NI's names do not tell upper from lower case
    for value, count in Counter(value.lower() for value in given).items():
        if count > 1:
            shown = next(name for name in given if name.lower() == value)
            faults.add(f"{key}.{field}", shown, f"each {field} once ({count} channels have it)")


def _channel(table: Any, key: str, faults: Faults) -> CardChannel | None:
    name = sound_values({"name": settings_of(CardChannel)["name"]}, table).get("name")
    known = None if name is None or unit_of(name) is None else declared(name)
    more: dict[str, Any] = {}
    if known is not None:
        more = {"unit": known.unit, "quantity": known.quantity, "location": known.location}
    elif name is not None and table.get("modelled") is False and declared(name) is None:
        more = _not_modelled(name, table)
    before = len(faults)
    channel = read_table(CardChannel, table, key, faults, more)
    if name is not None and not more:
        faults.unknown(f"{key}.name", name, name, channel_names())
    elif channel is not None and known is not None and not channel.modelled:
        faults.add(f"{key}.modelled", False, f"none: {name} is a channel of the rig, which its twin predicts")
    if (
        channel is not None
        and channel.in_stinger is not None
        and (known is None or known.role is not Role.DRIVE)
    ):
        faults.add(f"{key}.senses", table["senses"], "none: only the force of a drive has one")
    if channel is None or len(faults) > before:
        return None
    sensor = known_sensor(channel)
    if channel.pulses is not None and "decoding" not in keys_of(sensor):
        # of an encoder the counter sees both tracks, of a tachometer one
        channel = dataclasses.replace(channel, pulses=dataclasses.replace(channel.pulses, decoding=1))
    highest_v = HIGHEST_FULL_SCALE_V * (1 + 1e-9)
    if not channel.counted and not LOWEST_FULL_SCALE_V <= channel.full_scale_v <= highest_v:
        # a sensitivity in mV where the sensor gives V is a thousand times off
        arithmetic = (
            "a full scale of 1 mV to 10 V at the card, but range x sensitivity ="
            f" {channel.range:g} {channel.unit} x {channel.volts_per_unit:g} V per {channel.unit}"
            f" = {channel.full_scale_v:g} V; check both units"
        )
        faults.add_from(dict(table), "sensitivity", key, arithmetic)
        return None
    return channel if _held(channel, key, faults) else None


def _not_modelled(name: str, table: object) -> dict[str, Any]:
    """Of a channel that no rig's physics has, as its sensor tells; nothing where there is no such sensor."""
    keys = ("kind", "physical")
    said = sound_values({key: settings_of(CardChannel)[key] for key in keys}, table)
    sensor = SENSORS[said["kind"]].on(sort_of_input(said["physical"])) if said.keys() >= {*keys} else None
    if not isinstance(sensor, AnalogSensor):
        return {}
    location, _, quantity = name.rpartition(".")
    full_scale = table.get("range") if isinstance(table, dict) else None
    return {"unit": _unit_of(sensor, full_scale), "quantity": quantity, "location": location}


def _unit_of(sensor: AnalogSensor, full_scale: object) -> str:
    """Of a channel that only its `range` tells the unit of: one of its kind's, or any where that is any."""
    for unit in sensor.units:
        with suppress(QuantityError, OverflowError):
            si_value(str(full_scale), unit)
            return unit
    with suppress(QuantityError, OverflowError):
        if sensor.any_unit:
            return si_unit(written(full_scale)[1])
    return _VOLT if _VOLT in sensor.units else next(iter(sensor.units))


def _held(channel: CardChannel, key: str, faults: Faults) -> bool:
    """Whether the amplifier gives as much as the channel's full scale takes."""
    amplifier = channel.amplifier
    if amplifier is None or amplifier.output_v is None:
        return True
    if amplifier.output_v >= channel.full_scale_v * (1 - 1e-9):
        return True
    product = (
        f"{channel.range:g} {channel.unit} x {channel.sensitivity * 1e12:g} pC per {channel.unit}"
        f" x {(channel.gain or 1.0) * 1e-9:g} mV/pC = {channel.full_scale_v:g} V"
    )
    faults.add(
        f"{key}.amplifier.output",
        f"{amplifier.output_v:g} V",
        f"at least the channel's full scale, {product}",
    )
    return False


_OPTIONS: Final[Mapping[str, tuple[str, ...]]] = {"socketcand": ("host", "port", "channel", "tcp_tune")}
"""The keys of interfaces that are known here; of any other, python-can judges."""
_OWN: Final = tuple(settings_of(EncoderSettings))


def read_encoder(given: object, key: str, faults: Faults) -> EncoderSettings | None:
    """Return the encoder, or None after noting in `faults` all that is wrong with it."""
    own = {name: given[name] for name in _OWN if name in given} if isinstance(given, dict) else given
    encoder = read_table(EncoderSettings, own, key, faults)
    if not isinstance(given, dict):
        return None
    options = {name: value for name, value in given.items() if name not in _OWN}
    emulated, interface = given.get("emulated") is True, given.get("interface")
    before = len(faults)
    known = _OPTIONS.get(interface) if isinstance(interface, str) else None
    if known is not None:
        unknown_keys(options, (*_OWN, *known), key, faults)
    for name, value in options.items():
        if not isinstance(value, str | int | float | bool):
            faults.add(dotted(key, name), value, "a text, a number, true or false, as python-can wants it")
    if emulated and interface != "socketcand":
        faults.add(f"{key}.interface", interface, '"socketcand", which is how an emulated encoder is reached')
    elif interface == "socketcand":
        _socketcand_holds(options, emulated, key, faults)
    sound = len(faults) == before
    return dataclasses.replace(encoder, options=options) if encoder is not None and sound else None


def _socketcand_holds(options: dict[str, Any], emulated: bool, key: str, faults: Faults) -> None:
    meanings = {"channel": 'the bus\'s name, such as "can0"'}
    if not emulated:
        meanings |= {"host": "the server's address, 127.0.0.1", "port": "the server's port, such as 29536"}
    for name, meaning in meanings.items():
        if name not in options:
            faults.missing(f"{key}.{name}", meaning)
    host, port = options.get("host", "127.0.0.1"), options.get("port", 29536)
    if isinstance(port, bool) or not isinstance(port, int):
        faults.add(f"{key}.port", port, "a whole number from 1 to 65535")
    elif wrong := misplaced(f"{host}:{port}"):
        name = "port" if "65535" in wrong else "host"
        faults.add(f"{key}.{name}", options.get(name), wrong)

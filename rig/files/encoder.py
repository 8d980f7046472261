"""The table of a bench file for an encoder on a CAN bus; one on the card's counter is a channel."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

from daq.quantity import settings_of
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.protocols.instrument import misplaced
from rig.files.faults import Faults, dotted
from rig.files.table import read_table, unknown_keys

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

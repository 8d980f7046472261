"""The table of a bench file for an encoder on a CAN bus; one on the card's counter is a channel."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from daq.quantity import Key, Quantity, Text, Whole
from rig.files.faults import Faults, dotted
from rig.files.loopback import misplaced
from rig.files.table import read_table, unknown_keys

Option = str | int | float | bool
_WORD32: Final = Whole(0, 2**32 - 1)
_COUNTS: Final = Whole(1, 2**32 - 1)
_OPTIONS: Final[Mapping[str, tuple[str, ...]]] = {"socketcand": ("host", "port", "channel", "tcp_tune")}
"""The keys of interfaces that are known here; of any other, python-can judges."""


@dataclass(frozen=True, slots=True)
class EncoderIdentity:
    """What the encoder must say of itself; None is taken as it says."""

    counts_per_revolution: Annotated[int | None, _COUNTS] = None
    total_range: Annotated[int | None, _COUNTS] = None
    operating_parameters: Annotated[int | None, Whole(0, 0xFFFF)] = None
    vendor: Annotated[int | None, _WORD32] = None
    product: Annotated[int | None, _WORD32] = None
    revision: Annotated[int | None, _WORD32] = None
    serial: Annotated[int | None, _WORD32] = None


@dataclass(frozen=True, slots=True)
class _EncoderSection:
    node: Annotated[int, Whole(1, 127)]
    interface: Annotated[str, Text('an interface of python-can, such as "socketcand"', r"[a-z0-9_]+")]
    driver: Annotated[Literal["canopen_cia406"], Key()] = "canopen_cia406"
    period: Annotated[float, Quantity("ms", 1, 65535)] = 1e-3
    emulated: Annotated[bool, Key()] = False
    identity: Annotated[dict[str, Any] | None, Text("a table [encoder.identity]")] = None


@dataclasses.dataclass(frozen=True, slots=True)
class Encoder:
    """A CANopen encoder: `node` on a bus behind `interface`, whose own keys are `options`; `period` in s."""

    driver: Literal["canopen_cia406"]
    node: int
    interface: str
    options: Mapping[str, Option]
    period: float
    emulated: bool
    identity: EncoderIdentity


_OWN: Final = tuple(field.name for field in dataclasses.fields(_EncoderSection))
EMULATED: Final[Mapping[str, Any]] = {"interface": "socketcand", "channel": "can0", "node": 7}
"""What an emulated encoder leaves open."""


def with_emulated_defaults(table: Any) -> Any:
    """The table as it stands in a file; of an emulated encoder with what it leaves open."""
    return {**EMULATED, **table} if isinstance(table, dict) and table.get("emulated") is True else table


def read_encoder(table: object, key: str, faults: Faults) -> Encoder | None:
    """Return the encoder, or None after noting in `faults` all that is wrong with it."""
    given = with_emulated_defaults(table)
    own = {name: given[name] for name in _OWN if name in given} if isinstance(given, dict) else given
    section = read_table(_EncoderSection, own, key, faults)
    if not isinstance(given, dict):
        return None
    options = {name: value for name, value in given.items() if name not in _OWN}
    emulated, interface = given.get("emulated") is True, given.get("interface")
    sound = _options_hold(options, interface, emulated, key, faults)
    identity = read_table(EncoderIdentity, given.get("identity", {}), f"{key}.identity", faults)
    if section is None or identity is None or not sound:
        return None
    return Encoder(
        driver=section.driver,
        node=section.node,
        interface=section.interface,
        options=options,
        period=section.period,
        emulated=section.emulated,
        identity=identity,
    )


def _options_hold(
    options: dict[str, Any], interface: object, emulated: bool, key: str, faults: Faults
) -> bool:
    before = len(faults)
    known = _OPTIONS.get(interface) if isinstance(interface, str) else None
    if known is not None:
        unknown_keys(options, (*_OWN, *known), key, faults)
    for name, value in options.items():
        if not isinstance(value, str | int | float | bool):
            faults.add(dotted(key, name), value, "a text, a number, true or false, as python-can wants it")
    if emulated and interface != EMULATED["interface"]:
        faults.add(f"{key}.interface", interface, '"socketcand", which is how an emulated encoder is reached')
    elif interface == "socketcand":
        _socketcand_holds(options, emulated, key, faults)
    return len(faults) == before


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

"""The bench file: which instrument hangs where, and what of it is emulated."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic.dataclasses import dataclass

from rig.files.channels import BenchChannel, read_channels
from rig.files.embedded_bench import EMBEDDED_BENCH
from rig.files.faults import Faults, read_text, read_toml
from rig.files.fields import Measured, Switch, Text, Whole, Word
from rig.files.section import SECTION, Check, read_section, unknown_keys

_VISA: Final = Text(
    'a VISA address, such as "TCPIP::192.168.0.5::5025::SOCKET"',
    r"(TCPIP\d*::.+::(SOCKET|INSTR)|ASRL.+::INSTR|USB\d*::.+::INSTR|GPIB\d*::.+::INSTR)",
)
_ADDRESS: Final = Text('host:port, such as "127.0.0.1:31763"', r"[^\s:]+:\d{1,5}|\[::1\]:\d{1,5}")
_LOOPBACK_VISA = ("TCPIP::127.0.0.1::", "TCPIP0::127.0.0.1::", "TCPIP::localhost::", "ASRL")
_LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "[::1]")
_INSTRUMENTS: Final = ("signal_generator", "daq_card")
_LATER: Final = ("inverter", "encoder")
_KEYS: Final = (*_INSTRUMENTS, "emulation")


@dataclass(frozen=True, slots=True, config=SECTION)
class SignalGenerator:
    """The generator that drives the shaker's amplifier.

    `resource` is its VISA address, None when emulated; `force_per_volt` in N/V at the drive point,
    `maximum_amplitude` in N.
    """

    force_per_volt: Annotated[float, Measured("N/V", 0.001, 1000)]
    maximum_amplitude: Annotated[float, Measured("N", 0, 1000, above=True)]
    driver: Annotated[Literal["scpi_33220a"], Word(("scpi_33220a",))] = "scpi_33220a"
    resource: Annotated[str | None, _VISA] = None
    emulated: Annotated[bool, Switch()] = False


@dataclass(frozen=True, slots=True, config=SECTION)
class _CardSection:
    driver: Annotated[Literal["nidaqmx"], Word(("nidaqmx",))] = "nidaqmx"
    grpc: Annotated[str | None, _ADDRESS] = None
    emulated: Annotated[bool, Switch()] = False
    buffer: Annotated[float, Measured("s", 0.5, 120)] = 10.0


@dataclass(frozen=True, slots=True, config=SECTION)
class _EmulationSection:
    effects: Annotated[str | None, Text("the path of an effects file, seen from the bench file")] = None
    seed: Annotated[int | None, Whole(0, 2**63 - 1)] = None
    healthy: Annotated[bool, Switch()] = True


@dataclasses.dataclass(frozen=True, slots=True)
class DaqCard:
    """The acquisition card: `grpc` is the device server's host:port, None for this machine's own NI driver.

    `buffer` is how much the driver holds for a late reader, in s.
    """

    driver: Literal["nidaqmx"]
    grpc: str | None
    emulated: bool
    buffer: float
    channels: tuple[BenchChannel, ...]


@dataclasses.dataclass(frozen=True, slots=True)
class Emulation:
    """What the emulated rig really is: an effects file (resolved), a seed (None: a new one each run).

    `healthy` draws the rig within what a healthy one may differ by; without it it has the nominal values.
    """

    effects: Path | None = None
    seed: int | None = None
    healthy: bool = True


@dataclasses.dataclass(frozen=True, slots=True)
class Bench:
    """A checked bench in SI; `source` names the file and `text` is what stood in it."""

    signal_generator: SignalGenerator
    daq_card: DaqCard
    emulation: Emulation
    source: str
    text: str


def load_bench(path: str | Path) -> Bench:
    """Read a bench file; raises ConfigurationError with every fault in it."""
    return parse_bench(read_text(path), str(path), Path(path).resolve().parent)


def embedded_bench() -> Bench:
    """The bench of a run without one: every instrument of the impact beam, emulated."""
    return parse_bench(EMBEDDED_BENCH, "embedded bench", Path())


def _device_server_near(card: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if card["grpc"] is None:
        return
    host, _, port = card["grpc"].rpartition(":")
    if host not in _LOOPBACK_HOSTS:
        yield (
            "grpc",
            "127.0.0.1 and a port (nothing is encrypted; reach other machines by an SSH tunnel)",
        )
    elif not 0 < int(port) <= 65535:
        yield "grpc", "a port from 1 to 65535"


def _generator_reachable(generator: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    resource = generator["resource"]
    if resource is None and not generator["emulated"]:
        yield "resource", "the generator's VISA address, or emulated = true"
    if generator["emulated"] and resource is not None and not resource.startswith(_LOOPBACK_VISA):
        yield "resource", "127.0.0.1 (an emulated instrument listens on loopback only)"


_CARD_CHECKS: Final = (Check(("grpc",), _device_server_near),)
_GENERATOR_CHECKS: Final = (Check(("resource", "emulated"), _generator_reachable),)


def parse_bench(text: str, source: str, folder: Path) -> Bench:
    """Read a bench's text; paths in it start from `folder`. Raises ConfigurationError with every fault."""
    faults = Faults(source)
    given = read_toml(text, source)
    table = _with_defaults(given, faults)
    for key in _LATER:
        if table.pop(key, None) is not None:
            faults.add(key, {}, "none: this version drives the impact beam, which has no such instrument")
    unknown_keys(table, _KEYS, "", faults)
    generator = read_section(
        SignalGenerator, table["signal_generator"], "signal_generator", faults, _GENERATOR_CHECKS
    )
    card = _card(table["daq_card"], faults)
    emulation = _emulation(table.get("emulation", {}), folder, faults)
    if "emulation" in given and generator and card and not (generator.emulated or card.emulated):
        faults.add("emulation", given["emulation"], "none: no instrument of this bench is emulated")
    if faults or generator is None or card is None or emulation is None:
        raise faults.error()
    return Bench(generator, card, emulation, source, text)


def _with_defaults(given: dict[str, Any], faults: Faults) -> dict[str, Any]:
    """Fill what an emulated instrument leaves open from the embedded bench.

    An instrument that is not named is emulated as well; beside a real one it must be named, so that nobody
    drives an emulated shaker while waiting for the real one.
    """
    embedded = read_toml(EMBEDDED_BENCH, "embedded bench")
    some_real = any(key in given and not _emulated(given[key]) for key in _INSTRUMENTS)
    table = dict(given)
    for key in _INSTRUMENTS:
        if key not in given and some_real:
            faults.missing(key, f"a table [{key}] (emulated = true if it is not there)")
        if key not in given:
            table[key] = embedded[key]
        elif _emulated(given[key]):
            table[key] = {**embedded[key], **given[key]}
    return table


def _emulated(table: object) -> bool:
    return isinstance(table, dict) and table.get("emulated") is True


def _card(table: object, faults: Faults) -> DaqCard | None:
    if not isinstance(table, dict):
        faults.add("daq_card", table, "a table [daq_card]")
        return None
    plain = {key: value for key, value in table.items() if key != "channels"}
    section = read_section(_CardSection, plain, "daq_card", faults, _CARD_CHECKS)
    channels = read_channels(table.get("channels", []), "daq_card.channels", faults)
    if section is None:
        return None
    return DaqCard(section.driver, section.grpc, section.emulated, section.buffer, channels)


def _emulation(table: object, folder: Path, faults: Faults) -> Emulation | None:
    section = read_section(_EmulationSection, table, "emulation", faults)
    if section is None:
        return None
    effects = None if section.effects is None else folder / section.effects
    if effects is not None and not effects.is_file():
        faults.add("emulation.effects", section.effects, f"an existing file (looked for {effects})")
    return Emulation(effects, section.seed, section.healthy)

"""The bench file: which instrument hangs where, and what of it is emulated."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, TypeVar

from daq.quantity import Check, Key, Quantity, Text, Whole
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.loopback import misplaced
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.ni_daq.channels import CardChannel
from drivers.scpi.settings import GeneratorSettings
from rig.files.channels import read_channels
from rig.files.encoder import read_encoder, with_emulated_defaults
from rig.files.faults import Faults, read_toml
from rig.files.file_kind import read_file
from rig.files.table import read_table, unknown_keys
from rig.instruments import INSTRUMENTS
from rig.loaded_table import loaded
from rig.rigs import RIGS
from rig.rigs.kind import RigKind

_Actuator = TypeVar("_Actuator")
_ADDRESS: Final = Text('host:port, such as "127.0.0.1:31763"', r"[^\s:]+:\d{1,5}|\[::1\]:\d{1,5}")
_REAL_CARD: Final = (
    "false beside a real inverter: a motor that turns needs a real card on which its shaft shows; the speed "
    "guard would watch an emulated one. For a rehearsal set inverter.emulated = true as well"
)
_ENCODER_BESIDE: Final = {
    False: "false beside a real inverter: the speed guard would watch an emulated encoder, which shows the "
    "scenario's speed whatever the motor does. Without a real one leave [encoder] out",
    True: "true beside an emulated inverter: a real encoder stands while the emulated shaft turns, and the "
    "speed guard would end every run. Or leave [encoder] out",
}
"""By whether the inverter is emulated: what the encoder has to be, and why."""


def _card_reachable(card: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if card["grpc"] is not None and (wrong := misplaced(card["grpc"])):
        yield "grpc", wrong


@dataclass(frozen=True, slots=True)
class _CardSection:
    driver: Annotated[Literal["nidaqmx"], Key()] = "nidaqmx"
    grpc: Annotated[str | None, _ADDRESS] = None
    emulated: Annotated[bool, Key()] = False
    buffer: Annotated[float, Quantity("s", 0.5, 120)] = 10.0
    CHECKS: ClassVar = (Check(("grpc",), _card_reachable),)


@dataclass(frozen=True, slots=True)
class _EmulationSection:
    effects: Annotated[str | None, Text("the path of an effects file, seen from the bench file")] = None
    seed: Annotated[int | None, Whole(0, 2**63 - 1)] = None
    healthy: Annotated[bool, Key()] = True
    rest_offset: Annotated[float | Literal["drawn"] | None, Quantity("mm", -10, 10)] = None
    encoder_lag: Annotated[float | None, Quantity("ms", 0, 1000)] = None


@dataclasses.dataclass(frozen=True, slots=True)
class DaqCard:
    """The acquisition card: `grpc` is the device server's host:port, None for this machine's own NI driver.

    `buffer` is how much the driver holds for a late reader, in s.
    """

    driver: Literal["nidaqmx"]
    grpc: str | None
    emulated: bool
    buffer: float
    channels: tuple[CardChannel, ...]

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        """What the table says of one that is at `address`."""
        return {"grpc": address}

    def at(self, address: str) -> DaqCard:
        """The same one, at `address`."""
        return dataclasses.replace(self, grpc=address)


@dataclasses.dataclass(frozen=True, slots=True)
class Emulation:
    """What the emulated rig really is: an effects file (resolved), a seed (None: a new one each run).

    `healthy` draws the rig within what a healthy one may differ by; without it it has the nominal values.
    `rest_offset` is where the tip of a beam really rests (m, towards the upper stop), "drawn" anywhere within
    half of the clearance; None where the scenario says. An encoder on the bus shows where the shaft stood
    `encoder_lag` (s) ago.
    """

    effects: Path | None = None
    seed: int | None = None
    healthy: bool = True
    rest_offset: float | str | None = None
    encoder_lag: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class Bench:
    """A checked bench in SI, of the `rig` that it was read for; `source` names the file, `text` is what stood
    in it.
    """

    rig: str
    actuator: GeneratorSettings | InverterSettings
    daq_card: DaqCard
    encoder: EncoderSettings | None
    emulation: Emulation
    source: str
    text: str

    @property
    def signal_generator(self) -> GeneratorSettings:
        """The generator of a rig that has one; LookupError for another's bench."""
        return _of_kind(GeneratorSettings, self.actuator)

    @property
    def inverter(self) -> InverterSettings:
        """The inverter of a rig that has one; LookupError for another's bench."""
        return _of_kind(InverterSettings, self.actuator)

    @property
    def instruments(self) -> tuple[str, ...]:
        """The tables of its instruments, the actuator's first."""
        return (RIGS[self.rig].actuator, "daq_card", *(() if self.encoder is None else ("encoder",)))

    @property
    def emulated(self) -> tuple[str, ...]:
        """The tables of those that are emulated."""
        each = (self.actuator, self.daq_card, self.encoder)
        known = zip(self.instruments, each, strict=False)
        return tuple(table for table, instrument in known if instrument is not None and instrument.emulated)

    @property
    def unseen(self) -> bool:
        """Whether a real actuator moves a rig that the card, which is emulated, shows nothing of."""
        return _unseen(self.actuator, self.daq_card)


def load_bench(path: str | Path, rig: str | None = None) -> Bench:
    """Read a bench file for a rig (None: the one that its instruments are of).

    Raises ConfigurationError with every fault in it.
    """
    return parse_bench(read_file(path, "bench"), str(path), Path(path).resolve().parent, rig)


def embedded_bench(rig: str = "impact_beam") -> Bench:
    """The bench of a run without one: every instrument of the rig, emulated."""
    return parse_bench(RIGS[rig].bench, "embedded bench", Path(), rig)


def tables_of(bench: Bench) -> dict[str, Any]:
    """The tables that a bench was read from, with what its emulated instruments leave open filled in."""
    tables = _with_defaults(read_toml(bench.text, bench.source), RIGS[bench.rig], Faults(bench.source))
    if bench.encoder is not None:
        tables["encoder"] = with_emulated_defaults(tables["encoder"])
    return tables


def parse_bench(text: str, source: str, folder: Path, rig: str | None = None) -> Bench:
    """Read a bench's text; paths in it start from `folder`. Raises ConfigurationError with every fault."""
    faults = Faults(source)
    given = read_toml(text, source)
    kind = RIGS[_inferred_rig(given) if rig is None else rig]
    _note_foreign(given, kind, faults)
    table = _with_defaults(given, kind, faults)
    unknown_keys(table, (*INSTRUMENTS, "emulation"), "", faults)
    settings = loaded(INSTRUMENTS[kind.actuator].settings)
    actuator: Any = read_table(settings, table[kind.actuator], kind.actuator, faults)
    card = _card(table["daq_card"], faults)
    encoder = None
    if "encoder" in kind.extras and "encoder" in given:
        encoder = read_encoder(given["encoder"], "encoder", faults)
    lags = "encoder" in kind.extras and _emulated(given.get("encoder"))
    emulation = _emulation(table.get("emulation", {}), kind, lags, folder, faults)
    idle = actuator and card and not any(_emulated(table.get(name)) for name in INSTRUMENTS)
    if "emulation" in given and idle:
        faults.add("emulation", given["emulation"], "none: no instrument of this bench is emulated")
    if kind.turns and kind.actuator in given and actuator and card:
        _note_mixed(actuator, card, encoder, faults)
    if faults or actuator is None or card is None or emulation is None:
        raise faults.error()
    return Bench(kind.name, actuator, card, encoder, emulation, source, text)


def _note_mixed(
    actuator: GeneratorSettings | InverterSettings,
    card: DaqCard,
    encoder: EncoderSettings | None,
    faults: Faults,
) -> None:
    """Note what does not look at the shaft that the motor turns."""
    if _unseen(actuator, card):
        faults.add("daq_card.emulated", True, _REAL_CARD)
    if encoder is not None and encoder.emulated != actuator.emulated:
        faults.add("encoder.emulated", encoder.emulated, _ENCODER_BESIDE[actuator.emulated])


def _unseen(actuator: GeneratorSettings | InverterSettings, card: DaqCard) -> bool:
    return card.emulated and not actuator.emulated


def _of_kind(kind: type[_Actuator], actuator: object) -> _Actuator:
    if not isinstance(actuator, kind):
        raise LookupError(f"this bench has no {kind.__name__}")
    return actuator


def _inferred_rig(given: Mapping[str, Any]) -> str:
    """The rig that the instruments are of, by actuator, then by channels; the first where nothing tells."""
    card = given.get("daq_card")
    tables = card.get("channels") if isinstance(card, dict) else None
    named = tables if isinstance(tables, list) else []
    names = [each.get("name") for each in named if isinstance(each, dict)]

    def matches(kind: RigKind) -> tuple[bool, int]:
        known = sum(isinstance(name, str) and kind.channel_unit(name) is not None for name in names)
        return any(name in given for name in (kind.actuator, *kind.extras)), known

    return max(RIGS.values(), key=matches).name


def _note_foreign(given: Mapping[str, Any], kind: RigKind, faults: Faults) -> None:
    """Note the instruments that this rig has no use for."""
    for name, instrument in INSTRUMENTS.items():
        if name in given and name not in (kind.actuator, "daq_card", *kind.extras):
            driven = f"none: the {kind.name} is driven by [{kind.actuator}]"
            faults.add(
                name, given[name], driven if instrument.actuator else f"none: the {kind.name} has none"
            )


def _with_defaults(given: dict[str, Any], kind: RigKind, faults: Faults) -> dict[str, Any]:
    """Fill what an emulated instrument leaves open from the rig's embedded bench.

    An instrument that is not named is emulated as well; beside a real one it must be named, so that nobody
    drives an emulated shaker while waiting for the real one.
    """
    embedded = read_toml(kind.bench, "embedded bench")
    some_real = any(name in given and not _emulated(given[name]) for name in INSTRUMENTS)
    table = dict(given)
    for name in (kind.actuator, "daq_card"):
        if name not in given and some_real:
            faults.missing(name, f"a table [{name}] (emulated = true if it is not there)")
        if name not in given:
            table[name] = embedded[name]
        elif _emulated(given[name]):
            table[name] = {**embedded[name], **given[name]}
    return table


def _emulated(table: object) -> bool:
    return isinstance(table, dict) and table.get("emulated") is True


def _card(table: object, faults: Faults) -> DaqCard | None:
    if not isinstance(table, dict):
        faults.add("daq_card", table, "a table [daq_card]")
        return None
    plain = {key: value for key, value in table.items() if key != "channels"}
    section = read_table(_CardSection, plain, "daq_card", faults)
    channels = read_channels(table.get("channels", []), "daq_card.channels", faults)
    if section is None:
        return None
    return DaqCard(section.driver, section.grpc, section.emulated, section.buffer, channels)


def _emulation(table: Any, kind: RigKind, lags: bool, folder: Path, faults: Faults) -> Emulation | None:
    """Read the table; `lags` is whether an emulated encoder is there that could."""
    section = read_table(_EmulationSection, table, "emulation", faults)
    if section is None:
        return None
    effects = None if section.effects is None else folder / section.effects
    if effects is not None and not effects.is_file():
        faults.add("emulation.effects", section.effects, f"an existing file (looked for {effects})")
    if section.rest_offset is not None and "rest_offset" not in kind.model:
        faults.add_from(table, "rest_offset", "emulation", f"none: the {kind.name} has no such place")
    if section.encoder_lag is not None and not lags:
        faults.add_from(table, "encoder_lag", "emulation", "none: this bench has no emulated [encoder]")
    return Emulation(effects, section.seed, section.healthy, section.rest_offset, section.encoder_lag or 0.0)

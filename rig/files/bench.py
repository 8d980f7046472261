"""The bench file: which instrument hangs where, and what of it is emulated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any, Final, Literal, TypeVar

from daq.errors import ConfigurationError
from daq.quantity import Key, Quantity, Text, Whole
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.mitsubishi_fr.registers import Terminal
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.ni_daq.channels import CardSettings
from drivers.protocols.emergency_stop import STOP_TABLE, StopLine
from drivers.rehearsal import Rehearsed, rehearsed
from rig.files.effects_file import load_effects
from rig.files.faults import Faults, raised_by, read_toml
from rig.files.file_kind import read_file
from rig.files.table import read_table, unknown_keys
from rig.instruments import INSTRUMENTS
from rig.rigs import RIGS
from rig.rigs.kind import RigKind

_Settings = TypeVar("_Settings")
_CARD: Final = "daq_card"
"""Which every bench has: its sample clock is the time base of all the others."""
_REAL_CARD: Final = (
    "false beside a real {actuator}: a motor that turns needs a real card on which its shaft shows; the "
    "speed guard would watch an emulated one. For a rehearsal set {actuator}.emulated = true as well"
)
_BESIDE: Final = {
    False: "false beside a real {actuator}: the speed guard would watch an emulated {name}, which shows the "
    "scenario's speed whatever the motor does. Without a real one leave [{name}] out",
    True: "true beside an emulated {actuator}: a real {name} stands while the emulated shaft turns, and the "
    "speed guard would end every run. Or leave [{name}] out",
}
"""By whether the actuator is emulated: what else looks at its shaft has to be, and why."""


@dataclass(frozen=True, slots=True)
class Emulation:
    """The table [emulation]: what the emulated rig really is.

    `effects` is an effects file, resolved once it is read; `seed` None is a new one each run. `healthy` draws
    the rig within what a healthy one may differ by; without it it has the nominal values. `rest_offset` is
    where the tip of a beam really rests (m, towards the upper stop), "drawn" anywhere within half of the
    clearance; None where the scenario says. An encoder on the bus shows where the shaft stood `encoder_lag`
    (s) ago. `faults` come to what is emulated, or to the disk (`drivers.rehearsal`).
    """

    effects: Annotated[Path | None, Text("the path of an effects file, seen from the bench file")] = None
    seed: Annotated[int | None, Whole(0, 2**63 - 1)] = None
    healthy: Annotated[bool, Key()] = True
    rest_offset: Annotated[float | Literal["drawn"] | None, Quantity("mm", -10, 10)] = None
    encoder_lag: Annotated[float, Quantity("ms", 0, 1000)] = 0.0
    faults: Annotated[tuple[str, ...], Text("a list of faults to rehearse, NAME[@TIME][:key=value]...")] = ()

    def rehearsed(self, table: str) -> tuple[Rehearsed, ...]:
        """The faults of one instrument, by its table; or of the disk."""
        return tuple(each for each in map(rehearsed, self.faults) if each.table == table)


@dataclass(frozen=True, slots=True)
class Bench:
    """A checked bench in SI, of the `rig` that it was read for; `source` names the file, `text` is what stood
    in it.

    `instruments` are the settings of each, by its table, the actuator's first.
    """

    rig: str
    instruments: Mapping[str, Any]
    emulation: Emulation
    source: str
    text: str

    def the(self, kind: type[_Settings]) -> _Settings:
        """The settings of the instrument that has such ones; LookupError for the bench of another rig."""
        found = next((each for each in self.instruments.values() if isinstance(each, kind)), None)
        if found is None:
            raise LookupError(f"this bench has no {kind.__name__}")
        return found

    @property
    def actuator_table(self) -> str:
        """The table of what drives the rig."""
        return next(iter(self.instruments))

    @property
    def actuator(self) -> Any:
        return self.instruments[self.actuator_table]

    @property
    def daq_card(self) -> CardSettings:
        """The card, whose clock is everybody's time base."""
        return self.the(CardSettings)

    @property
    def encoder(self) -> EncoderSettings | None:
        """The encoder beside the card, which a rig that turns may have."""
        return next((each for each in self.instruments.values() if isinstance(each, EncoderSettings)), None)

    @property
    def stop_line(self) -> StopLine | None:
        """The emergency stop's line, which one of them reads."""
        if isinstance(self.actuator, InverterSettings) and self.actuator.stop_line is not None:
            return self.actuator.stop_line
        return self.daq_card.stop_line

    @property
    def loggers(self) -> tuple[str, ...]:
        """The tables of those that measure beside the card, whatever the rig is."""
        return tuple(table for table in self.instruments if INSTRUMENTS[table].logs)

    @property
    def emulated(self) -> tuple[str, ...]:
        return tuple(table for table, settings in self.instruments.items() if settings.emulated)

    @property
    def unseen(self) -> bool:
        """Whether a real actuator moves a rig that the card, which is emulated, shows nothing of."""
        return self.daq_card.emulated and not self.actuator.emulated


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
    return _with_defaults(read_toml(bench.text, bench.source), RIGS[bench.rig], Faults(bench.source))


def parse_bench(text: str, source: str, folder: Path, rig: str | None = None) -> Bench:
    """Read a bench's text; paths in it start from `folder`. Raises ConfigurationError with every fault."""
    faults, given = Faults(source), read_toml(text, source)
    kind = RIGS[_inferred_rig(given) if rig is None else rig]
    drives = _driving(given, kind)
    for name, instrument in INSTRUMENTS.items():
        if name in given and name not in _known(kind, drives):
            why = f"is driven by [{drives}]" if instrument.actuator else "has none"
            faults.add(name, given[name], f"none: the {kind.name} {why}")
    table = _with_defaults(given, kind, faults)
    unknown_keys(table, (*INSTRUMENTS, "emulation", STOP_TABLE), "", faults)
    instruments: dict[str, Any] = {}  # the settings of each; None where some of them are wrong
    for name in (name for name in _known(kind, drives) if name in table):
        read, settings = INSTRUMENTS[name].reader, resolve_name(INSTRUMENTS[name].settings)
        reader = resolve_name(read) if read else partial(read_table, settings)
        instruments[name] = reader(table[name], name, faults)
    emulated = tuple(name for name in table if name in INSTRUMENTS and _emulated(table[name]))
    meant = (kind, *(RIGS.values() if rig is None else ()))  # a bench alone may be any rig's
    emulation = _emulation(table.get("emulation", {}), meant, emulated, folder, faults)
    actuator, card = instruments[drives], instruments[_CARD]
    watch_line(given, kind, instruments, faults)
    if "emulation" in given and actuator and card and not emulated:
        faults.add("emulation", given["emulation"], "none: no instrument of this bench is emulated")
    if kind.turns and drives in given and actuator and card:  # what else shows its shaft
        if card.emulated and not actuator.emulated:
            faults.add(f"{_CARD}.emulated", True, _REAL_CARD.format(actuator=drives))
        for name in kind.extras:
            beside = instruments.get(name)
            if beside is not None and beside.emulated != actuator.emulated:
                why = _BESIDE[actuator.emulated].format(actuator=drives, name=name)
                faults.add(f"{name}.emulated", beside.emulated, why)
    if faults or emulation is None:
        raise faults.error()
    return Bench(kind.name, instruments, emulation, source, text)


def watch_line(given: Mapping[str, Any], kind: RigKind, instruments: dict[str, Any], faults: Faults) -> None:
    """Have the instrument that an emergency stop's line is on read it, where a bench has one."""
    line = read_table(StopLine, given[STOP_TABLE], STOP_TABLE, faults) if STOP_TABLE in given else None
    if line is None or None in instruments.values():
        return
    table = "inverter" if line.terminal else _CARD
    if table not in instruments:
        faults.add(f"{STOP_TABLE}.line", line.line, f"one of the card: this bench has no [{table}]")
    elif line.terminal and line.terminal not in Terminal.__members__:
        faults.add(f"{STOP_TABLE}.line", line.line, f"inverter/ and one of {', '.join(Terminal.__members__)}")
    elif instruments[table].emulated and not instruments[drives := _driving(given, kind)].emulated:
        allowed = f"a line of a real instrument: an emulated one knows of nobody who stops [{drives}]"
        faults.add(f"{STOP_TABLE}.line", line.line, allowed)
    else:
        instruments[table] = replace(instruments[table], stop_line=line)


def actuators(kind: RigKind) -> tuple[str, ...]:
    """The tables of what may drive a rig, its own first."""
    drive = f"{kind.drive.__module__}:{kind.drive.__qualname__}"
    giving = (name for name, each in INSTRUMENTS.items() if each.actuator and each.actuator.drive == drive)
    return tuple(dict.fromkeys((kind.actuator, *giving)))


def _driving(given: Mapping[str, Any], kind: RigKind) -> str:
    """The first of them that a bench has; the rig's own where it has none."""
    return next((name for name in actuators(kind) if name in given), kind.actuator)


def _known(kind: RigKind, drives: str) -> Iterable[str]:
    """The tables of instruments that a bench may have where one of them drives; the first two it must."""
    return drives, _CARD, *kind.extras, *(name for name, each in INSTRUMENTS.items() if each.logs)


def _inferred_rig(given: Mapping[str, Any]) -> str:
    """The rig that the instruments are of, by actuator, then by channels; the first where nothing tells."""
    card = given.get("daq_card")
    tables = card.get("channels") if isinstance(card, dict) else None
    named = tables if isinstance(tables, list) else []
    names = [each.get("name") for each in named if isinstance(each, dict)]

    def matches(kind: RigKind) -> tuple[bool, int]:
        known = sum(isinstance(name, str) and kind.channels.unit(name) is not None for name in names)
        return any(name in given for name in (*actuators(kind), *kind.extras)), known

    return max(RIGS.values(), key=matches).name


def _with_defaults(given: dict[str, Any], kind: RigKind, faults: Faults) -> dict[str, Any]:
    """Fill what an emulated instrument leaves open from the rig's embedded bench.

    An instrument that is not named is emulated as well; beside a real one it must be named, so that nobody
    drives an emulated shaker while waiting for the real one.
    """
    embedded, drives = read_toml(kind.bench, "embedded bench"), _driving(given, kind)
    some_real = any(name in given and not _emulated(given[name]) for name in INSTRUMENTS)
    table = dict(given)
    for name in (drives, _CARD):
        if name not in given and some_real:
            faults.missing(name, f"a table [{name}] (emulated = true if it is not there)")
        if name not in given:
            table[name] = embedded[name]
    for name in _known(kind, drives):
        if name in given and _emulated(given[name]):
            table[name] = {**embedded.get(name, INSTRUMENTS[name].left_open), **given[name]}
    return table


def _emulated(table: object) -> bool:
    return isinstance(table, dict) and table.get("emulated") is True


def _emulation(
    table: Any, meant: Sequence[RigKind], emulated: Iterable[str], folder: Path, faults: Faults
) -> Emulation | None:
    """Read the table of a bench whose instruments `emulated` are so; its effects are of one of `meant`."""
    kind, emulation = meant[0], read_table(Emulation, table, "emulation", faults)
    if emulation is None:
        return None
    effects = None if emulation.effects is None else folder / emulation.effects
    if effects is not None and not effects.is_file():
        faults.add("emulation.effects", table["effects"], f"an existing file (looked for {effects})")
    elif effects is not None:
        wrong = [raised_by(partial(load_effects, effects, each.nominal().model.effects)) for each in meant]
        for problem in wrong[0] if all(wrong) else ():
            faults.note(replace(problem, key=f"emulation.effects {problem.key}"))
    for text in emulation.faults:
        try:
            if (table_of := rehearsed(text).table) not in (*emulated, "disk"):
                faults.add("emulation.faults", text, f"none: [{table_of}] is not emulated here")
        except ConfigurationError as error:
            faults.add("emulation.faults", text, error.problems[0].allowed)
    if "rest_offset" in table and "rest_offset" not in kind.model:
        faults.add_from(table, "rest_offset", "emulation", f"none: the {kind.name} has no such place")
    if "encoder_lag" in table and "encoder" not in {*kind.extras} & {*emulated}:
        faults.add_from(table, "encoder_lag", "emulation", "none: this bench has no emulated [encoder]")
    return replace(emulation, effects=effects)

"""What other installed packages add: rigs, instruments, effects, sensor kinds, file formats, report sections.

A package says in its `[project.entry-points."rattle.report_sections"]`, or in whichever group it adds to,
`name = "module:object"`. What is wrong with one package takes nothing away from the others.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar, cast

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
GROUPS: Final = tuple(
    f"rattle.{each}"
    for each in ("rigs", "instruments", "sensors", "effects", "formats", "report_sections", "subjects")
)
UNUSED: Final[list[str]] = []
"""A sentence for each thing of another package that this process passed over; the command tells them."""


@dataclass(frozen=True, slots=True)
class Plugins(Generic[T]):
    """Objects of a group by name, in the order of their names, and a sentence for each that is not used."""

    found: dict[str, T]
    faults: tuple[str, ...]


def plugins(group: str, kind: type[T], taken: Collection[str] = (), owner: str = "") -> Plugins[T]:
    """Import what installed packages offer in `group`, each an instance of `kind`.

    `taken` are the names that the group has already. What has a `name` is offered under it, or not used. With
    an `owner` only what is offered as owner.name counts, under the name alone. What stands in a group that
    nobody knows is told with the nearest one. The faults go to `UNUSED` as well.
    Looks through all installed packages (milliseconds) and runs their code: called once for a table, by
    whoever needs it, never as a module is imported.
    """
    from importlib.metadata import entry_points  # a list of commands needs none of what it imports

    found: dict[str, T] = {}
    faults: list[str] = []
    holders = dict.fromkeys(taken, "rattle itself")
    before = f"{owner}." if owner else ""
    installed = entry_points()
    groups = (each for each in installed.groups if group in (each, _meant(each)))
    offered = (point for each in groups for point in installed.select(group=each))
    for point in sorted(offered, key=lambda point: (point.name, _package(point))):
        if not point.name.startswith(before):
            continue
        name = point.name.removeprefix(before)
        whose = f"{point.group}: {point.name} of {_package(point)} is not used"
        if point.group != group:
            faults.append(f"{whose}: there is no such group; did you mean {group}?")
            continue
        if name in holders:
            faults.append(f"{whose}: that of {holders[name]} has the name")
            continue
        try:
            thing: Any = point.load()
            called = str(getattr(thing, "name", name))
        except (Exception, SystemExit) as error:  # another package's code may do anything as it is imported
            faults.append(f"{whose}: it does not load ({type(error).__name__}: {error})")
            continue
        if not isinstance(thing, kind):
            faults.append(f"{whose}: {point.value} is of {type(thing).__name__}, wanted is {kind.__name__}")
        elif called != name:
            faults.append(f"{whose}: {point.value} calls itself {called}")
        else:
            found[name], holders[name] = thing, _package(point)
    UNUSED.extend(fault for fault in faults if fault not in UNUSED)
    return Plugins(found, tuple(faults))


class OpenTable(Mapping[str, T], Generic[T]):
    """The entries of this project, then those that other packages add in a group, by name.

    One of this project that is given by its place (module:name) is imported when it is asked for. Other
    packages' code runs when all entries are asked for, or one that is none of this project's.
    """

    def __init__(self, own: Mapping[str, T | str], group: str, kind: type[T], owner: str = "") -> None:
        self.own, self._group, self._kind, self.owner = own, group, kind, owner

    @cached_property
    def added(self) -> Mapping[str, T]:
        """Those of other packages; what is wrong with them goes to `UNUSED`."""
        return plugins(self._group, self._kind, self.own, self.owner).found

    def __getitem__(self, name: str) -> T:
        if name not in self.own:
            return self.added[name]
        own = self.own[name]
        return cast(T, resolve_name(own) if isinstance(own, str) else own)

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in self.added

    def __iter__(self) -> Iterator[str]:
        yield from (*self.own, *self.added)

    def __len__(self) -> int:
        return len(self.own) + len(self.added)


def _meant(group: str) -> str:
    """The group that an unknown one is meant for; empty where it is known, or not of rattle."""
    ours = group.lower().startswith("rattle.") and group not in GROUPS
    return difflib.get_close_matches(group, GROUPS, n=1, cutoff=0.0)[0] if ours else ""


def _package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "a package without a name"

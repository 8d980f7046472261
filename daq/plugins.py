"""What other installed packages add: rigs, instruments, effects, sensor kinds, file formats, report sections.

A package says in its `[project.entry-points."rattle.report_sections"]`, or in whichever group it adds to,
`name = "module:object"`. What is wrong with one package takes nothing away from the others.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Plugins(Generic[T]):
    """Objects of a group by name, in the order of their names, and a sentence for each that is not used."""

    found: dict[str, T]
    faults: tuple[str, ...]


def plugins(group: str, kind: type[T], taken: Collection[str] = ()) -> Plugins[T]:
    """Import what installed packages offer in `group`, each an instance of `kind`.

    `taken` are the names that the group has already. Looks through all installed packages (milliseconds) and
    runs their code: called once for a table, by whoever needs it, never as a module is imported.
    """
    found: dict[str, T] = {}
    faults: list[str] = []
    offered = sorted(entry_points(group=group), key=lambda point: (point.name, _package(point)))
    for point in offered:
        whose = f"{group}: {point.name} of {_package(point)} is not used"
        if point.name in taken or point.name in found:
            faults.append(f"{whose}: there is one of that name already")
            continue
        try:
            thing: Any = point.load()
        except Exception as error:  # another package's code may raise anything as it is imported
            faults.append(f"{whose}: it does not load ({type(error).__name__}: {error})")
            continue
        if isinstance(thing, kind):
            found[point.name] = thing
        else:
            faults.append(f"{whose}: {point.value} is of {type(thing).__name__}, wanted is {kind.__name__}")
    return Plugins(found, tuple(faults))


def _package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "a package without a name"

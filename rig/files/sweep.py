"""The sweep file: a scenario, the axes along which it is varied, and how each point is recorded."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

from daq.errors import ConfigurationError, Problem
from daq.quantity import Key, Quantity, Text, Whole, rule, settings_of
from rig.files.faults import Faults, read_toml, toml_of
from rig.files.file_kind import read_file
from rig.files.scenario import LEVEL_UP_TO, Scenario, scenario_of, with_values
from rig.files.sweep_axes import Axis, Value, read_axes, there_and_back
from rig.files.table import NOTHING, FieldError, quantity_field, read_table, sound_values, unknown_keys
from rig.rigs import RIGS
from rig.rigs.kind import RigKind

_KEYS: Final = ("sweep", "scenario", "axes", "acquisition")
_MOST_POINTS: Final = 10_000
_ONCE: Final = "each key of [axes] once"
_LONGEST_NAME: Final = 200


@dataclass(frozen=True, slots=True)
class _SweepSection:
    name: Annotated[str, Text("a text of one line, up to 120 characters", longest=120)]
    order: Annotated[tuple[str, ...] | None, Text(f"{_ONCE}, the one that changes least often first")] = None
    up_and_down: Annotated[tuple[str, ...], Text("keys of [axes] that go there and back")] = ()
    until: Annotated[dict[str, Any] | None, Text('such as { impacts = 15, longest = "60 s" }')] = None
    centre: Annotated[bool, Key()] = False


@dataclass(frozen=True, slots=True)
class _UntilSection:
    impacts: Annotated[int, Whole(1, 1_000_000)]
    longest: Annotated[float | None, Quantity("s", 0.01, 86_400)] = None
    channels: Annotated[tuple[str, ...] | None, Text("a list of force channels of the rig")] = None
    above: Annotated[str | float | None, Text("a quantity in the channels' unit")] = None


@dataclass(frozen=True, slots=True)
class _PointAcquisition:
    sample_rate: Annotated[float | None, Quantity("Hz", 1000, 204_800)] = None
    settle: Annotated[float | None, Quantity("s", 0, 3600)] = None
    duration: Annotated[float | None, Quantity("s", 0.001, 86_400)] = None
    cycles: Annotated[float | None, Quantity("", 1, 1e7)] = None
    CHECKS: ClassVar = (
        rule(
            ("cycles", "duration"),
            lambda acquisition: acquisition["cycles"] is None or acquisition["duration"] is None,
            "cycles",
            "either cycles of the drive or a duration",
        ),
    )


@dataclasses.dataclass(frozen=True, slots=True)
class Until:
    """A point's record ends with the `impacts`-th impact on `channels`, together, or after `longest` s.

    `above` in the channels' unit is what an impact has to pass; None: 15 % of the largest.
    """

    impacts: int
    longest: float
    channels: tuple[str, ...]
    above: float | None


@dataclasses.dataclass(frozen=True, slots=True)
class Point:
    """One run of a sweep: its number from 1, the axes' values as written, and the checked scenario.

    `path`: the sections [drive] of the points that the drive comes through to this one, without a rest.
    """

    number: int
    settings: Mapping[str, Value]
    scenario: Scenario
    path: tuple[Any, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class Sweep:
    """A checked sweep; `axes` outermost first. `base` is the text of the scenario that it varies."""

    name: str
    rig: str
    axes: tuple[Axis, ...]
    points: tuple[Point, ...]
    until: Until | None
    centre: bool
    source: str
    text: str
    base: str


def load_sweep(path: str | Path, settings: Mapping[str, object] = NOTHING) -> Sweep:
    """Read a sweep file, some keys of its scenario with other values.

    Raises ConfigurationError with every fault in it and in its points.
    """
    return parse_sweep(read_file(path, "sweep"), str(path), Path(path).resolve().parent, settings)


def parse_sweep(text: str, source: str, folder: Path, settings: Mapping[str, object] = NOTHING) -> Sweep:
    """Read a sweep's text; the path of its scenario starts from `folder`."""
    faults = Faults(source)
    table = read_toml(text, source)
    unknown_keys(table, _KEYS, "", faults)
    base, base_text = _base(table, folder, faults)
    given = table.get("sweep", {})
    if isinstance(given, dict):  # the scenario's path is no setting of the sweep itself
        given = {key: value for key, value in given.items() if key != "scenario"}
    section = read_table(_SweepSection, given, "sweep", faults)
    acquisition = read_table(_PointAcquisition, table.get("acquisition", {}), "acquisition", faults)
    kind = RIGS.get(str(base.get("rig")))
    if kind is None:
        faults.add("scenario.rig", base.get("rig", ""), " or ".join(RIGS))
        raise faults.error()
    axes = read_axes(table.get("axes"), kind, faults)
    until = None if section is None else _until(section.until, base, kind, faults)
    ordered = () if section is None else _ordered(axes, section, faults)
    if section is not None and section.centre:
        if kind.name != "impact_beam":
            faults.add("sweep.centre", True, "false (only the impact beam rests between two stops)")
        elif "drive.offset" in axes:
            faults.add("sweep.centre", True, "false with the axis drive.offset, which centring sets")
    faults.raise_if_any()
    if section is None or acquisition is None:
        raise faults.error()
    base = _with_acquisition(with_values(base, settings), table.get("acquisition", {}), until)
    points = tuple(_points(section.name, base, ordered, acquisition.cycles, kind, faults))
    faults.raise_if_any()
    points = _with_paths(points, ordered)
    return Sweep(section.name, kind.name, ordered, points, until, section.centre, source, text, base_text)


def _base(table: Mapping[str, Any], folder: Path, faults: Faults) -> tuple[dict[str, Any], str]:
    """Table and text of the scenario, from its file or from the table [scenario]."""
    sweep = table.get("sweep")
    path = sweep.get("scenario") if isinstance(sweep, dict) else None
    inline = table.get("scenario")
    if (path is None) == (inline is None):
        allowed = "a path behind sweep.scenario or tables [scenario], one of the two"
        faults.add("scenario", "(both)" if path is not None else "(none)", allowed)
        raise faults.error()
    if isinstance(path, str):
        text = read_file(folder / path, "scenario")
        return read_toml(text, str(folder / path)), text
    if not isinstance(inline, dict):
        faults.add("sweep.scenario", path, "the path of a scenario, seen from the sweep file")
        raise faults.error()
    return inline, toml_of(inline)


def _ordered(axes: Mapping[str, Axis], section: _SweepSection, faults: Faults) -> tuple[Axis, ...]:
    order = tuple(axes) if section.order is None else section.order
    if not faults and sorted(order) != sorted(axes):
        faults.add("sweep.order", list(order), f"{_ONCE}: {', '.join(axes)}")
    for key in section.up_and_down:
        if not faults and key not in axes:
            faults.add("sweep.up_and_down", list(section.up_and_down), f"keys of [axes]: {', '.join(axes)}")
    if faults:
        return ()
    ordered = tuple(there_and_back(axes[k]) if k in section.up_and_down else axes[k] for k in order)
    if math.prod(len(axis.values) for axis in ordered) > _MOST_POINTS:
        faults.add("axes", {}, f"at most {_MOST_POINTS} points together")
    return ordered


def _until(given: object, base: Mapping[str, Any], kind: RigKind, faults: Faults) -> Until | None:
    if given is None:
        return None
    section = read_table(_UntilSection, given, "sweep.until", faults)
    if section is None:
        return None
    channels = kind.contacts if section.channels is None else section.channels
    units = {channel: kind.channels.unit(channel) for channel in channels}
    if not channels or None in units.values() or len(set(units.values())) > 1:
        allowed = f"channels of the {kind.name} with one unit: {', '.join(kind.channels.told)}"
        faults.add("sweep.until.channels", list(channels), allowed)
        return None
    above, unit = None, str(units[channels[0]])
    if section.above is not None or unit != "N":
        try:
            above = float(quantity_field(Quantity(unit, 0, LEVEL_UP_TO, above=True)).read(section.above))
        except FieldError as error:
            faults.add("sweep.until.above", section.above or "(missing)", str(error))
    longest = section.longest or sound_values(settings_of(_PointAcquisition), base.get("acquisition")).get(
        "duration"
    )
    if longest is None:
        faults.missing("sweep.until.longest", "the longest that a point may take, such as 60 s")
        return None
    return Until(section.impacts, longest, channels, above)


def _with_acquisition(
    base: Mapping[str, Any], given: Mapping[str, Any], until: Until | None
) -> dict[str, Any]:
    before = base.get("acquisition", {})
    if not isinstance(before, dict):
        return dict(base)
    acquisition = before | {key: value for key, value in given.items() if key != "cycles"}
    if until is not None:
        acquisition["duration"] = until.longest
    return {**base, "acquisition": acquisition}


def _points(
    name: str,
    base: Mapping[str, Any],
    axes: tuple[Axis, ...],
    cycles: float | None,
    kind: RigKind,
    faults: Faults,
) -> Iterator[Point]:
    """The last axis changes at every point; faults that several points share are told once."""
    found: dict[Problem, list[int]] = {}
    for number, values in enumerate(product(*(axis.values for axis in axes)), start=1):
        settings = {axis.key: value for axis, value in zip(axes, values, strict=True)}
        table = with_values(base, settings)
        if cycles is not None and isinstance(table["acquisition"], dict):
            frequency = kind.cycle_hz(sound_values(settings_of(kind.drive), table.get("drive")))
            table["acquisition"]["duration"] = cycles / frequency if frequency else 1.0
        said = ", ".join(f"{key.partition('.')[2]} {value}" for key, value in settings.items())
        table["name"] = f"{name}, point {number}: {said}"[:_LONGEST_NAME]
        try:
            yield Point(number, settings, scenario_of(table, f"point {number}"))
        except ConfigurationError as error:
            for problem in error.problems:
                found.setdefault(problem, []).append(number)
    for problem in told_once(found):
        faults.note(problem)


def _with_paths(points: tuple[Point, ...], axes: tuple[Axis, ...]) -> tuple[Point, ...]:
    """The same points, each with the way to it along the last axis that the rig moves there and back."""
    walked = [place for place, axis in enumerate(axes) if axis.both_ways and not axis.by_hand]
    if not walked:
        return points
    lengths = [len(axis.values) for axis in axes]
    stride, count = math.prod(lengths[walked[-1] + 1 :]), lengths[walked[-1]]

    def path(place: int) -> tuple[Any, ...]:
        passed = place // stride % count
        return tuple(points[place - back * stride].scenario.drive for back in range(passed, 0, -1))

    return tuple(dataclasses.replace(point, path=path(place)) for place, point in enumerate(points))


def told_once(found: Mapping[Problem, list[int]]) -> list[Problem]:
    """Faults of points by their numbers, each with these."""
    return [
        dataclasses.replace(problem, key=f"{points_named(numbers)}: {problem.key}")
        for problem, numbers in found.items()
    ]


def points_named(numbers: list[int]) -> str:
    """Numbers of points, growing, in a few words: "points 1-5, 8"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1] = [runs[-1][0], number]
        else:
            runs.append([number])
    said = ", ".join("-".join(map(str, run)) for run in runs)
    return f"point {said}" if len(numbers) == 1 else f"points {said}"

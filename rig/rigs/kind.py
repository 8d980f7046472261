"""What the bench knows of a rig beside its physics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from importlib import resources
from inspect import signature
from typing import Any, get_args, get_origin

from daq.errors import UnphysicalParameter
from daq.quantity import REQUIRED, Check, Quantity, Setting, settings_of
from sim_twin.healthy import Tolerance
from sim_twin.rigs.channel_table import ChannelTable, Role
from sim_twin.twin import AnyTwin, Place, Twin, part_of


def at(rig: Any, place: Place) -> Any:
    """What stands at a place of a rig; None where it, or a part on the way, is not there."""
    for step in place:
        lacking = rig is None or (isinstance(rig, tuple) and int(step) >= len(rig))
        rig = None if lacking else part_of(rig, step)
    return rig


def _with(part: Any, values: Mapping[Place, Any]) -> Any:
    """`part` with values at places in it, all at once: some are checked against each other."""
    inner: dict[str, dict[Place, Any]] = {}
    for (step, *rest), value in values.items():
        inner.setdefault(step, {})[tuple(rest)] = value
    new = dict[str, Any]()
    for step, below in inner.items():
        whole = below.pop((), None) if () in below else part_of(part, step)
        new[step] = _with(whole, below) if below else whole
    if isinstance(part, tuple):
        return tuple(new.get(str(index), each) for index, each in enumerate(part))
    return {**part, **new} if isinstance(part, Mapping) else replace(part, **new)


def tolerance_among(kind: RigKind, key: str, tolerances: Iterable[Tolerance]) -> Tolerance | None:
    """What healthy rigs differ by in the value of a key of [model]; None where they do not."""
    place, named = ("rig", *kind.model[key].place), (key, key.replace("_", ".", 1))
    found = [each for each in tolerances if each.place == place or each.name in named]
    return found[-1] if found else None  # what all of a list differ by together comes before that of each


@dataclass(frozen=True)
class RigKind:
    """A rig: its physics, its channels, and how a lab handles it.

    The table [model] of a scenario holds what `nominal` takes and what is declared of the fields of
    `parameters`; the table [drive] is `drive`. `checks` are those over several keys of [model]. `actuator` is
    the table of a bench that drives it, `extras` are tables that it may have besides. `set_up` are the keys
    of [model] that a lab sets between runs on one rig; another value of any other key is another rig.
    `by_hand` are the keys that a person changes between two points of a sweep, each with what to do.
    `variations` are settings for a next experiment, as factors of scenario keys. `equipped(rig, channels)` is
    the rig with the sensors that a bench has at places of its choice. `stops` are the forces on either side
    of a play, of which half cycles are told. `picture` shows it, as module:class; empty without one.
    `lists` are keys of lists of any length, each with the field of the rig that their numbers begin.
    `package` is where the bench of a run without a file lies, named for the rig (.toml).
    """

    parameters: type[Any]
    nominal: Callable[..., Any]
    drive: type[Any]
    channels: ChannelTable
    actuator: str
    set_up: tuple[str, ...]
    by_hand: Mapping[str, str]
    variations: tuple[Mapping[str, float], ...]
    picture: str
    checks: tuple[Check, ...] = ()
    extras: tuple[str, ...] = ()
    stops: tuple[str, str] | None = None
    equipped: Callable[[Any, tuple[str, ...]], Any] = field(default=lambda rig, channels: rig)
    lists: Mapping[str, str] = field(default_factory=dict)
    package: str = "rig.rigs"

    @property
    def name(self) -> str:
        return str(self.parameters.kind)

    @cached_property
    def bench(self) -> str:
        """The text of the bench that a run has without a file."""
        return resources.files(self.package).joinpath(f"{self.name}.toml").read_text(encoding="utf-8")

    @cached_property
    def model(self) -> Mapping[str, Setting]:
        """What may stand in [model], by key; each has a default. Of several numbers `key[1]` is the first."""
        return {**self.keys, **{key: each for key, each in self.numbers.items() if key not in self.keys}}

    @cached_property
    def numbers(self) -> Mapping[str, Setting]:
        """What of [model] is one number and no count."""
        found: dict[str, Setting] = {}
        for key, each in self.keys.items():
            if not isinstance(each.meaning, Quantity):
                continue
            if each.type in (float, float | None):
                found[key] = each
            elif get_origin(each.type) is tuple:
                place, defaults = self._listed(each)
                for index, own in enumerate(defaults):
                    name, where = f"{key}[{index + 1}]", (*place, str(index))
                    found[name] = replace(each, key=name, type=float, default=own, place=where)
        return found

    def _listed(self, setting: Setting) -> tuple[Place, tuple[float | None, ...]]:
        """Where several numbers under one key stand in the rig, and their defaults."""
        if setting.key in self.lists:
            place = (self.lists[setting.key],)
            return place, at(self.nominal(), place)
        if Ellipsis in get_args(setting.type):
            return setting.place, ()
        return setting.place, setting.default or (None,) * len(get_args(setting.type))

    @cached_property
    def keys(self) -> Mapping[str, Setting]:
        """The keys of [model]."""
        nominal = self.nominal()
        of_fields = {
            key: replace(each, default=at(nominal, each.place))
            for key, each in settings_of(self.parameters).items()
        }
        return {**settings_of(self.nominal), **of_fields}

    def tolerances(self, given: Mapping[str, Any]) -> dict[str, Tolerance]:
        """What healthy rigs of a table [model] may differ by, by name, with every sensor that one may have.

        Raises like `built`.
        """
        rig = self.equipped(self.built(given), self.channels.told)
        twin = Twin(rig, None, rig.model.nominal_sensors(rig, None))
        return {each.name: each for each in rig.model.tolerances(twin)}

    def built(self, given: Mapping[str, Any]) -> Any:
        """The nominal rig with what [model] gives; raises UnphysicalParameter for what no rig can have."""
        chosen = given.keys() & signature(self.nominal).parameters.keys()
        rig = self.nominal(**{key: given[key] for key in chosen})
        return self._placed(rig, {key: given[key] for key in given.keys() - chosen})

    def _placed(self, rig: Any, values: Mapping[str, Any]) -> Any:
        """A rig with values under keys of its parts."""
        for key, value in values.items():
            *of_list, step = self.model[key].place
            numbers = at(rig, tuple(of_list)) if step.isdigit() else None
            if numbers is not None and int(step) >= len(numbers):
                raise UnphysicalParameter(self.name, key, value, f"one of the {len(numbers)} that there are")
        return _with(rig, {self.model[key].place: value for key, value in values.items()})

    def value(self, key: str, given: Mapping[str, Any]) -> Any:
        """What the rig of a table [model] has under a key; None of a part that is not there."""
        setting = self.model[key]
        if key in signature(self.nominal).parameters:
            return given.get(key, setting.default)
        return at(self.built(given), setting.place)

    def changed(self, rig: Any, given: Mapping[str, Any], values: Mapping[str, Any]) -> Any:
        """A `rig` of what [model] gives with other `values` of some keys; raises like `built`.

        What has been found of its parts otherwise stays, but for parts that are made of such a value.
        """
        of_parts = values.keys() & signature(self.nominal).parameters.keys()
        if of_parts:
            made = {key: values[key] for key in of_parts}
            before, after = self.built(given), self.built({**given, **made})
            parts = {each.name: getattr(after, each.name) for each in fields(after)}
            new = {name: part for name, part in parts.items() if part != getattr(before, name)}
            rig = replace(rig, **new)
        return self._placed(rig, {key: values[key] for key in values.keys() - of_parts})

    def twin(self, given: Mapping[str, Any], drive: Any, channels: tuple[str, ...]) -> AnyTwin:
        """The nominal twin of a rig that is measured in `channels`; raises like `built`."""
        rig = self.equipped(self.built(given), channels)
        return Twin(rig, drive, rig.model.nominal_sensors(rig, drive))

    def cycle_hz(self, drive: Mapping[str, Any]) -> float | None:
        """Cycles a second by the sound values of [drive]; None where they do not tell."""
        settings = settings_of(self.drive)
        values = {each.name: drive.get(key, each.default) for key, each in settings.items()}
        return None if REQUIRED in values.values() else float(self.drive(**values).cycle_hz)

    @property
    def turns(self) -> bool:
        """Whether a shaft does, whose speed is held and guarded."""
        return bool(self.channels.with_role(Role.ANGLE, Role.MARKER))

    @property
    def crank(self) -> ChannelTable | None:
        """The channels of a rig that turns."""
        return self.channels if self.turns else None

    def held_sine(self, drive: Any) -> tuple[str, float] | None:
        """The channel that shows a drive that is a sine, and its frequency (Hz), which is held.

        None of any other drive, and of one without an amplitude.
        """
        shown = self.channels.drive
        return (shown, float(drive.frequency)) if shown and drive.amplitude else None

    @property
    def contacts(self) -> tuple[str, ...]:
        """The force channels on which impacts are counted: the first group of contacts."""
        groups = self.channels.heard(self.channels.with_role(Role.CONTACT))
        return next(iter(groups.values()), ())

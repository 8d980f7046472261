"""What every rig gives to the rest: channels, effects, healthy spread, motion, figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pkgutil import resolve_name
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_twin.effects import Catalogue, ParameterValues
from sim_twin.healthy import Matched, Tolerance, drawn, moved
from sim_twin.rigs.channel_table import ChannelTable
from sim_twin.rigs.cycles import FOLLOWS, Cycles, Follow
from sim_twin.sensors import Sensor, oversampling
from sim_twin.status import Status
from sim_twin.stream import Truth, TwinStream
from sim_twin.twin import AnyTwin

Array = NDArray[np.float64]
SolverValues: TypeAlias = dict[str, float | int | None]


@dataclass(frozen=True, slots=True)
class JointRecord:
    """A joint's force (N), displacement (m) and velocity (m/s), each of shape (n,).

    `location` is a word of the effect table. Not a number: what is not known, or of a joint that is open.
    """

    joint: str
    location: str
    force: Array
    displacement: Array
    velocity: Array


@dataclass(frozen=True, slots=True)
class RunFigures:
    """Figures of one run, as `RigModel.solver_values` names them; none after a failure.

    `series` holds what there are many of in a run (the peaks of all half cycles), each of shape (n,).
    """

    status: Status
    values: Mapping[str, float | int | None] = field(default_factory=dict)
    series: Mapping[str, Array] = field(default_factory=dict)


class Truths(Protocol):
    """True motions at the channels of several twins, on one grid from t = 0 on, each in its drive."""

    def advance(self, steps: int) -> Array:
        """Next `steps` of the grid, shape (twins, channels, steps), rows in the order of the channels."""

    @property
    def statuses(self) -> Sequence[Status]:
        """How each run stands; the values of one that has failed mean nothing."""


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Runs of several twins at once, each from rest with its drive at a phase (rad) at t = 0.

    A run's numbers must be the same bits in whatever company it runs.

    - `truths(twins, phases, rate)`: their motions on a grid of `rate` Hz; all have the same channels.
    - `figures(twins, phases, settle, duration)`: figures of each, in order; where there is no faster way than
      one by one, None.
    """

    truths: Callable[[Sequence[Any], Sequence[float], float], Truths]
    figures: Callable[[Sequence[Any], Sequence[float], float, float], Sequence[RunFigures]] | None = None


JointRecords: TypeAlias = Callable[
    [AnyTwin, Mapping[str, NDArray[np.floating]], Cycles], tuple[JointRecord, ...]
]


@dataclass(frozen=True, slots=True)
class Deferred:
    """The function at `module:name`, imported when it is first called.

    Whoever needs no motion of a rig, only its channels, ranges and effects, loads no compiler.
    """

    where: str

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return resolve_name(self.where)(*arguments, **named)


@dataclass(frozen=True, slots=True)
class RigModel:
    """One rig, as functions of its twin; `parameters` is the class of `twin.rig`.

    - `channels`: all that its sensors can show.
    - `nominal_sensors(rig, drive)`: the chains without tolerances, noise in place.
    - `tolerances(twin)`: all that a healthy rig like it may differ by, by name.
    - `truth(twin, rate, drive_changes)`: its motion on a grid of `rate` Hz; `drive_changes` where the drive
      will get an offset or harmonics later on.
    - `solver_values(twin, settle, duration)`: figures of the motion from rest, before any sensor, in the
      units that their names say; None where there is nothing to tell.
    - `side_by_side`: the same for many runs at once, where the rig has a faster way.
    - `smooth_channels`: those that an anti-alias filter leaves as they are.
    - `reference`: the channel that tells the cycles; `follow(samples, rate, nominal frequency)` finds them.
    - `fine_rate`: Hz at which motions are computed where many are compared.
    - `speed`: s of motion that one processor simulates and looks at in one s then, with room to spare.
    - `joint_records(twin, records, cycles)`: what passed through its joints, from records of its channels.
    - `stray(twin, signals, rng)`: clean signals (channels, n) with what a healthy rig's channels may pick up
      besides.
    """

    parameters: type[Any]
    effects: Catalogue
    channels: ChannelTable
    nominal_sensors: Callable[[Any, Any], dict[str, Sensor]]
    truth: Callable[[Any, float, bool], Truth]
    solver_values: Callable[[Any, float, float], SolverValues]
    reference: str
    follow: Follow
    fine_rate: float
    speed: float
    side_by_side: SideBySide | None = None
    smooth_channels: tuple[str, ...] = ()
    tolerances: Callable[[Any], tuple[Tolerance, ...]] = lambda _: ()
    joint_records: JointRecords = lambda _, __, ___: ()
    stray: Callable[[Any, Array, np.random.Generator], Array] = lambda _, signals, __: signals

    def smooth(self, rig: Any) -> tuple[str, ...]:
        """The `smooth_channels` of a rig: what passes a gauge in the stinger is not smooth."""
        return () if getattr(rig, "stinger_gauge", False) else self.smooth_channels

    def followed(self, name: str) -> Follow:
        """How the cycles are found in the `reference`, or in another channel that tells them."""
        return self.follow if name == self.reference else FOLLOWS[self.channels[name].role]

    @property
    def name(self) -> str:
        """What a scenario calls it."""
        return str(self.parameters.kind)

    def channel_unit(self, name: str) -> str:
        """Unit of a channel; KeyError for one that the rig cannot have."""
        return self.channels[name].unit

    def stream(
        self,
        twin: AnyTwin,
        sample_rate: float,
        rng: np.random.Generator | None = None,
        drive_changes: bool = False,
    ) -> TwinStream:
        """Samples of `twin` as they come; with `rng` they carry noise and quantisation."""
        truth = self.truth(twin, sample_rate * oversampling(sample_rate), drive_changes)
        return TwinStream(twin, truth, sample_rate, rng)

    def with_effects(self, twin: AnyTwin, effects: Iterable[tuple[str, ParameterValues]]) -> AnyTwin:
        """Return `twin` with the named effects in, in the order given.

        Raises ValueError for an effect that the rig cannot have or a parameter outside its range.
        """
        for name, values in effects:
            if name not in self.effects:
                raise ValueError(f"no effect {name!r}; known: {', '.join(self.effects)}")
            twin = self.effects[name].apply(twin, values)
        return twin

    def healthy_spread(self, twin: AnyTwin) -> tuple[Tolerance, ...]:
        """The tolerances of `twin`, as wide as its lab's rigs have them."""
        return tuple(
            replace(each, deviation=twin.widths.get(each.name, 1.0) * each.deviation)
            for each in (*self.tolerances(twin), *twin.besides)
        )

    def lasting_tolerances(self, twin: AnyTwin) -> tuple[Tolerance, ...]:
        """Those that belong to the rig of `twin`, not to one run."""
        return tuple(each for each in self.healthy_spread(twin) if not each.each_run)

    def draw_healthy(
        self, twin: AnyTwin, rng: np.random.Generator, run_rng: np.random.Generator | None = None
    ) -> AnyTwin:
        """Return `twin` as a healthy rig may really be, on one run.

        `rng` draws what belongs to the rig, `run_rng` (default: the same) what is set anew for each run.
        """
        noisy = self._with_sensors(twin)
        return drawn(noisy, self.healthy_spread(noisy), rng, run_rng)

    def matched(self, twin: AnyTwin, matched: Matched) -> AnyTwin:
        """Return the nominal `twin` as a calibration found its rig.

        It has the means of what was found; `draw_healthy` about it differs by what was left open.
        """
        full = self._with_sensors(twin)
        return moved(full, self.healthy_spread(full), matched)

    def _with_sensors(self, twin: AnyTwin) -> AnyTwin:
        return replace(twin, sensors={**self.nominal_sensors(twin.rig, twin.drive), **twin.sensors})

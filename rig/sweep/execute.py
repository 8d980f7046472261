"""Does a sweep point by point; what is done is known before the next one begins."""

from __future__ import annotations

import dataclasses
import datetime
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from daq.block import SampleBlock, merged, values_of
from daq.clock import Clock
from daq.errors import EmergencyStop, InterlockTripped, RattleError, with_notes_of
from daq.signals.impacts import Levels
from daq.signals.running_figures import warm_up
from rig.derived.per_source import ImpactWatch
from rig.derived.settings import CYCLES, settle_s, settled
from rig.files.bench import Bench
from rig.files.model_file import ModelFile
from rig.files.scenario import Scenario, edited
from rig.files.sweep import Point, Sweep, points_named
from rig.session.devices import Connect, Standing
from rig.session.progress import Screen
from rig.session.run import RunRequest, run_scenario
from rig.session.signals import StopRequest
from rig.stream import Block, Record
from rig.sweep.figures import outcome_of
from rig.sweep.plan import Move, Step, left, steps_of, work_of
from rig.sweep.results import swept_so_far, write_results
from rig.sweep.state import (
    SCHEMA,
    CentreState,
    Outcome,
    PointState,
    SweepState,
    check_unchanged,
    digests_of,
    load_state,
    save_state,
)

if TYPE_CHECKING:
    from rig.live.view import LiveView, Swept

_LOGS = "*.mcap"
Run = Callable[[RunRequest, Screen, Clock], Path]
Centre = Callable[[Scenario, Bench, Screen], CentreState]


@dataclasses.dataclass(frozen=True, slots=True)
class SweepRequest:
    """What to sweep, on what, and where to.

    `again` are points that are to be recorded although they have ended; `set_again` has every position that
    is set by hand confirmed anew; `rehearsal` confirms them without a person. `model` is what every
    twin is matched by.
    """

    sweep: Sweep
    bench: Bench
    connect: Connect
    folder: Path
    again: frozenset[int] = frozenset()
    set_again: bool = False
    rehearsal: bool = False
    model: ModelFile | None = None


def begun(request: SweepRequest) -> SweepState:
    """The state to go on from; raises ConfigurationError where a file has changed since."""
    digests = digests_of(request.sweep, request.bench, request.model)
    state = load_state(request.folder)
    if state is None:
        seed = request.bench.emulation.seed
        return SweepState(SCHEMA, digests, secrets.randbits(32) if seed is None else seed)
    check_unchanged(state, digests, request.folder)
    return dataclasses.replace(state, by_hand={}, centre=None) if request.set_again else state


class Sweeping:
    """A sweep that goes on from `state`, shown in `view`.

    `run` records a point, `centre` finds what centres the beam.
    """

    def __init__(
        self,
        request: SweepRequest,
        state: SweepState,
        screen: Screen,
        clock: Clock,
        run: Run = run_scenario,
        centre: Centre | None = None,
        view: LiveView | None = None,
    ) -> None:
        self._request, self._state, self._screen, self._clock = request, state, screen, clock
        self._run, self._centre, self._view = run, centre, view
        emulation = dataclasses.replace(request.bench.emulation, seed=state.seed)
        self._bench = dataclasses.replace(request.bench, emulation=emulation)

    def all(self) -> SweepState:
        """Record every point that has not ended yet; the state is written after each.

        Raises what ended a point early, after writing it down: the same call goes on from there.
        """
        steps = steps_of(self._request.sweep)
        todo = [step for step in steps if self._wanted(step.point.number)]
        done = self._state.ended("done")
        if done:
            self._screen.say(f"done       {points_named(list(done))} of {len(steps)}")
        for number in self._state.ended("failed", "interlock", "stopped"):
            point = self._state.points[number]
            comes = "comes again" if self._wanted(number) else f"not repeated without --again {number}"
            self._screen.warn(f"point {number}: {point.outcome}: {point.why}; {comes}")
        try:
            with Standing(self._request.connect) as standing:
                self._record(todo, len(steps), standing)
        finally:
            self._screen.part = ""
        return self._state

    def _record(self, todo: Sequence[Step], count: int, standing: Standing) -> None:
        before: Point | None = None
        for index, step in enumerate(todo):
            to_come = [each.point for each in todo[index:]]
            lasts = left(self._request.sweep, self._bench, to_come, self._screen.paces, before)
            said = ", ".join(f"{key} {value}" for key, value in step.point.settings.items())
            self._screen.say(f"point {step.point.number} of {count}  {said}  ({lasts} left)")
            at = f"{datetime.datetime.now():%H:%M}"
            self._screen.part = f"point {step.point.number} of {count} ({lasts} left at {at})"
            for axis in self._request.sweep.axes:
                value, now = step.point.settings[axis.key], self._state.by_hand.get(axis.key)
                if axis.by_hand and now != value:
                    move = Move(axis.key, now, value, axis.by_hand)
                    standing.close()  # nobody reaches into a rig that is connected
                    if self._request.rehearsal:
                        self._screen.say(f"by hand    {move} (rehearsal: taken as done)")
                    else:
                        asks = f"by hand    {move}: {move.by_hand}. Enter when it is done: "
                        self._screen.confirm(asks, at_terminal=not self._bench.actuator.emulated)
                    # a move by hand also ends what centring found
                    hands = {**self._state.by_hand, axis.key: value}
                    self._keep(dataclasses.replace(self._state, by_hand=hands, centre=None))
            began_s = self._clock.monotonic_s()
            self._point(step.point, standing)
            work = work_of(self._request.sweep, self._bench, before, step.point)
            self._screen.paces.took(work, self._clock.monotonic_s() - began_s)
            before = step.point

    def _wanted(self, number: int) -> bool:
        ended = self._state.points.get(number)
        return number in self._request.again or ended is None or ended.outcome == "stopped"

    def _point(self, point: Point, standing: Standing) -> None:
        with StopRequest() as stop:  # what comes between two runs must not end the program in mid-write
            come_to = self._centred(point, standing)
            scenario = come_to.scenario
            until, counted = self._request.sweep.until, None
            if until is not None:
                hertz = scenario.drive.cycle_hz
                counted = ImpactCount(until.channels, until.impacts, hertz, until.above)
            folder = self._request.folder / f"point-{point.number:04d}"
            asked = RunRequest(
                scenario,
                self._bench,
                self._request.connect,
                folder,
                self._view,
                self._request.model,
                path=come_to.path,
                standing=standing,
                swept=None if self._view is None else self._swept_so_far(point),
                counted=counted,
            )
            with self._told(point.number, folder):
                log = self._run(asked, self._screen, self._clock)
            impacts = None if counted is None else counted.count
            number = point.number
            why, figures = outcome_of(log, point.scenario)
            name = str(log.relative_to(self._request.folder))
            ended = PointState("failed" if why else "done", name, why, impacts, figures)
            self._keep(self._state.with_point(number, ended))
            if self._view is not None and (swept := self._swept_so_far(point)) is not None:
                self._view.offer(swept)  # the last point would not be shown else
            write_results(self._request.folder, self._request.sweep, self._state)
            if why:
                self._screen.warn(f"point {number} failed: {why}")
            if until is not None and impacts is not None and impacts < until.impacts:
                self._screen.warn(f"{impacts} of {until.impacts} impacts within {until.longest:g} s")
            self._screen.say(f"log        {log}")
            stop.check()

    @contextmanager
    def _told(self, number: int, folder: Path) -> Iterator[None]:
        """Write down why a point ended early, with what it left of a log, and say what comes of it."""
        before = {*folder.glob(_LOGS)}

        def keep(outcome: Outcome, why: str) -> None:
            logs = (str(each.relative_to(self._request.folder)) for each in {*folder.glob(_LOGS)} - before)
            self._keep(self._state.with_point(number, PointState(outcome, next(logs, None), why)))

        try:
            yield
        except EmergencyStop as error:  # which says nothing of the point
            keep("stopped", str(error))
            raise
        except InterlockTripped as error:
            keep("interlock", str(error))
            goes_on = f"the same call goes on after it, --again {number} repeats it"
            raise with_notes_of(InterlockTripped(f"point {number}: {error}; {goes_on}"), error) from error
        except (RattleError, KeyboardInterrupt) as error:
            keep("stopped", str(error) or "interrupted")
            self._screen.say(f"point {number} was not done: the same call repeats it and goes on")
            raise

    def _centred(self, point: Point, standing: Standing) -> Point:
        if not self._request.sweep.centre or self._centre is None:
            return point
        found = self._state.centre
        if found is None:
            standing.close()
            found = self._centre(point.scenario, self._bench, self._screen)
            self._keep(dataclasses.replace(self._state, centre=found))
        path = tuple(dataclasses.replace(drive, offset=found.offset_n) for drive in point.path)
        return dataclasses.replace(point, scenario=centred(point.scenario, found), path=path)

    def _swept_so_far(self, point: Point) -> Swept | None:
        return swept_so_far(self._request.sweep, self._state, point)

    def _keep(self, state: SweepState) -> None:
        self._state = state
        save_state(self._request.folder, state)


def centred(scenario: Scenario, found: CentreState) -> Scenario:
    """The scenario with the drive's offset that centres the beam, and the rest position that asks for it.

    Both, so that the twin's beam is centred as the rig's is.
    """
    settings = {"drive.offset": found.offset_n, "model.rest_offset": found.rest_offset_m}
    return edited(scenario, settings, f"{scenario.name}, centred")


class ImpactCount:
    """A consumer that counts impacts on several measured channels together, as the log has them.

    Until the rule settles, by what there is of the first cycles, three at least. With `above`, in the
    channels' unit, an impact counts from a rise by that on instead.
    """

    def __init__(
        self, channels: Sequence[str], wanted: int, cycle_hz: float, above: float | None = None
    ) -> None:
        warm_up()  # else the acquisition would wait for it as it looks for the first time
        self._channels, self.wanted, self._cycle_hz = channels, wanted, cycle_hz
        self._levels = {} if above is None else dict.fromkeys(channels, Levels(above, above / 2))
        self._first: dict[str, list[SampleBlock]] = {}
        self._watches: dict[str, ImpactWatch] = {}
        self._seen_s, self._settled = 0.0, False
        self._count = self.so_far = 0

    def __call__(self, record: Record) -> None:
        match record:
            case Block("measured", samples) if not self._settled:
                if samples.channel in self._channels:
                    self._first.setdefault(samples.channel, []).append(samples)
            case Block("measured", samples) if samples.channel in self._watches:
                self._watches[samples.channel].add(samples, self._note)

    def _note(self, _: Record) -> None:
        self._count += 1

    def enough(self) -> bool:
        """Whether there are enough; an impact counts once no bounce of it can follow."""
        self.so_far = count = self.count
        return count >= self.wanted and (bool(self._levels) or self._seen_s * self._cycle_hz >= CYCLES)

    @property
    def count(self) -> int:
        if self._first and not self._settled:
            self._look_again()
        return self._count

    def _look_again(self) -> None:
        """Count anew in all that has come, by what its levels are up to now."""
        rate, settle = next(iter(self._first.values()))[0].sample_rate, settle_s(self._cycle_hz)
        end = min(blocks[-1].end_sample for blocks in self._first.values())
        if end <= self._seen_s * rate:
            return
        self._first = {name: merged(blocks) for name, blocks in self._first.items()}
        first = {
            name: values_of(each, 0, min(end, round(settle * rate))) for name, each in self._first.items()
        }
        found = settled(settle, self._cycle_hz, 0.0, first, rate, self._levels)
        self._count = 0
        for name, blocks in self._first.items():
            self._watches[name] = ImpactWatch("measured", name, found, None, rate, 0, look_s=0.0)
            for block in blocks:
                self._watches[name].add(block, self._note)
        self._seen_s = end / rate
        self._settled = self._seen_s >= settle
        if self._settled:
            self._first.clear()

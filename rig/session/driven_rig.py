"""A rig that moves while it is recorded: its instruments, what ends it, and the way to rest."""

from __future__ import annotations

import gc
import math
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from daq.block import Flag
from daq.errors import (
    EmergencyStop,
    InstrumentError,
    InterlockTripped,
    RattleError,
    RecorderFailed,
    show_fault,
    with_notes_of,
)
from daq.log.records import STOPPING, Event
from daq.log.writer import LogWriter
from daq.recorder import Recorder
from daq.time_base.run_clock import RunClock
from drivers.protocols.card import CardReading
from drivers.protocols.emergency_stop import LOOK_S
from rig.bounds import bounds_of
from rig.files.bench import Bench
from rig.files.pairing import unmeasured
from rig.files.scenario import Limit
from rig.instruments import actuator_of
from rig.rigs import RIGS
from rig.session.acquisition import JOIN_S, LATE_FOR_S, LATE_S, Acquisition, Reader
from rig.session.by_hand import ByHand, SineSeen
from rig.session.devices import Devices, Standing
from rig.session.drive import Motion, Shaker, drive_off_after
from rig.session.encoder_record import ENCODER_CHANNEL, HANGS_S, EncoderRecord, encoder_channel
from rig.session.interlock import HUNG_S, Debounced, ForceWatch, LimitWatch
from rig.session.levels import Levels
from rig.session.logbook import Logbook, logged_by, new_log, run_record
from rig.session.logger_record import LoggerRecord
from rig.session.progress import Screen
from rig.session.shaft_watch import ShaftWatch
from rig.session.signals import StopRequest
from rig.session.spoilt_disk import disk_of
from rig.session.supervisor import Latching, Supervisor
from rig.session.watch import ASK_S, Watch
from rig.stream import Stream
from rig.twin.alignment import force_shown
from sim_twin.rigs.impact_beam.model import SineDrive
from sim_twin.twin import AnyTwin

_REACHES_RIG_S = 0.05  # what was ordered of a generator

_FORGETS_S = 2.0
"""After which a sensor with a corner shows no more of a push, which passes for a sine on its way."""

STOPPED = "stopped before its time"


class Hung(RattleError, RuntimeError):
    """A part of this program took so long that the drive was switched off."""


class DrivenRig:
    """What a run and other recordings of a moving rig have in common.

    In the order of their use: `launch`, `open_log`, `record`, `declare`, `moving`, and within that `start`,
    `start_record`, `end_record` and `ramp_down`. `check_pair` has to have allowed scenario and bench. What
    `standing` keeps watches the next run too.
    """

    def __init__(
        self,
        bench: Bench,
        devices: Devices,
        stop: StopRequest,
        screen: Screen,
        clock: RunClock,
        standing: Standing | None = None,
    ) -> None:
        self.devices, self.screen, self.clock = devices, screen, clock
        self.name, self._bench, self._stop = bench.rig, bench, stop
        self.sample_rate = devices.card.sample_rate
        self.names = [channel.name for channel in devices.card.channels]
        self.watch = Watch(clock)
        actuator = actuator_of(bench.actuator_table)
        self._highest = float(getattr(bench.actuator, actuator.highest))
        fastest_rad_s = self._highest if RIGS[bench.rig].turns else math.inf
        self.shaft = ShaftWatch(devices.card.channels, self.sample_rate, clock, fastest_rad_s)
        self.motion: Motion = devices.motion(self.watch.wait, self.shaft.rpm)
        watched = devices.spare, devices.locks, bench.actuator.emulated, devices.line, devices.latch
        off_s, by_hand = self.motion.longest_stop_s, actuator.by_hand
        self._hangs_up = standing is None
        self._supervisor = (
            Supervisor(*watched, off_s, by_hand=by_hand, at_once=devices.spare_beside)
            if standing is None
            else standing.supervised(
                lambda: Supervisor(*watched, off_s, stays=True, by_hand=by_hand, at_once=devices.spare_beside)
            )
        )
        self.stream = Stream()
        self.logbook = Logbook(clock, self.stream, screen)
        self.recorder: Recorder
        self.acquisition: Acquisition
        self.encoder: EncoderRecord | None = None
        self.loggers: list[LoggerRecord] = []
        self.on_stopping: Callable[[], None] | None = None
        """Called where it stops before its time; None where nothing follows what is recorded."""
        self._rests = self._moves = self._stops = False  # ramped down; was started; is being stopped
        self._telling: threading.Thread | None = None  # of a stop before its time
        self._deciding = threading.Lock()  # of guard and sequence: over `_met`, `_stops`, `_unsafe`
        self._met = self._unsafe = 0  # dangers answered with a stop; stops not yet done
        self._unsafe_until_s = math.inf  # by when the first of these has to be done, monotonic s
        self._latching: Latching
        self._hung = ""  # who hung, said once: what comes back to life later must not go on
        self._force: ForceWatch | None = None
        self._behind = Debounced(LATE_FOR_S)
        self._stopped_ns = 0
        self._guarded_s = math.inf  # the guard's last look, monotonic s; inf: nobody guards and nothing moves

    def launch(self, stack: ExitStack) -> None:
        """Start the supervisor's process, which takes seconds; one that stays has been."""
        self._supervisor.launch()
        stack.push(self._supervisor)
        if (spare := self.devices.spare) is not None:  # whoever arms it may fail to switch it off
            actuator = self.devices.actuator
            stack.enter_context(drive_off_after(actuator, spare, self.screen, self._supervisor))

    def open_log(self, stack: ExitStack, folder: Path, name: str) -> Path:
        """A new log that `recorder` writes; where the stack unwinds by an error its path is said."""
        log, disk = new_log(folder, name, self.clock), disk_of(self._bench.emulation.rehearsed("disk"))

        @stack.push
        def tell_of_partial(kind: object, error: object, trace: object) -> None:
            if kind is not None and log.exists():
                self.screen.say(f"log so far {log}")

        self.recorder = stack.enter_context(Recorder(LogWriter(log, opened=disk), self.clock))
        self.stream.insert(0, logged_by(self.recorder))
        return log

    def hold_force(
        self, channel: str, frequency_hz: float, twin: AnyTwin, path: Sequence[SineDrive] = ()
    ) -> None:
        """Hold the drive that `channel` shows to what the bench allows and to the order.

        On its way up that is looked at once, then all the time, but for a person's, who is asked. Of either
        the channel shows what `twin`, of the bench's sensors, says. It may come through drives of a `path`.
        """
        if isinstance(self.motion, Shaker | ByHand):
            shown = self.devices.card.channels[self.names.index(channel)]
            of = force_shown(twin, self._highest)
            slowest_hz = min((each.frequency for each in path), default=math.inf)
            # an emulated source moves nothing that a real card shows
            driven = self._bench.daq_card.emulated or not self._bench.actuator.emulated
            force = self._force = ForceWatch(
                shown, frequency_hz, self.sample_rate, self._highest, of, slowest_hz, driven
            )
            if isinstance(self.motion, ByHand):
                self.motion.seen = SineSeen(force)
                return

            def obeyed_from() -> float:
                """The card's first sample that shows what is ordered by now, and none that has come."""
                base, acquired = self.acquisition.base, self.acquisition.acquired
                now = float(base.card_s(base.now_s())) * self.sample_rate
                return max(now, acquired) + _REACHES_RIG_S * self.sample_rate

            def prove(ordered: SineDrive) -> None:
                """Raise before a soft start goes on where the measured force is not what was ordered."""
                acquisition, due = self.acquisition, obeyed_from() + force.over_s * self.sample_rate
                self.watch.until(acquisition, lambda: acquisition.acquired >= due)
                sine = ordered.amplitude, ordered.offset, ordered.frequency
                if unlike := self.watch.meanwhile(acquisition, lambda: force.unlike(*sine)):
                    self.logbook.tell("error", "drive.abort", unlike)
                    raise InterlockTripped(f"interlock: {unlike}")

            offset = 0.0

            def hold(ordered: SineDrive | None) -> None:
                nonlocal offset
                if ordered is None:
                    force.let_go()
                    return
                pushed, offset = ordered.offset != offset, ordered.offset
                force.hold(ordered.amplitude, obeyed_from() + pushed * _FORGETS_S * self.sample_rate)

            self.motion = replace(self.motion, prove=prove, hold=hold)

    def record(
        self,
        limits: Sequence[Limit],
        fastest_rad_s: float | None,
        readers: Sequence[Reader] = (),
        enough: Callable[[], bool] = lambda: False,
    ) -> None:
        """Make what records card and encoder into `stream`; nothing is started yet.

        Each of `readers` gets every reading. `enough` is asked after each one that was recorded: once it
        says so, the record ends there. The shaft is to turn at `fastest_rad_s` at most.
        """

        def end_with_enough(reading: CardReading) -> None:
            if self.acquisition.records(reading) and enough():
                self.acquisition.end_record(reading)

        self.levels = Levels(self.names, bounds_of(self._bench.daq_card.ranges, limits))
        card, watched = self.devices.card, LimitWatch(limits, self.sample_rate)
        consumers = (end_with_enough, self.levels.take, *readers)
        self.acquisition = Acquisition(
            card, self.clock, self.stream, watched, consumers, self.screen.warn, self._look
        )
        if self.devices.encoder is not None:
            self.encoder = self.shaft.recording(
                self.devices.encoder, self.acquisition, self.stream, fastest_rad_s
            )
        base = self.acquisition.base
        self.loggers = [LoggerRecord(each, base, self.stream) for each in self.devices.loggers.values()]

        # what is looked at while somebody waits, and what the log gets of it
        def heed_stop() -> None:
            if self._stop.wanted:
                self.logbook.tell("warning", "run.interrupted", "stopped by a person")
            self._stop.check()

        def heed_hung() -> None:
            if self._hung:
                raise Hung(self._hung)

        acquisition, logbook, motion = self.acquisition, self.logbook, self.motion
        if isinstance(motion, ByHand):
            motion.alive = lambda: acquisition.error is None and not acquisition.hangs
        self.watch.checks += [self.heed_emergency_stop, acquisition.check, self.shaft.check]
        self.watch.at_times(motion.check)
        self.watch.checks += [heed_hung, self._supervisor.check]
        actuator = self.devices.actuator.name
        logbook.events.append(self.recorder.events)
        logbook.events.append(lambda: logbook.stamped(actuator, motion.take_notices()))
        logbook.clocks += [acquisition.base.refit, lambda _: motion.clocks(acquisition.base)]
        if self.encoder is not None:
            self.watch.checks.append(self.encoder.check)
            logbook.events.append(self.encoder.events)
            logbook.clocks.append(self.encoder.clocks)
        self.watch.checks += [logbook.look, heed_stop]

    def declare(self, run_id: str, scenario: str, notes: dict[str, str]) -> None:
        """Write what was run (`scenario`, TOML) and on what, and the measured channels."""
        self.recorder.metadata("scenario", {"toml": scenario})
        self.recorder.metadata("run", run_record(self._bench, self.devices, notes, run_id, self.clock))
        for channel in self.devices.card.channels:
            self.recorder.declare("measured", channel)
        if self.devices.encoder is not None:
            self.recorder.declare("measured", encoder_channel(self.devices.encoder))
        for channel in self.devices.logged:
            self.recorder.declare("measured", channel)
        for warning in self.devices.card.warnings:
            self.warn("card.warning", warning)
        if unseen := unmeasured(self._bench):
            self.warn("drive.unmeasured", unseen)

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Supervised, acquiring and with its logbook open; the drive is off on every way out."""
        gc.collect()
        gc.freeze()  # no pause for what is there to stay

        asked_s = math.inf

        def ask() -> None:
            """Before anything is closed, which may take long: nobody wants what comes then."""
            nonlocal asked_s
            asked_s = float(self.acquisition.base.card_s(self.acquisition.base.now_s()))

        with self.screen.apart(), ExitStack() as running:
            running.callback(gc.unfreeze)
            self._latching = Latching(self.devices.latch)
            running.callback(self._tell_of_latch)
            running.callback(lambda: self._account(asked_s))
            for each in (self.logbook, self.acquisition, self.encoder, *self.loggers, self._supervisor):
                if each is not None:
                    running.enter_context(each)
            running.callback(ask)
            running.push(self._heed_on_the_way_down)
            running.enter_context(self._guarded())  # around the stop: it watches until that has ended
            running.callback(self._hear_out)
            told = self._moved, self._tell_of_failed_off
            running.enter_context(
                drive_off_after(self, self.devices.spare, self.screen, self._supervisor, *told)
            )
            try:
                yield
            except InstrumentError:
                if self._stops:  # an order that the guard's stop overtook does not say why it ended
                    self.watch.check()
                raise
        if self._hangs_up:  # what has come to rest may be switched off by anybody from now on
            self.close()

    def start(self, soft: bool, path: Sequence[Any] = ()) -> None:
        """Let it move, unless something speaks against it by now; returns once it is as wanted."""
        self.watch.check()
        self._supervisor.beat()  # from here on it is needed, whether a reading has come or not
        self._moves = True  # before the order: it may be obeyed although its answer is lost
        self.motion.start(soft, path)
        if self.motion.speed_rad_s is not None:  # only now: on its way up no speed is wrong
            self.shaft.arm(self.motion.speed_rad_s)

    def start_record(self, count: int) -> int:
        """Record the next `count` samples of the card, and the encoder with it; returns the first."""
        self.levels.begin()
        begin = self.acquisition.start_record(count)
        if self.encoder is not None:
            self.encoder.begin(begin / self.sample_rate)
        for logger in self.loggers:
            logger.begin(begin / self.sample_rate, (begin + count) / self.sample_rate)
        return begin

    def end_record(self) -> None:
        """Wait until everything of the record has come."""
        self.watch.until(self.acquisition, lambda: self.recorded)
        until = self.acquisition.record_until
        if until is None:
            return
        for logger in self.loggers:
            logger.end(until / self.sample_rate)
        if (encoder := self.encoder) is not None:
            encoder.end(until / self.sample_rate)
            self.watch.until(self.acquisition, lambda: encoder.ended)

    @property
    def emergency_stop(self) -> EmergencyStop | None:
        """What was seen of its line, for good."""
        return self._supervisor.emergency_stop or self.devices.emergency_stop()

    def _tell_of_failed_off(self, text: str) -> None:
        self.logbook.tell("error", "drive.not_off", text)

    def _tell_of_latch(self) -> None:
        self._latching.give(self.emergency_stop)  # where it was seen after the guard had ended
        if wrong := self._latching.end():
            with suppress(RecorderFailed):
                self.logbook.tell("error", "emergency_stop.latch", wrong)
            with suppress(OSError):
                self.screen.warn(wrong)

    def heed_emergency_stop(self) -> None:
        if (seen := self.emergency_stop) is not None:
            raise seen

    def _heed_on_the_way_down(self, kind: object, ending: BaseException | None, trace: object) -> None:
        """An emergency stop counts whatever ended it; how the drive is left stays said."""
        if (seen := self.emergency_stop) is not None:
            raise with_notes_of(seen, ending)

    @property
    def recorded(self) -> bool:
        """Whether the record is complete; what asks for less may have brought its end nearer."""
        until = self.acquisition.record_until
        return until is not None and self.acquisition.acquired >= until

    @property
    def _at_once(self) -> bool:
        """Whether it is to stop without a ramp: by an emergency stop, or a person who has asked twice."""
        return self.emergency_stop is not None or self._stop.asked > 1

    @property
    def _moved(self) -> str:
        return "the motor" if self.motion.speed_rad_s is not None else "the drive"

    def ramp_down(self) -> None:
        self._bring_to_rest(self.motion.cut if self._at_once else self.motion.ramp_down)
        self.heed_emergency_stop()
        self._rests = True
        self.logbook.tell("info", "drive.off", "drive ramped down and off")
        if self._hangs_up:  # between the points of a series it moves again at once
            self.screen.say(f"{self._moved} is off")

    def off(self) -> None:
        """The safe state, on whatever way out; before its time, `on_stopping` and the log hear of it."""
        faults = list[Exception]()
        told = sys.exc_info()[1], faults
        self._telling = threading.Thread(target=self._tell_of_stop, args=told, name="stopping", daemon=True)
        # nothing that goes wrong with a log, and no one who waits, may keep the drive on
        if not self._rests:
            with suppress(RuntimeError):  # a machine that starts none more: told below
                self._telling.start()
        self._bring_to_rest(self.motion.cut if self._at_once else self.motion.off)
        self._hear_out()
        if faults:
            raise faults[0]

    def _hear_out(self) -> None:
        """Let what tells of a stop come to its end, before anything that it tells is closed."""
        telling, self._telling = self._telling, None
        if telling is None:
            return
        self.watch.excuse(JOIN_S)
        if telling.ident is not None:
            telling.join(JOIN_S)
        elif not self._rests:
            telling.run()

    def _tell_of_stop(self, cause: BaseException | None, faults: list[Exception]) -> None:
        """Beside the stop: why it stops before its time."""
        try:
            stopped_ns, seen = self._stopped_ns or self._stopping_ns(cause), self.emergency_stop
            text = f"stopping before its time{f' ({seen or cause})' if seen or cause else ''}"
            self.screen.warn(text)
            if self.on_stopping is not None:
                self.on_stopping()
                text += ": what is recorded from here on has no prediction"
            if seen is not None:
                self.stream(Event(stopped_ns, "error", "rig", seen.code, str(seen)))
            self.stream(Event(stopped_ns, "warning", "rig", STOPPING, text))
        except RecorderFailed:  # a log that takes nothing more may be why it stops
            pass
        except Exception as error:  # top of a thread: whoever switches off raises it
            faults.append(error)

    def close(self) -> None:
        """Hang up to what moves it, which nothing is sent to any more."""
        self.devices.actuator.close()

    def warn(self, code: str, text: str) -> None:
        self.logbook.tell("warning", code, text)
        self.screen.warn(text)

    def tell_of_marks(self) -> None:
        for code, text in self.shaft.faults(self.acquisition):
            self.warn(code, text)

    def _bring_to_rest(self, stop: Callable[[], None]) -> None:
        self.shaft.disarm()  # a ramp is no shaft that leaves its speed
        decided = self._deciding.acquire(timeout=ASK_S)  # a guard that hangs may have it
        try:
            self._stops = True
            self._met = self._dangers()
        finally:
            if decided:
                self._deciding.release()
            self.watch.excuse(self.motion.longest_stop_s)
            stop()

    def _stopping_ns(self, cause: BaseException | None = None) -> int:
        """When the emergency stop was seen; else until when what stops it was seen to be right, or now."""
        at_s: float | None = self._guarded_s if self._unguarded else None
        if (seen := self.emergency_stop) is not None:
            at_s = seen.at_s
        elif isinstance(cause, InstrumentError) and cause.right_s is not None:
            at_s = cause.right_s
        return self.clock.unix_ns() if at_s is None else self.clock.at_ns(at_s)

    @property
    def _unguarded(self) -> bool:
        """Whether the guard, and with it maybe all of this process, has slept."""
        return self.clock.monotonic_s() - self._guarded_s > HUNG_S

    def _account(self, asked_s: float) -> None:
        """What was due of the record by then, in s since the card's sample 0, and does not come is a gap."""
        acquisition, recorder = self.acquisition, self.recorder
        begin, until = acquisition.record_from, acquisition.record_until
        if begin is None or until is None:
            return
        came = min(until, acquisition.acquired) - begin
        due = came if self._rests else min(until, math.ceil(asked_s * self.sample_rate)) - begin

        def why(name: str, lost: bool) -> str:
            if lost:
                return f"the {name} was lost"
            return "no answer in time" if self._rests else STOPPED

        def tell(origin: str, name: str, count: int, because: str) -> None:
            with suppress(RecorderFailed):  # each is noted, though a log that failed is why it stops
                recorder.due(origin, name, count, because)

        for name in self.names:
            tell("measured", name, due, why(acquisition.name, acquisition.error is not None))
        for name in (*self.names, ENCODER_CHANNEL):  # which may be predicted at the card's samples
            tell("predicted", name, came, "not predicted")
        if (encoder := self.encoder) is not None:
            because = why("encoder", encoder.error is not None)
            tell("measured", ENCODER_CHANNEL, encoder.due(asked_s), because)
        for logger, record in zip(self.devices.loggers.values(), self.loggers, strict=True):
            for channel in logger.channels:
                tell("measured", channel.name, record.due(asked_s), why(logger.name, record.lost))

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """A thread that does nothing else stops the rig and gives the signs of life, whoever else waits."""
        ended, stops = threading.Event(), list[threading.Thread]()
        guard = threading.Thread(target=self._guard, args=(ended, stops), name="guard", daemon=True)
        self._guarded_s = self.clock.monotonic_s()
        guard.start()
        try:
            yield
        finally:
            for thread in stops:  # the signs of life go on until the last has done
                thread.join(self.motion.longest_stop_s + 1.0)
            ended.set()
            guard.join(HUNG_S)  # one that hangs is left behind
            self._guarded_s = math.inf  # nothing moves any more

    def _guard(self, ended: threading.Event, stops: list[threading.Thread]) -> None:
        try:
            self._watch_over(ended, stops)
        except Exception as error:  # top of a thread: a fault of ours must stop the rig like any other
            self._hung = self._hung or f"the guard failed: {type(error).__name__}: {error}"
            with suppress(Exception):  # whatever does not, the supervisor hears no more of this run
                self.motion.cut()
            show_fault(error)

    def _watch_over(self, ended: threading.Event, stops: list[threading.Thread]) -> None:
        while not ended.is_set():
            self.acquisition.alarm.wait(LOOK_S)
            self.acquisition.alarm.clear()
            if self._moves and self._unguarded:  # it all slept, and was switched off
                self._stopped_ns = self._stopped_ns or self._stopping_ns()
            self._guarded_s = self.clock.monotonic_s()
            self._latching.give(self.emergency_stop)
            stop = None
            with self._deciding:
                if (found := self._dangers()) > self._met:
                    cut = self._stops or self._at_once  # also by what comes while it stops already
                    if not self._unsafe:
                        self._unsafe_until_s = self._guarded_s + self.motion.longest_stop_s
                    self._met, self._stops, self._unsafe = found, True, self._unsafe + 1
                    self._stopped_ns = self._stopped_ns or self._stopping_ns()
                    self.shaft.disarm()
                    if self.devices.spare is None:  # else the supervisor may act beside it
                        self.watch.excuse(self.motion.longest_stop_s)
                    stop = self.motion.cut if cut else self.motion.off
            if stop is not None:
                stopping = threading.Thread(target=self._stop_now, args=(stop,), daemon=True)
                try:
                    stopping.start()
                    stops.append(stopping)
                except RuntimeError:  # a machine that starts none more: without signs of life meanwhile
                    self._stop_now(stop)
            # a generator that does not go off is the supervisor's; an inverter's stop has its own deadlines
            failing = self._unsafe and self._guarded_s >= self._unsafe_until_s
            if not self._late() and not (failing and self.devices.spare is not None):
                self._supervisor.beat()

    def _stop_now(self, stop: Callable[[], None]) -> None:
        with suppress(Exception):  # the sequence hears of it too
            stop()
            with self._deciding:
                self._unsafe -= 1

    def _dangers(self) -> int:
        """How many things have come by now of which each is to stop what moves."""
        self._hung = self._hung or self._late()
        if self._moves and self.encoder is not None and self.encoder.hangs:
            self._hung = self._hung or f"the encoder gave no positions for {HANGS_S:g} s"
        lost = [
            each for each in (self.acquisition, self.encoder) if each is not None and each.error is not None
        ]
        again = max(self._stop.asked - 1, 0)
        stopped = self.emergency_stop is not None
        return self.acquisition.trips + self.shaft.tripped + len(lost) + bool(self._hung) + again + stopped

    def _late(self) -> str:
        """Who hangs by now, while it moves."""
        if not self._moves:  # at rest a slow disk or a person may take their time
            return ""
        if self.watch.hangs(longest_s := self.motion.longest_order_s):
            return f"the sequence looked at nothing for {longest_s:.1f} s"
        return "the acquisition took too long for a reading" if self.acquisition.hangs else ""

    def _look(self, reading: CardReading) -> None:
        """In the acquisition thread, which watches the guard as the guard does it."""
        if self._moves and self._unguarded:
            self.acquisition.trip("nobody guards the run")
        late_s = self.acquisition.late_s(reading)
        late = self._moves and late_s > LATE_S
        if self._behind.look(self.acquisition.base.now_s(), holds=late, gone=not late) is not None:
            self._hung = self._hung or f"what is measured is seen {late_s:.1f} s late"
            self.acquisition.alarm.set()
        beyond = ""
        if self._force is not None:
            if self._stops:
                self._force.let_go()
            row = self.names.index(self._force.channel.name)
            flags = reading.flags[row] if self._moves else Flag.GOOD  # at rest a loose cable harms nobody
            beyond = self._force.take(reading.values[row], flags)
        if beyond:
            self.acquisition.trip(beyond)
            self.stream(Event(self.clock.unix_ns(), "error", "acquisition", "drive.abort", beyond))
        for event in self.shaft.take(reading, self.acquisition):
            self.stream(event)

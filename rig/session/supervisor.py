"""A small process that brings the drive to rest when the run can no longer do so itself."""

from __future__ import annotations

import math
import os
import select
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from itertools import pairwise
from multiprocessing.connection import Connection
from types import TracebackType

import psutil

from daq.clock import SystemClock
from daq.errors import EmergencyStop, InstrumentRefused, RattleError
from daq.process import Child, send
from drivers.lock import InstrumentLock, Latch
from drivers.protocols.emergency_stop import LOOK_S, SILENCE_S, LineReader, LineWatch
from drivers.protocols.instrument import Actuator
from rig.session.signals import STOP_SIGNALS

LET_GO_S = 4.0
"""An inverter's own watchdog is quicker, and a run that is killed cannot close its log."""
_HURRY_S = 0.06
"""How long a sign of life counts with a generator once the emergency stop is seen: three of the guard's."""
_START_S = 30.0  # a new interpreter that loads a driver, on a busy machine
_SOON_S, _AGAIN_S = 0.1, 1.0  # between two tries to switch off
_ANSWER_S = 2.0  # what the run waits for `go_on`
_LEAVES_S = 2.0  # what it waits for it to end
_SLEPT_S = 0.05
"""Later than so by itself, this process was not let run: nor was the one that it watches."""
_ANSWERED = 10
"""Every so manyth sign of life is answered: each costs both processes as much as all else that they watch."""
_UNANSWERED = 250
"""Signs of life without an answer: 5 s. A busy machine keeps it from answering for half a second."""
_MOST_FILES = 1024  # the usual limit of open files of a process
_READY, _HEARD, _DONE, _OFF, _TRIPPED = "ready", "heard", "done", "off", "tripped"
_ENDS: dict[object, str | None] = {_DONE: None, _OFF: _OFF}
_LET_GO = (
    "rattle: the run gave no sign of life for {silence:g} s and was ended, so that nothing is sent to the "
    "motor any more: its inverter's own watchdog (Pr.122) stops it. What was recorded: rattle recover"
)
_GONE = "rattle: the run is gone; the inverter's own watchdog (Pr.122) stops the motor"
_FAILED = "rattle: the supervisor failed, and no run goes on without it"
_IS_OFF = (
    "rattle: the drive is off, by a connection of the supervisor's own. What was recorded: rattle recover"
)
_ENDED = "rattle: the run is gone, and its emulated drive with it. What was recorded: rattle recover"
_GOES_ON = (
    "rattle: the run is gone or hangs, and THE DRIVE MAY STILL BE ON: switch it off by hand; process "
    "{process} goes on trying (kill {process} ends it)"
)

_UNASKED = "next run may not ask whether anybody is in danger: see to that yourself"
_UNLATCHED = f"the disk hangs, and does not keep that an emergency stop was seen: the {_UNASKED}"


class SupervisorTripped(RattleError, RuntimeError):
    """The run hung and the supervisor has switched the drive off."""


class Supervisor:
    """Brings the drive to rest when this process dies or `beat` stays away for 0.5 s.

    `spare` makes a second driver of the same actuator, which switches it off by a connection of its own, for
    as long as it takes, and holds `locks` meanwhile; it must be picklable. Where that fails, a run that is
    held still is ended: it may hold the only connection. It does so once with an `emulated` actuator, which
    ends with its run, and with a person who drives `by_hand` and has been asked then. Where it is None no
    second one can be opened: then the supervisor ends a run that hangs for 4 s, so that nothing keeps the
    actuator's own watchdog quiet, which does the rest (docs/decisions/0008).

    It reads the emergency stop's `line` on the card, picklable too, tells it as `emergency_stop` and sets the
    `latch`. A spare that may speak beside the run says its off `at_once`. Without one, or where it fails, it
    waits for 0.06 s from then on and for the `off_s` more that an off may look at nothing else, but for 0.5 s
    at most, and so long without a spare.

    One that `stays` goes on watching a rig that has come to rest, for the next run to beat, until `close`.
    """

    def __init__(
        self,
        spare: Callable[[], Actuator] | None,
        locks: Sequence[InstrumentLock] = (),
        emulated: bool = False,
        line: Callable[[], LineReader] | None = None,
        latch: Latch | None = None,
        off_s: float = 0.0,
        stays: bool = False,
        by_hand: bool = False,
        at_once: bool = False,
    ) -> None:
        self._stays = stays
        self._silence_s = LET_GO_S if spare is None else SILENCE_S
        hurry_s = SILENCE_S if spare is None else min(_HURRY_S + off_s, SILENCE_S)
        self._up, self._unanswered = False, 0  # signs of life since the last that was answered
        self._told, self._took_over = "", False
        self._line_seen: EmergencyStop | None = None
        self._hearing = threading.Lock()  # sequence and guard both read the pipe
        # Nothing but its pipe or SIGKILL ends it, and not that the run is gone: that is what it is there for.
        # What it frees is hardly anything.
        watched = spare, locks, emulated, by_hand, line, latch, hurry_s, at_once
        self._child = Child(
            "supervisor", _supervise, *watched, deaf_to=STOP_SIGNALS, grace_s=None, keeps_memory=True
        )
        self._pipe_has = _looks_at(self._child.pipe)

    def launch(self) -> None:
        """Start the process, which takes seconds; `with` waits for it and `close` ends it."""
        if self._child.pid is not None:
            return
        # It may fork while it reads a card's line, which its child leaves alone; gRPC would hang that.
        os.environ["GRPC_ENABLE_FORK_SUPPORT"] = "0"
        self._child.start()

    def __enter__(self) -> Supervisor:
        if not self._watches():
            raise SupervisorTripped("the supervisor did not start; nothing moves without it")
        # A frozen supervisor must not hold up the acquisition with a full pipe.
        os.set_blocking(self._child.pipe.fileno(), False)  # a beat that finds it full is dropped
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing moves any more; a run that something went wrong with keeps nobody."""
        if not self._stays or kind is not None:
            self.close()
        else:
            with suppress(OSError):  # one that does not hear it takes the next silence for a run that hangs
                self._child.pipe.send(math.inf)

    def close(self) -> None:
        """End the process, but for one that has taken over; may be called twice."""
        if self._took_over:
            self._child.process.join(_LEAVES_S)
            self._child.leave()
        else:
            with suppress(OSError):
                self._child.pipe.send(_DONE)
            self._child.end(_LEAVES_S)
        self._child.pipe.close()

    def beat(self) -> None:
        """Say that somebody guards what moves."""
        self._unanswered += 1
        with suppress(OSError):
            send(self._child.pipe, self._silence_s)  # 50 times a second

    def take_over(self) -> None:
        """Have it switch the drive off for as long as that takes; one that is still to come up, then."""
        self._took_over = True
        with suppress(OSError):
            self._child.pipe.send(_OFF)

    def go_on(self) -> str:
        """What a person should know of that."""
        self._watches()
        process = self._heard(_ANSWER_S)
        if process == _TRIPPED:
            return "the supervisor says that it is off by now"
        return process and (
            f"process {process} goes on trying, says when it is off, and keeps the bench until then "
            f"(kill {process} ends it)"
        )

    def check(self) -> None:
        """Raise SupervisorTripped if it has switched the drive off, has died itself or hangs."""
        if self._heard():
            raise self._line_seen or SupervisorTripped(
                f"the supervisor stops the drive: the run gave no sign of life for {self._silence_s:g} s, or "
                "it failed itself, which it says"
            )
        if not self._child.alive:
            raise self._line_seen or SupervisorTripped(
                "the supervisor is gone, tripped or dead; no run goes on without it"
            )
        if self._unanswered > _UNANSWERED:
            raise SupervisorTripped("the supervisor does not answer any more; no run goes on without it")

    @property
    def emergency_stop(self) -> EmergencyStop | None:
        """What it has seen of the line; for any thread."""
        self._heard()
        return self._line_seen

    def _watches(self) -> bool:
        """Wait until it is up; False where it does not come."""
        with suppress(EOFError, OSError):
            self._up = self._up or (self._child.pipe.poll(_START_S) and self._child.pipe.recv() == _READY)
        return self._up

    def _heard(self, within_s: float = 0.0) -> str:
        """Which process switches the drive off, or that it is off; nothing while all is well."""
        if not self._hearing.acquire(timeout=LOOK_S):  # whoever has it may hang, and off waits for nobody
            return self._told
        try:
            with suppress(OSError, EOFError):
                while self._told != _TRIPPED and self._pipe_has.poll(within_s * 1e3):
                    if isinstance(told := self._child.pipe.recv(), EmergencyStop):
                        self._line_seen = told
                    elif told == _HEARD:
                        self._unanswered = 0
                    elif told == _READY:
                        self._up = True
                    else:
                        self._told = told
        finally:
            self._hearing.release()
        return self._told


def _looks_at(pipe: Connection) -> select.poll:
    """Whether anything has come; `Connection.poll` makes one of these for each of its looks."""
    looks = select.poll()
    looks.register(pipe.fileno(), select.POLLIN)
    return looks


def _supervise(
    pipe: Connection,
    spare: Callable[[], Actuator] | None,
    locks: Sequence[InstrumentLock],
    emulated: bool,
    by_hand: bool,
    line: Callable[[], LineReader] | None,
    latch: Latch | None,
    hurry_s: float,
    at_once: bool,
) -> None:
    run = os.getppid()
    its_process = psutil.Process(run)  # as long as it lives: later its number may be another's
    os.setsid()  # what the terminal sends to the run must not end its safety net too
    if spare is not None:
        spare()  # so that all that its driver needs is loaded while everything is still well
    off = _OffAtOnce(spare if line is not None and at_once else None)
    with (
        Latching(latch, _say) as latching,
        nullcontext() if line is None else LineWatch(line, SystemClock()) as watch,
    ):
        failed = ""
        try:
            why = _await_silence(pipe, watch, latching, hurry_s, off)
        except Exception as error:  # top of a process: what moves is not to be left to nobody
            why = failed = f"{_FAILED}: {type(error).__name__}: {error}"
        off.leave()
        if why is None:
            return
        if spare is None:
            # One that hangs may poll on, which keeps the motor turning. Where this process has failed the run
            # lives, as far as anybody knows, and stops once this one has ended.
            if why != _GONE and not failed and os.getppid() == run:
                os.kill(run, signal.SIGKILL)
            _say(why)
        elif by_hand:
            switch_off(spare)  # who was asked says it all
            _say(failed)
        elif emulated:
            is_off = switch_off(spare)
            if why != _OFF:
                _say(failed or (_IS_OFF if is_off else _ENDED))
        else:
            apart = False
            with suppress(OSError):  # a machine that starts none more: in this one then
                if os.fork() > 0:  # the run waits for its child and ends it, which that one is not
                    return
                apart = True
            _switch_off_for_good(pipe, spare, locks, failed, told=why == _OFF, apart=apart, run=its_process)
            os._exit(0)


def _switch_off_for_good(
    pipe: Connection,
    spare: Callable[[], Actuator],
    locks: Sequence[InstrumentLock],
    failed: str,
    told: bool,
    apart: bool,
    run: psutil.Process,
) -> None:
    """`failed`: what went wrong, if not the run. `apart`: in a process without other threads, that no run
    which lives still ends.
    """
    if apart:
        # nothing of the run's is kept open: processes that it left wait for that, with what it writes to
        kept = sorted([pipe.fileno(), *(lock.fileno() for lock in locks)])
        for low, high in pairwise([2, *kept, _MOST_FILES]):
            os.closerange(low + 1, high)
        with suppress(OSError):
            pipe.send(str(os.getpid()))
    if not switch_off(spare):
        # whoever reads what the run writes, or would end this, is not to wait for it
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
        words = "" if told else failed or _GOES_ON.format(process=os.getpid())
        with suppress(RuntimeError):  # no thread more: without words then
            threading.Thread(target=_say_and_let_go, args=(words,), daemon=True).start()
        for lock in locks:
            with suppress(OSError):
                lock.sign(", which goes on switching off a drive that does not answer,")
        while True:  # nobody else is left to try again
            if _ended_as_held(run):
                time.sleep(_SOON_S)  # it lets go within a moment
            if switch_off(spare):
                break
            time.sleep(_AGAIN_S)
        told = False
    for lock in locks:
        lock.close()
    with suppress(OSError):
        pipe.send(_TRIPPED)
    if not told:
        _say(failed or _IS_OFF)


def _ended_as_held(run: psutil.Process) -> bool:
    """End a run that is held still, as by Ctrl-Z: it lets go of no connection by itself. Whether it was."""
    with suppress(psutil.Error):
        if run.status() in (psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP):
            run.kill()
            return True
    return False


def _say_and_let_go(text: str) -> None:
    _say(text)
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 1)
    if stat.S_ISFIFO(os.fstat(2).st_mode):
        os.dup2(nowhere, 2)


def _say(text: str) -> None:
    """On standard error, if there is anything to say."""
    with suppress(OSError):
        if text:
            print(text, file=sys.stderr, flush=True)


class _OffAtOnce:
    """Switches the drive off once it is called, by a thread that is there before it is needed.

    One without a spare fails.
    """

    def __init__(self, spare: Callable[[], Actuator] | None) -> None:
        self._called, self._took = threading.Event(), False
        self._thread = threading.Thread(target=self._wait, args=(spare,), name="off at once", daemon=True)
        if spare is not None:
            self._thread.start()

    def call(self, moves: bool) -> bool:
        """Off, unless nothing `moves` yet; returns False once the drive did not take it."""
        if moves:
            self._called.set()
        return self._thread.is_alive() or self._took

    @property
    def under_way(self) -> bool:
        return self._called.is_set() and self._thread.is_alive()

    def leave(self) -> None:
        """Wait for one that is under way; one that hangs is left behind."""
        if self.under_way:
            self._thread.join(SILENCE_S)

    def _wait(self, spare: Callable[[], Actuator]) -> None:
        self._called.wait()
        self._took = switch_off(spare)


def _at_most(seconds: float, longest_s: float) -> float:
    """For ever stays so: then the run has said that nothing moves."""
    return seconds if seconds == math.inf else min(seconds, longest_s)


def _await_silence(
    pipe: Connection, line: LineWatch | None, latching: Latching, hurry_s: float, off: _OffAtOnce
) -> str | None:
    """Wait until the run dies or beats no more, and say which; None where it has ended as it should.

    Once `line` is seen open, which `latching` and the run are told, `off` is called where anything moves.
    Where that fails, the run may be silent for `hurry_s` at most.
    """
    until_s, patience_s, longest_s, slept = math.inf, 0.0, math.inf, False  # no beat yet: nothing moves
    pipe_has, signs, hurries = _looks_at(pipe), 0, False
    os.set_blocking(pipe.fileno(), False)  # a run that reads nothing must not keep it from switching off
    try:
        pipe.send(_READY)
        while True:
            if line is not None and (seen := line.look()) is not None:
                line, hurries = None, True
                latching.give(seen)
                pipe.send(seen)
            # also once what was at rest begins to move all the same
            if hurries and not off.call(moves=until_s < math.inf):
                hurries, longest_s = False, hurry_s
                until_s = _at_most(until_s, time.monotonic() + hurry_s)
            looks = line is not None or off.under_way
            wait_s = min(max(until_s - time.monotonic(), 0.0), LOOK_S if looks else math.inf)
            if pipe_has.poll(None if wait_s == math.inf else wait_s * 1e3):
                message = pipe.recv()
                if message in _ENDS:
                    return _ENDS[message]
                patience_s, slept = message, False
                if signs % _ANSWERED == 0:
                    with suppress(BlockingIOError):  # nobody reads them: that is for the run to see
                        pipe.send(_HEARD)
                signs += 1
            elif looks and time.monotonic() < until_s:
                continue
            elif slept or time.monotonic() - until_s < _SLEPT_S:
                return _LET_GO.format(silence=min(LET_GO_S, longest_s))
            else:  # the whole machine stood still, the run with it: once more
                slept = True
            until_s = time.monotonic() + _at_most(patience_s, longest_s)
    except (EOFError, OSError):
        return _GONE


class Latching:
    """Has the next run ask a person, in a thread that keeps nobody from switching off.

    It is there before it is needed, for a machine may start none by then.
    """

    def __init__(self, latch: Latch | None, say: Callable[[str], None] = lambda text: None) -> None:
        self._latch, self._say = latch, say
        self._seen: EmergencyStop | None = None
        self._given, self._wrong = threading.Event(), _UNLATCHED
        self._thread = threading.Thread(target=self._keep, name="latch", daemon=True)
        self._thread.start()

    def __enter__(self) -> Latching:
        return self

    def __exit__(self, *error: object) -> None:
        self.end()

    def give(self, seen: EmergencyStop | None) -> None:
        """Keep it, if anything was seen; waits for nothing."""
        if seen is not None and self._latch is not None:
            self._seen = seen
            self._given.set()

    def end(self) -> str:
        """What went wrong; one that hangs is left behind."""
        self._given.set()
        if self._seen is None:
            return ""
        self._thread.join(SILENCE_S)
        return self._wrong

    def _keep(self) -> None:
        self._given.wait()
        wrong = ""
        if (seen := self._seen) is not None and self._latch is not None:
            try:
                self._latch.set(f"{seen.instrument} at {seen.address} ended a run: {seen.what}")
            except InstrumentRefused as error:
                wrong = f"{error}. The {_UNASKED}"
                self._say(wrong)
        self._wrong = wrong


def switch_off(spare: Callable[[], Actuator]) -> bool:
    """Switch the drive off by a new connection; returns whether the actuator took it, whatever it raised."""
    with suppress(Exception):
        actuator = spare()
        try:
            actuator.open()
            actuator.off()
        finally:
            actuator.close()
        return True
    return False

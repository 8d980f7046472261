"""A drive that cannot be reached is switched off by whoever is left, for as long as that takes."""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

import psutil
import pytest

from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import EmergencyStop, InstrumentAbsent, InstrumentRefused
from daq.time_base.run_clock import RunClock
from drivers import lock as locks
from drivers.lock import Latch, lock
from drivers.protocols.emergency_stop import SILENCE_S, LineWatch
from rig.files.bench import load_bench
from rig.files.scenario import parse_scenario
from rig.session.devices import Devices
from rig.session.drive import Shaker, drive_off_after
from rig.session.driven_rig import DrivenRig
from rig.session.signals import StopRequest
from rig.session.supervisor import Supervisor, SupervisorTripped
from tests.end_to_end.command import await_true
from tests.end_to_end.files import write_bench
from tests.rig.session.fakes import RecordingGenerator, SteppedCard, silent_screen
from tests.rig.session.test_driven_rig import SCENARIO
from tests.tiers import first_short


class FarGenerator(RecordingGenerator):
    """Answers once the file `there` is, and leaves one at `off` when it goes off."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def open(self) -> None:
        if not (self._folder / "there").exists():
            raise InstrumentAbsent(self.name, self.address, "nobody answers")

    def off(self) -> None:
        (self._folder / "off").touch()


class FileLine:
    """An emergency stop's line that is open while the file `pressed` is."""

    address = "here"

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def open(self) -> None: ...

    def heed(self) -> None:
        if (self._folder / "pressed").exists():
            raise EmergencyStop(self.address, "its line is open", time.monotonic())

    def close(self) -> None: ...


class LastThreadLine(FileLine):
    """From its opening on the machine starts no thread more."""

    def open(self) -> None:
        threading.Thread.start = refuse_latch  # type: ignore[method-assign]


class LastGenerator(FarGenerator):
    """The machine starts no process more from its making on, nor a thread from its opening on."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        os.fork = refuse_process

    def open(self) -> None:
        threading.Thread.start = refuse_latch  # type: ignore[method-assign]
        (self._folder / "tried").touch()
        super().open()


def refuse_process() -> int:
    raise BlockingIOError("Resource temporarily unavailable")


START = threading.Thread.start


def refuse_latch(thread: threading.Thread) -> None:
    if thread.name != "emergency stop":
        raise RuntimeError("can't start new thread")
    START(thread)


@pytest.fixture(autouse=True)
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "FOLDERS", (str(tmp_path),))


@pytest.fixture
def launched(tmp_path: Path) -> Iterator[Callable[..., Supervisor]]:
    with lock("generator", "here") as held:

        def launch(
            emulated: bool = False,
            line: bool = False,
            off_s: float = 0.0,
            stays: bool = False,
            at_once: bool = False,
        ) -> Supervisor:
            watched = partial(FileLine, tmp_path) if line else None
            generator, latch = partial(FarGenerator, tmp_path), Latch("generator", "here")
            supervisor = Supervisor(
                generator, [held], emulated, watched, latch, off_s, stays, at_once=at_once
            )
            supervisor.launch()
            return supervisor

        yield launch


def taken_over(supervisor: Supervisor) -> str:
    supervisor.take_over()
    return supervisor.go_on()


def process_in(words: str) -> int:
    """Which process says that it goes on."""
    assert words.startswith("process "), words
    return int(words.split()[1])


def test_it_goes_on_until_the_drive_is_off_and_keeps_the_bench_until_then(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    with launched() as supervisor:
        supervisor.beat()
        number = process_in(taken_over(supervisor))
    trying = psutil.Process(number)
    assert not (tmp_path / "off").exists()
    (tmp_path / "there").touch()
    await_true("switched off", (tmp_path / "off").exists)
    await_true("its end", lambda: not psutil.pid_exists(number) or trying.status() == psutil.STATUS_ZOMBIE)


class OddGenerator(FarGenerator):
    """Raises what is no error of ours where it is `odd`, until the file `there` is; leaves one at `tried`."""

    def __init__(self, folder: Path, odd: str) -> None:
        super().__init__(folder)
        self._odd = odd

    def open(self) -> None:
        self._fail("open")

    def off(self) -> None:
        self._fail("off")
        super().off()

    def _fail(self, where: str) -> None:
        if where == self._odd and not (self._folder / "there").exists():
            (self._folder / "tried").touch()
            raise RuntimeError("a fault of a library")


@pytest.mark.parametrize("odd", ["open", "off"])
def test_no_fault_of_a_library_keeps_it_from_trying_again(tmp_path: Path, odd: str) -> None:
    supervisor = Supervisor(partial(OddGenerator, tmp_path, odd))
    supervisor.launch()
    with supervisor:
        supervisor.beat()
        number = process_in(taken_over(supervisor))
    await_true("tried", (tmp_path / "tried").exists)
    (tmp_path / "there").touch()
    await_true("switched off", (tmp_path / "off").exists)
    await_true("its end", lambda: has_ended(number))


class FaultyLine(FileLine):
    """Whoever asks what was seen of it meets a fault once the file `pressed` is there."""

    def open(self) -> None:
        LineWatch.look = self._look  # type: ignore[method-assign, assignment]

    def _look(self) -> EmergencyStop | None:
        if (self._folder / "pressed").exists():
            raise RuntimeError("a fault of a library")
        return None


def test_no_fault_while_it_waits_keeps_it_from_switching_off(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "there").touch()
    supervisor = Supervisor(partial(FarGenerator, tmp_path), line=partial(FaultyLine, tmp_path))
    beating, said = threading.Event(), ""

    def beat() -> None:
        while not beating.wait(0.01):
            supervisor.beat()

    def told() -> bool:
        nonlocal said
        said += capfd.readouterr().err
        return "RuntimeError: a fault of a library" in said

    run = threading.Thread(target=beat)
    supervisor.launch()
    with supervisor:
        run.start()  # it is not its silence that switches off
        (tmp_path / "pressed").touch()
        try:
            await_true("switched off", (tmp_path / "off").exists)
            with pytest.raises(SupervisorTripped, match="the supervisor stops the drive"):
                supervisor.check()
            await_true("told", told)
        finally:
            beating.set()
            run.join()


def test_a_bench_that_it_tries_to_switch_off_is_refused_with_its_number(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    held = lock("generator", "here")
    supervisor = Supervisor(partial(FarGenerator, tmp_path), [held])
    supervisor.launch()
    with supervisor:
        supervisor.beat()
        number = process_in(taken_over(supervisor))
    held.close()

    def refused() -> str:
        with pytest.raises(InstrumentRefused, match="in use by process") as caught:
            lock("generator", "here")
        return str(caught.value)

    goes_on = f"in use by process {number}, which goes on switching off a drive that does not answer, since"
    await_true("signed", lambda: goes_on in refused())
    os.kill(number, signal.SIGTERM)  # by hand, once a person has switched it off
    await_true("its end", lambda: not psutil.pid_exists(number))
    lock("generator", "here").close()


class SlowlyMade(FarGenerator):
    """Takes longer to load than a run waits for its supervisor to end."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        time.sleep(3.0)


def test_one_that_has_taken_over_is_not_ended_before_it_has_begun(tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    supervisor = Supervisor(partial(SlowlyMade, tmp_path))
    supervisor.launch()
    supervisor.take_over()
    supervisor.close()
    await_true("switched off", (tmp_path / "off").exists)
    supervisor._child.process.join()


def test_an_emulated_drive_is_not_waited_for(launched: Callable[..., Supervisor]) -> None:
    with launched(emulated=True) as supervisor:
        supervisor.beat()
        assert taken_over(supervisor) == ""


def test_silence_switches_off_within_half_a_second_and_a_bit(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    (tmp_path / "there").touch()
    with launched() as supervisor:
        supervisor.check()
        supervisor.beat()
        await_true("switched off", (tmp_path / "off").exists, SILENCE_S + 0.4)
        with pytest.raises(SupervisorTripped, match=r"gave no sign of life for 0.5 s"):
            supervisor.check()
        assert taken_over(supervisor) == "the supervisor says that it is off by now"


def test_one_that_is_killed_is_gone(launched: Callable[..., Supervisor]) -> None:
    with launched() as supervisor:
        supervisor.beat()
        supervisor._child.process.kill()
        supervisor._child.process.join()
        with pytest.raises(SupervisorTripped, match="the supervisor is gone"):
            supervisor.check()


def test_nobody_waits_for_another_who_hears_it(launched: Callable[..., Supervisor]) -> None:
    """A guard that hangs there must not keep the sequence from switching off."""
    with launched() as supervisor, supervisor._hearing:
        since_s = time.monotonic()
        assert supervisor.emergency_stop is None
        assert time.monotonic() - since_s < 1.0


@pytest.mark.parametrize("at_once", [True, False])
def test_an_emergency_stop_is_told_and_the_run_that_lives_goes_on_to_its_end(
    launched: Callable[..., Supervisor], tmp_path: Path, at_once: bool
) -> None:
    """With an off beside its own where that cannot garble it."""
    (tmp_path / "there").touch()
    with launched(line=True, off_s=1.0, at_once=at_once) as supervisor:
        beating = threading.Event()

        def beat() -> None:
            while not beating.wait(0.01):
                supervisor.beat()

        run = threading.Thread(target=beat)
        run.start()
        assert supervisor.emergency_stop is None
        pressed_s = time.monotonic()
        (tmp_path / "pressed").touch()
        await_true("seen", lambda: supervisor.emergency_stop)
        assert time.monotonic() - pressed_s < 0.15
        (tmp_path / "pressed").unlink()
        time.sleep(0.2)
        seen = supervisor.emergency_stop
        supervisor.check()  # nobody took it over
        beating.set()
        run.join()
        assert seen is not None
        assert pressed_s < seen.at_s < pressed_s + 0.1
        assert (tmp_path / "off").exists() == at_once


@pytest.mark.parametrize("at_once", [True, False])
def test_an_emergency_stop_that_finds_the_run_silent_is_the_supervisors(
    launched: Callable[..., Supervisor], tmp_path: Path, at_once: bool
) -> None:
    """Sooner than the silence alone would be noticed."""
    (tmp_path / "there").touch()
    with launched(line=True, at_once=at_once) as supervisor:
        supervisor.beat()
        pressed_s = time.monotonic()
        (tmp_path / "pressed").touch()
        await_true("switched off", (tmp_path / "off").exists)
        assert time.monotonic() - pressed_s < SILENCE_S / 2


@pytest.mark.parametrize("at_once", [True, False])
def test_what_begins_to_move_after_an_emergency_stop_is_off_as_soon(
    launched: Callable[..., Supervisor], tmp_path: Path, at_once: bool
) -> None:
    (tmp_path / "there").touch()
    with launched(line=True, at_once=at_once) as supervisor:
        (tmp_path / "pressed").touch()
        await_true("seen", lambda: supervisor.emergency_stop)
        assert not (tmp_path / "off").exists()
        supervisor.beat()
        began_s = time.monotonic()
        await_true("switched off", (tmp_path / "off").exists)
        assert time.monotonic() - began_s < SILENCE_S / 2


def test_an_off_at_once_that_fails_leaves_the_run_as_little_time_as_without_it(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    with launched(line=True, at_once=True) as supervisor:
        supervisor.beat()
        time.sleep(0.1)  # 0.4 s more would be its own
        (tmp_path / "pressed").touch()
        pressed_s = time.monotonic()
        await_true("taken over", supervisor._heard)
        assert time.monotonic() - pressed_s < 0.3
        number = process_in(supervisor.go_on())
    (tmp_path / "there").touch()
    await_true("switched off", (tmp_path / "off").exists)
    await_true("its end", lambda: has_ended(number))


def test_one_that_is_open_before_anything_moves_moves_nothing(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    (tmp_path / "pressed").touch()
    with launched(line=True) as supervisor:
        await_true("seen", lambda: supervisor.emergency_stop)
        time.sleep(0.3)
        supervisor.check()
        assert not (tmp_path / "off").exists()


def test_it_latches_an_emergency_stop_whatever_becomes_of_the_run(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    latch = Latch("generator", "here")
    (tmp_path / "pressed").touch()
    with launched(line=True):
        await_true("latched", latch.told)
    assert latch.told() == "emergency stop at here ended a run: its line is open"


def test_a_machine_that_starts_no_thread_more_costs_neither_the_word_nor_the_latch(tmp_path: Path) -> None:
    latch = Latch("generator", "here")
    supervisor = Supervisor(
        partial(FarGenerator, tmp_path), line=partial(LastThreadLine, tmp_path), latch=latch
    )
    supervisor.launch()
    with supervisor:
        (tmp_path / "pressed").touch()
        await_true("seen", lambda: supervisor.emergency_stop)
        await_true("latched", latch.told)
        supervisor.check()


@pytest.mark.parametrize("there", [True, False])
def test_a_machine_that_starts_nothing_more_keeps_nobody_from_switching_off(
    tmp_path: Path, there: bool
) -> None:
    if there:
        (tmp_path / "there").touch()
    supervisor = Supervisor(partial(LastGenerator, tmp_path))
    supervisor.launch()
    supervisor.__enter__()
    supervisor.beat()
    supervisor._child.pipe.close()  # the run dies
    await_true("tried", (tmp_path / "tried").exists)
    (tmp_path / "there").touch()
    await_true("switched off", (tmp_path / "off").exists)
    supervisor._child.end(2.0)


def test_a_latch_that_cannot_be_kept_is_told(
    launched: Callable[..., Supervisor], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    latch = Latch("generator", "here")
    os.mkdir(latch._paths[0])
    (tmp_path / "pressed").touch()
    said = ""

    def told() -> bool:
        nonlocal said
        said += capfd.readouterr().err
        return "The next run may not ask whether anybody is in danger: see to that yourself" in said

    with launched(line=True):
        await_true("told", told)


def test_where_a_second_connection_would_garble_the_off_of_the_first_it_waits_as_ever(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    """A serial line has one user, and a run that is busy switching off may live."""
    (tmp_path / "there").touch()
    with launched(line=True, off_s=1.0) as supervisor:
        supervisor.beat()
        pressed_s = time.monotonic()
        (tmp_path / "pressed").touch()
        await_true("switched off", (tmp_path / "off").exists)
        assert SILENCE_S - 0.1 < time.monotonic() - pressed_s < SILENCE_S + 0.4


class SoleGenerator(FarGenerator):
    """Has one user at a time, as on USB: whoever holds the lock on the file `interface`."""

    def open(self) -> None:
        self._held = (self._folder / "interface").open("w")
        try:
            fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InstrumentAbsent(self.name, self.address, "it is in use") from None


def drive_by_it(folder: Path) -> None:
    """A run that drives by it."""
    generator = SoleGenerator(folder)
    generator.open()
    supervisor = Supervisor(partial(SoleGenerator, folder))
    supervisor.launch()
    with supervisor:
        (folder / "drives").touch()
        while True:
            supervisor.beat()
            time.sleep(0.02)


def test_a_run_that_is_stopped_with_the_one_connection_of_a_drive_is_ended(tmp_path: Path) -> None:
    run = multiprocessing.get_context("spawn").Process(target=drive_by_it, args=(tmp_path,))
    run.start()
    try:
        await_true("it drives", (tmp_path / "drives").exists)
        assert run.pid is not None
        os.kill(run.pid, signal.SIGSTOP)
        stopped_s = time.monotonic()
        await_true("switched off", (tmp_path / "off").exists)
        assert time.monotonic() - stopped_s < SILENCE_S + 0.4
        run.join(5.0)
        assert run.exitcode == -signal.SIGKILL
    finally:
        run.kill()
        run.join()


@pytest.mark.parametrize("before", ["it is up", "the first sign of life"])
def test_a_run_that_dies_before_anything_moves_is_switched_off(
    launched: Callable[..., Supervisor], tmp_path: Path, before: str
) -> None:
    (tmp_path / "there").touch()
    supervisor = launched()
    if before == "the first sign of life":
        supervisor.__enter__()
    supervisor._child.pipe.close()
    await_true("switched off", (tmp_path / "off").exists)
    supervisor.close()


def test_one_that_stays_watches_the_next_run_as_it_did_the_first(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    """Nothing moves between two runs, so nobody need give a sign of life; once it moves, somebody must."""
    (tmp_path / "there").touch()
    supervisor = launched(stays=True)
    process = supervisor._child.pid
    with supervisor:
        supervisor.beat()
    time.sleep(SILENCE_S + 0.4)
    supervisor.launch()
    with supervisor:
        supervisor.check()
        assert not (tmp_path / "off").exists()
        assert supervisor._child.pid == process
        supervisor.beat()
        await_true("switched off", (tmp_path / "off").exists, SILENCE_S + 0.4)
    supervisor.close()


def test_a_run_that_dies_at_rest_is_switched_off_as_well(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    (tmp_path / "there").touch()
    supervisor = launched(stays=True)
    with supervisor:
        supervisor.beat()
    supervisor._child.pipe.close()
    await_true("switched off", (tmp_path / "off").exists)
    supervisor.close()


def test_an_emergency_stop_between_two_runs_ends_the_next_before_it_moves(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    supervisor = launched(stays=True, line=True)
    with supervisor:
        supervisor.beat()
    (tmp_path / "pressed").touch()
    await_true("seen", lambda: supervisor.emergency_stop)
    time.sleep(0.3)
    with supervisor:
        supervisor.check()  # it lives, and has switched off nothing that was off
        assert not (tmp_path / "off").exists()
        assert supervisor.emergency_stop is not None
    supervisor.close()


def test_one_that_stays_does_not_outlive_a_run_that_went_wrong(launched: Callable[..., Supervisor]) -> None:
    supervisor = launched(stays=True)
    with pytest.raises(ZeroDivisionError), supervisor:
        raise ZeroDivisionError
    assert not supervisor._child.alive


def test_one_that_is_frozen_is_noticed_by_the_run(
    launched: Callable[..., Supervisor],
) -> None:
    supervisor = launched()
    with supervisor:

        def guarded(beats: int, every_s: float) -> None:
            for _ in range(beats):
                supervisor.beat()
                supervisor.check()
                time.sleep(every_s)

        guarded(50, 0.02)
        os.kill(supervisor._child.pid or 0, signal.SIGSTOP)
        guarded(100, 0.0)  # two seconds of them: it may be late
        with pytest.raises(SupervisorTripped, match="does not answer any more; no run goes on without it"):
            guarded(200, 0.0)


def test_a_run_that_reads_no_answer_and_then_hangs_is_switched_off(
    launched: Callable[..., Supervisor], tmp_path: Path
) -> None:
    (tmp_path / "there").touch()
    with launched() as supervisor:
        for _ in range(3000):  # answers to them are more than a pipe holds
            supervisor.beat()
            time.sleep(0.0002)
        await_true("switched off", (tmp_path / "off").exists, 5.0)


class ArmedGenerator(FarGenerator):
    """Is out of reach once it is armed, until it is hung up."""

    def off(self) -> None:
        if ("close",) not in self.told:
            self.open()
            super().off()


class BrokenCard(SteppedCard):
    def arm(self) -> None:
        raise ZeroDivisionError


class CountedSpare(FarGenerator):
    """Writes down in which process it was made to switch off."""

    def open(self) -> None:
        with (self._folder / "tries").open("a") as tries:
            tries.write(f"{os.getpid()}\n")
        super().open()


@pytest.mark.parametrize("up", first_short(["up", "not up", "up, and found so by the way"]))
def test_from_its_arming_on_it_goes_on_where_the_run_fails(tmp_path: Path, up: str) -> None:
    """Whether it is up by then or still on its way; and it is given over once, whoever asks it again."""
    scenario, screen = parse_scenario(SCENARIO, "armed"), silent_screen()
    generator, card = ArmedGenerator(tmp_path), BrokenCard((Channel("drive.force", "N"),))

    def shaken(wait: Callable[[float], None], rpm: Callable[[], float]) -> Shaker:
        return Shaker(generator, scenario.drive, 3.6, wait)

    bench = load_bench(write_bench(tmp_path / "bench.toml", "TCPIP::127.0.0.1::1::SOCKET"))
    devices = Devices(generator, partial(CountedSpare, tmp_path), shaken, card)  # type: ignore[arg-type]
    rig = DrivenRig(bench, devices, StopRequest(), screen, RunClock(SystemClock()))
    failed_s = 0.0

    def fail() -> None:
        nonlocal failed_s
        with ExitStack() as stack:
            rig.open_log(stack, tmp_path, "armed")
            stack.enter_context(drive_off_after(generator, devices.spare, screen))  # as `connected` does
            rig.launch(stack)
            if up == "up":
                rig._supervisor.__enter__()
            elif up != "not up":
                assert rig._supervisor._child.pipe.poll(30.0)
            rig.motion.arm(soft=False)
            rig.record((), None)
            failed_s = time.monotonic()
            with rig.moving():
                pytest.fail("its card is broken")

    with pytest.raises(ZeroDivisionError):
        fail()
    said = " ".join(screen.console.export_text().split())
    found = re.search(r"MAY STILL BE ON: switch it off by hand ! process (\d+) goes on trying", said)
    assert found is not None, said
    assert said.count("MAY STILL BE ON") == 1
    assert up == "not up" or time.monotonic() - failed_s < 15.0
    assert (tmp_path / "tries").read_text().split().count(str(os.getpid())) == 1
    (tmp_path / "there").touch()
    await_true("switched off", (tmp_path / "off").exists)
    await_true("its end", lambda: has_ended(int(found[1])))


def has_ended(pid: int) -> bool:
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    return True

"""How soon a drive is safe: runs with a generator, a motor or a supply that end badly, over and over.

`limit`: what is measured passes a limit while the terminal has stopped; from that sample to the off.
`stop`: its emergency stop is pressed; from there to the off. A motor's is read by its inverter, and by the
run alone; others by the card, where the run is frozen in half of the tries, by lot.
`killed`, `frozen`: SIGKILL and SIGSTOP; a third as the drive comes on, a third on the way up, a third while
it is recorded, as of `stop`, `thread` and `lost`.
`thread`: one thread of the run is held, one that guards or drives as often as any other. One of those makes
the run safe by itself; where it goes on without another, its limit still trips.
`lost`: an instrument is gone or frozen; to the first sign of a stop, and from there to the off, or, of what
drives, to the first word by which it would be off.
`viewer`: the live view is killed; the record has to be whole.

A run that ends by itself before it is to end badly, as on a machine too busy for the emulated line, tells
nothing of that: it is counted and tried again, one in twenty at most.

Returns 1 if the worst but one in a hundred misses its bar, if one is not safe at all, or a sample is lost.
The motor's inverter watches for 0.5 s (Pr.122); it is off once run is withdrawn, whereupon it ramps down
(Pr.250). A DC supply that turns the motor instead (`supply`) watches for 2 s, by which none of this is safe.

Usage: python -m benchmarks.reactions [ways] [--drives NAME ...] [--tries N] [--seed N]
"""

from __future__ import annotations

import argparse
import ctypes
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from random import Random

import numpy as np
import psutil
from numpy.typing import NDArray

from daq.block import NS_PER_S
from daq.log.reader import LogReader
from daq.log.records import STOPPING
from drivers.emulator_process import EmulatedInstrument
from drivers.emulator_truth import TRUTH_FOLDER
from drivers.mitsubishi_fr.registers import STATUS_AND_COMMAND, Command
from drivers.scpi.language import OUTPUT_OFF
from rig.live.page_server import PORT_VARIABLE
from rig.session.driven_rig import STOPPED
from tests.accounting import discrepancies, sent_in
from tests.drivers.plants import SinePlant
from tests.end_to_end.files import write_bench, write_scenario
from tests.end_to_end.spied_bench import light_card, spied_generator
from tests.end_to_end.spied_crank import STRIKE, spied_crank

ROOT = Path(__file__).parents[1]
_TRY = "RATTLE_TRY"
"""In the environment of all processes of a run."""
_AT_ONCE_S, _AFTER_S = 0.1, 3.0
"""After the first of driving, or of recording, at most."""
_WATCHDOG_S = 0.5
_PATIENCE_S = 60.0
_TOO_LONG_S = 5.0
_PTRACE_SEIZE, _PTRACE_INTERRUPT = 0x4206, 0x4207
_ACTUATORS = ("generator", "inverter", "supply")
_ANY_THREAD = 0x40000000  # __WALL
_GUARDS = ("main", "acquisition", "guard", "encoder", "inverter")
"""Threads that guard or drive."""
_VIEWERS = ("live view", "time line", "rerun")
"""The processes of the live view, by their names."""
_NAMED = """\
import ctypes, runpy, threading
set_native_id, prctl = threading.Thread._set_native_id, ctypes.CDLL(None).prctl
def named(thread):
    set_native_id(thread)
    prctl(15, thread.name.encode(), 0, 0, 0)
threading.Thread._set_native_id = named
runpy.run_module("rig.start", run_name="__main__", alter_sys=True)
"""
"""A run whose threads carry their names, of which Linux keeps 15 letters, for whoever looks from outside."""
_LINE = "cDAQ1Mod4/port0/line0"
"""Of the card, at which an emergency stop is read."""
_STYLE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
_LIMIT = '[limits."{channel}"]\nabort = "{level}"\n'


@dataclass
class StruckPlant(SinePlant):
    """Its row `constant` shows a strike once the file `struck` is there."""

    struck: Path = Path()

    def advance(self, count: int) -> NDArray[np.float64]:
        self.constant = STRIKE if self.struck.exists() else 0.0
        return super().advance(count)


@dataclass(frozen=True, slots=True)
class Bench:
    """Scenario and bench file, the instruments by name, and when which output was heard to drive."""

    scenario: Path
    file: Path
    instruments: dict[str, EmulatedInstrument]
    struck: str
    heard: Callable[[], list[tuple[int, bool]]]
    told_off_ns: Sequence[int]
    """When what drives was told words by which it is off, as far as somebody listens to its line."""
    press: Callable[[], None]
    """Its emergency stop."""

    @property
    def drives(self) -> bool:
        heard = self.heard()
        return bool(heard) and heard[-1][1]

    def safe_ns(self) -> int | None:
        """When it was off for good (Unix ns); None while it drives."""
        heard = self.heard()
        on = max((at for at, (_, drives) in enumerate(heard) if drives), default=-1)
        return None if on in (-1, len(heard) - 1) else heard[on + 1][0]


class Line:
    """A line to what drives: hears when that is told to be off, also where nobody is at its end any more."""

    def __init__(self, port: int, off: Callable[[bytes], bool]) -> None:
        self._to, self._off, self.told_off_ns = port, off, list[int]()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._answer, daemon=True).start()

    def close(self) -> None:
        self._listener.close()

    def _answer(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                far = None
                with suppress(OSError):
                    far = socket.create_connection(("127.0.0.1", self._to), 1.0)
                    far.settimeout(None)
                    threading.Thread(target=self._carry, args=(far, near, False), daemon=True).start()
                threading.Thread(target=self._carry, args=(near, far, True), daemon=True).start()

    def _carry(self, one: socket.socket, other: socket.socket | None, heard: bool) -> None:
        with suppress(OSError):
            while data := one.recv(4096):
                if heard and self._off(data):
                    self.told_off_ns.append(time.time_ns())
                if other is not None:
                    other.sendall(data)
        for each in (one, other):
            if each is not None:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)


def _listened(stack: ExitStack, file: Path, address: str, off: Callable[[bytes], bool]) -> Sequence[int]:
    """Have a bench file reach what drives by a `Line`; when it was told to be off."""
    port = re.findall(r"\d{4,5}", address)[-1]
    line = Line(int(port), off)
    stack.callback(line.close)
    file.write_text(file.read_text().replace(address, address.replace(port, str(line.port))))
    return line.told_off_ns


def _source_off(said: bytes) -> bool:
    return f"{OUTPUT_OFF.command} {OUTPUT_OFF.word}".encode() in said


def _inverter_off(frame: bytes) -> bool:
    """A write (function 6) that takes run back."""
    written, value = frame[1:4], int.from_bytes(frame[4:6])
    register = bytes([6]) + STATUS_AND_COMMAND.address.to_bytes(2)
    return written == register and not Command(value) & Command.FORWARD


@contextmanager
def _generator(folder: Path, way: str) -> Iterator[Bench]:
    struck = "contact.force_upper"
    limits = _LIMIT.format(channel=struck, level="100 N")
    scenario = write_scenario(folder / "scenario.toml", settle_s=1.0, duration_s=60.0, limits=limits)
    plant = partial(StruckPlant, struck=folder / "struck")
    rehearsal, ordered = get_context("spawn").Pipe()
    with (
        rehearsal,
        light_card(plant, {struck: "constant"}, {_LINE: True}, ordered) as (card, onward),
        spied_generator(onward) as (made, spy),
        ExitStack() as stack,
    ):
        ordered.close()
        table = f'[emergency_stop]\nline = "{_LINE}"' if way == "stop" else ""
        file = write_bench(folder / "bench.toml", made.address, card.address, table)
        told = _listened(stack, file, made.address, _source_off) if way == "lost" else ()

        def heard() -> list[tuple[int, bool]]:
            return [(at, each.on) for at, each in zip(spy.heard_ns, spy.heard, strict=False)]

        made_of = {"card": card, "generator": made}
        yield Bench(scenario, file, made_of, struck, heard, told, lambda: rehearsal.send({_LINE: False}))


@contextmanager
def _motor(folder: Path, way: str, by_supply: bool = False) -> Iterator[Bench]:
    struck, is_off = "crank_frame.acceleration_y", _source_off if by_supply else _inverter_off
    line = _LINE if by_supply else "inverter/RH"
    with (
        spied_crank(
            folder,
            stop=line if way == "stop" else "",
            struck=folder / "struck",
            watchdog_s=_WATCHDOG_S,
            by_supply=by_supply,
        ) as crank,
        ExitStack() as stack,
    ):
        told = _listened(stack, crank.file, crank.actuator.address, is_off) if way == "lost" else ()
        with crank.scenario.open("a") as file:
            file.write(_LIMIT.format(channel=struck, level="100 m/s^2"))
        with crank.file.open("a") as file:
            file.write(
                f'[[daq_card.channels]]\nname = "{struck}"\nphysical = "cDAQ1Mod1/ai1"\n'
                'kind = "acceleration_iepe"\nsensitivity = "50 mV/g"\nrange = "100 g"\n'
            )

        def heard() -> list[tuple[int, bool]]:
            outputs = zip(crank.spy.heard_ns, crank.spy.heard, strict=False)
            return [(at, each.on and each.target > 0.0) for at, each in outputs]

        name = "supply" if by_supply else "inverter"
        made = {"card": crank.card, name: crank.actuator, "encoder": crank.encoder}
        yield Bench(crank.scenario, crank.file, made, struck, heard, told, crank.press)


DRIVES: dict[str, Callable[[Path, str], AbstractContextManager[Bench]]] = {
    "generator": _generator,
    "motor": _motor,
    "supply": partial(_motor, by_supply=True),
}


class EndedBefore(RuntimeError):
    """A run that had ended, or was off, before it was to end badly."""


class Terminal:
    """A run at a terminal of its own, which reads what is written unless it is stopped."""

    def __init__(self, bench: Bench, out: Path, *more: str) -> None:
        ours, theirs = pty.openpty()
        arguments = ["run", bench.scenario, "--bench", bench.file, "--out", out, *more]
        self.run = subprocess.Popen(  # noqa: S603
            [sys.executable, "-c", _NAMED, *map(str, arguments)],
            cwd=ROOT,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=os.environ | {"TERM": "xterm", "COLUMNS": "100", PORT_VARIABLE: "0", _TRY: out.name},
        )
        self._out, self._ours, self._theirs, self.shown = out.name, ours, theirs, b""
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def stop_reading(self, stopped: bool) -> None:
        """What Ctrl-S and Ctrl-Q do."""
        termios.tcflow(self._theirs, termios.TCOOFF if stopped else termios.TCOON)

    def enter(self) -> None:
        os.write(self._ours, b"\n")

    def close(self) -> None:
        self.run.kill()
        self.run.wait()
        for each in psutil.process_iter():  # what goes on to switch off is held by nothing here any more
            with suppress(psutil.Error):
                if each.environ().get(_TRY) == self._out:
                    each.kill()
        os.close(self._theirs)
        self._reading.join(1.0)
        os.close(self._ours)

    def _read(self) -> None:
        with suppress(OSError):
            while data := os.read(self._ours, 4096):
                self.shown += data


def _family(pid: int) -> list[psutil.Process]:
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).children(recursive=True)
    return []


def _await(holds: Callable[[], object], within_s: float) -> bool:
    """Whether it came to hold."""
    until_s = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.002)
    return True


def _require(holds: Callable[[], object], terminal: Terminal) -> None:
    """Wait until it holds; raises where the run ends before."""
    _await(lambda: holds() or terminal.run.poll() is not None, _PATIENCE_S)
    if not holds():
        raise EndedBefore(terminal.shown.decode(errors="replace"))


def _since(bench: Bench, from_ns: int, terminal: Terminal) -> float:
    """Seconds from then to the off; infinite where none comes. Raises where it was off before."""
    _await(bench.safe_ns, _TOO_LONG_S)
    safe_ns = bench.safe_ns()
    if safe_ns is not None and safe_ns < from_ns:
        raise EndedBefore(f"it was off before: {terminal.shown.decode(errors='replace')}")
    return float("inf") if safe_ns is None else (safe_ns - from_ns) / NS_PER_S


def _limit(bench: Bench, terminal: Terminal, folder: Path, rng: Random) -> dict[str, float]:
    _require(lambda: b"recording" in terminal.shown, terminal)
    terminal.stop_reading(True)
    time.sleep(rng.uniform(0.5, 1.0))
    (folder / "struck").touch()
    _await(bench.safe_ns, _PATIENCE_S)
    terminal.stop_reading(False)
    terminal.run.wait(_PATIENCE_S)
    (log,) = folder.glob("*.mcap")
    with LogReader(log) as reader:
        for _, block in reader.blocks("measured", [bench.struck]):
            above = np.flatnonzero(block.values > STRIKE / 2)
            if len(above):
                passed_ns = block.time_ns + round(int(above[0]) / block.sample_rate * NS_PER_S)
                return {"limit": _since(bench, passed_ns, terminal)}
    raise RuntimeError(f"{log}: it was never struck")


def _killed(bench: Bench, terminal: Terminal, folder: Path, rng: Random) -> dict[str, float]:
    terminal.run.kill()
    return {"killed": _since(bench, time.time_ns(), terminal)}


def _frozen(bench: Bench, terminal: Terminal, folder: Path, rng: Random) -> dict[str, float]:
    terminal.run.send_signal(signal.SIGSTOP)
    return {"frozen": _since(bench, time.time_ns(), terminal)}


def _stop(bench: Bench, terminal: Terminal, folder: Path, rng: Random) -> dict[str, float]:
    frozen = "inverter" not in bench.instruments and rng.random() < 0.5
    if frozen:
        terminal.run.send_signal(signal.SIGSTOP)
    pressed_ns = time.time_ns()
    bench.press()
    return {f"emergency stop{', run frozen' if frozen else ''}": _since(bench, pressed_ns, terminal)}


def _thread(bench: Bench, terminal: Terminal, folder: Path, rng: Random) -> dict[str, float]:
    pid = terminal.run.pid
    named: dict[bool, list[tuple[int, str]]] = {True: [], False: []}
    for each in psutil.Process(pid).threads():
        comm = Path(f"/proc/{pid}/task/{each.id}/comm").read_text().strip()
        name = "main" if each.id == pid else comm
        named[name in _GUARDS].append((each.id, name))
    thread, name = rng.choice(named[rng.random() < 0.5])
    ptrace = ctypes.CDLL(None, use_errno=True).ptrace
    if ptrace(_PTRACE_SEIZE, thread, None, None) or ptrace(_PTRACE_INTERRUPT, thread, None, None):
        raise OSError(ctypes.get_errno(), f"cannot hold thread {thread} ({name})")
    held_ns = time.time_ns()
    try:
        if name in _GUARDS or _await(bench.safe_ns, 1.5):
            return {f"{name} held": _since(bench, held_ns, terminal)}
        struck_ns = time.time_ns()
        (folder / "struck").touch()
        return {f"{name} held: limit after": _since(bench, struck_ns, terminal)}
    finally:
        os.kill(pid, signal.SIGKILL)  # Popen takes a main thread that is held for one that has ended
        while os.WIFSTOPPED(os.waitpid(thread, _ANY_THREAD)[1]):
            pass  # a zombie otherwise, and the run would never end


def _lost(bench: Bench, terminal: Terminal, folder: Path, rng: Random) -> dict[str, float]:
    name, how = rng.choice(list(bench.instruments)), rng.choice([signal.SIGKILL, signal.SIGSTOP])
    pid = bench.instruments[name].pid
    os.kill(pid, how)
    lost_ns = time.time_ns()
    _await(lambda: terminal.run.poll() is not None, _TOO_LONG_S)
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)  # what drives is switched off for as long as it does not answer
    terminal.run.wait(_PATIENCE_S)
    (log,) = folder.glob("*.mcap")
    with LogReader(log) as reader:
        noticed_ns = next(event.time_ns for event in reader.events() if event.code == STOPPING)
    what, noticed_s = (
        f"{name} {'lost' if how == signal.SIGKILL else 'frozen'}",
        (noticed_ns - lost_ns) / NS_PER_S,
    )
    # off first, written down after; what drives and is gone tells nobody what it does, only what it is told
    if name in _ACTUATORS:
        told_ns = next((at for at in bench.told_off_ns if at >= lost_ns), None)
        safe_s = float("inf") if told_ns is None else (told_ns - lost_ns) / NS_PER_S
    else:
        safe_s = _since(bench, lost_ns, terminal)
    after = "told off after" if name in _ACTUATORS else "safe after"
    return {f"{what}: noticed": noticed_s, f"{what}: {after}": max(safe_s - noticed_s, 0.0)}


def _viewer(bench: Bench, terminal: Terminal, folder: Path, rng: Random) -> dict[str, float]:
    _require(lambda: b"recording" in terminal.shown, terminal)
    viewers = [each for each in _family(terminal.run.pid) if each.name() in _VIEWERS]
    assert len(viewers) == len(_VIEWERS)
    for viewer in viewers:
        viewer.kill()
    time.sleep(1.0)
    terminal.run.send_signal(signal.SIGINT)
    terminal.run.wait(_PATIENCE_S)
    (log,) = folder.glob("*.mcap")
    if wrong := discrepancies(log, sent_in(folder)):
        raise RuntimeError("; ".join(wrong))
    with LogReader(log) as reader:
        gaps = [gap for gap in reader.gaps() if gap.origin == "measured" and gap.cause != STOPPED]
    return {"viewer killed: samples lost": float(sum(gap.count for gap in gaps))}


WAYS = {
    "limit": _limit,
    "stop": _stop,
    "killed": _killed,
    "frozen": _frozen,
    "thread": _thread,
    "lost": _lost,
    "viewer": _viewer,
}
_ANY_MOMENT = ("stop", "killed", "frozen", "thread", "lost")
BARS = {
    "limit": 0.15,
    "emergency stop": 0.15,
    "emergency stop, run frozen": 0.15,
    "noticed": 1.0,
    "safe after": 0.2,
    "told off after": 0.2,
    "samples lost": 0.0,
}
"""Of the 99th percentile; 1 s for whatever is not named."""
MOST_BEFORE = 1 / 20
_ANY = "any thread held"


def once(drive: str, way: str, rng: Random) -> dict[str, float]:
    """Seconds of one try, or how many were lost, by what they are."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        if way == "viewer":
            os.environ[TRUTH_FOLDER] = str(folder)
            stack.callback(os.environ.pop, TRUTH_FOLDER)
        bench = stack.enter_context(DRIVES[drive](folder, way))
        terminal = Terminal(bench, folder, *(["--live"] if way == "viewer" else []))
        stack.callback(terminal.close)
        if way == "viewer":
            _require(lambda: b"armed" in terminal.shown, terminal)
            terminal.enter()
        _require(lambda: bench.drives, terminal)
        if way in _ANY_MOMENT:
            most_s, recording = rng.choice([(_AT_ONCE_S, False), (_AFTER_S, False), (_AFTER_S, True)])
            if recording:
                _require(lambda: b"recording" in terminal.shown, terminal)
            time.sleep(rng.uniform(0.0, most_s))
        return WAYS[way](bench, terminal, folder, rng)


def tries_of(
    drive: str, way: str, tries: int, rng: Random, beside: int
) -> tuple[dict[str, list[float]], int]:
    """Of so many tries that came so far: seconds by what they are; and how many ended before and did not."""
    found: dict[str, list[float]] = {}
    before, most = 0, max(1.0, MOST_BEFORE * tries)

    def one(seed: float) -> dict[str, float] | None:
        try:
            return once(drive, way, Random(seed))  # noqa: S311
        except EndedBefore as error:
            last = _STYLE.sub("", str(error)).strip().splitlines()[-1:]
            print(f"{drive} {way}: ended before: {''.join(last)}", flush=True)
            return None

    with ThreadPoolExecutor(beside) as pool:
        while tries:
            for each in list(pool.map(one, [rng.random() for _ in range(tries)])):
                before += each is None
                tries -= each is not None
                for what, seconds in (each or {}).items():
                    found.setdefault(what, []).append(seconds)
                if before > most:
                    raise RuntimeError(f"{before} runs ended before they were to")
    return found, before


def _of_99(all_s: Sequence[float]) -> float:
    return float(np.quantile(all_s, 0.99, method="inverted_cdf"))


def held(all_s: Sequence[float], bar_s: float) -> bool:
    """Whether all but one in a hundred are within a bar, and that one is safe at all; all, where it is 0."""
    return _of_99(all_s) <= bar_s and max(all_s) <= (_TOO_LONG_S if bar_s else 0.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("ways", nargs="*", default=list(WAYS), metavar="way", help=", ".join(WAYS))
    parser.add_argument("--drives", nargs="+", choices=DRIVES, default=["generator", "motor"])
    parser.add_argument(
        "--tries", type=int, default=0, help="of each; 100, and 200 of `limit` and `stop`, if not said"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--beside", type=int, default=1, help="tries at a time; each is a busy neighbour then"
    )
    arguments = parser.parse_args()
    rng, met = Random(arguments.seed), True  # noqa: S311
    for way in arguments.ways:
        for drive in arguments.drives:
            tries = arguments.tries or (200 if way in ("limit", "stop") else 100)
            found, before = tries_of(drive, way, tries, rng, 1 if way == "viewer" else arguments.beside)
            if before:
                print(f"{drive:9} {way}: {before} more ended before they were to, and were tried again")
            if way == "thread":  # few tries each: by their middles, and as the hundred together
                found[_ANY] = [each for all_s in found.values() for each in all_s]
            for what, all_s in sorted(found.items()):
                bar_s = BARS.get(what.split(": ")[-1], 1.0)
                p99_s = _of_99(all_s)
                few = way == "thread" and what != _ANY
                met &= bool(np.median(all_s) <= bar_s) if few else held(all_s, bar_s)
                print(
                    f"{drive:9} {what:36} {len(all_s):4} tries: median {np.median(all_s):.3f}, "
                    f"99 % within {p99_s:.3f} (bar {bar_s:g}), worst {max(all_s):.3f}",
                    flush=True,
                )
    return int(not met)


if __name__ == "__main__":
    raise SystemExit(main())

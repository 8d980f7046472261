"""An inverter on a bad line: does it keep its speed or stop safely, and is a wrong value ever believed.

The driver talks to the emulated FR-D700 in its own process, on TCP or on a pty. Once the motor has its speed,
a share of the answers is lost or corrupted, each seed in its own order, until the motor has been told to stop
and the driver is closed. What the drive puts out comes from the emulator by another way; speed, standstill
and every state that the driver believed are held against it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.connection import Connection

from daq.errors import InstrumentError
from drivers.mitsubishi_fr.emulator.drive import NO_LOAD_A, InverterSetup
from drivers.mitsubishi_fr.emulator.line_faults import KINDS, LineFaults
from drivers.mitsubishi_fr.emulator.process import InverterWiring, start_inverter
from drivers.mitsubishi_fr.inverter import FrInverter
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.protocols.speed_drive import MotorOutput, MotorState

ASKED_RPM, RPM_PER_HZ = 200.0, 30.0
SET_HZ = 6.67  # as the drive keeps it, in steps of 0.01 Hz
VOLTS_PER_HZ = 200.0 / 60.0
HELD = 0.01
LOST_OR_CORRUPTED = ("drop", "flip")
LINES = {
    "1 % lost or corrupted": (0.01, LOST_OR_CORRUPTED),
    "20 % lost or corrupted": (0.2, LOST_OR_CORRUPTED),
    "20 %, every kind of fault": (0.2, tuple(KINDS)),
}
MUST_HOLD = "1 % lost or corrupted"
LOOK_S = 5.0  # no look of the driver takes longer: what a state says was so at some time within it
REST_S = 8.0  # watchdog 2 s, three attempts at a stop of 1 s each, ramp 0.06 s, and a busy machine
SETTINGS = InverterSettings(RPM_PER_HZ, 300.0)


@dataclass(slots=True)
class Truth:
    """What the emulated drive put out, by a connection of its own."""

    source: Connection
    outputs: list[MotorOutput] = field(default_factory=list)

    def at(self, time_s: float) -> float:
        """Output frequency in Hz."""
        self._update()
        before = [output for output in self.outputs if output.started_s <= time_s]
        return before[-1].at(time_s) if before else 0.0

    def range_hz(self, from_s: float, to_s: float) -> tuple[float, float]:
        """Least and greatest output frequency within a time: at its ends and where a ramp begins or ends."""
        self._update()
        knees = [knee for output in self.outputs for knee in (output.started_s, output.settled_s)]
        found = [self.at(knee) for knee in (from_s, to_s, *knees) if from_s <= knee <= to_s]
        found += [output.level for output in self.outputs if from_s < output.started_s <= to_s]
        return min(found), max(found)

    def await_hz(self, hz: float, within_s: float) -> bool:
        """Wait until it is at a frequency and stays there."""
        deadline_s = time.monotonic() + within_s
        while self.at(time.monotonic()) != hz or self.outputs[-1].target != hz:
            if time.monotonic() > deadline_s:
                return False
            time.sleep(0.01)
        return True

    def _update(self) -> None:
        with suppress(EOFError, OSError):
            while self.source.poll():
                self.outputs.append(self.source.recv())


@dataclass(frozen=True, slots=True)
class Outcome:
    """How one seed ended. `error` is the largest of the speed before it was told to stop, 1.0 for 100 %."""

    seed: int
    error: float
    reason: str
    at_rest: bool
    believed: int
    wrong: tuple[str, ...]
    asked: int
    unanswered: int

    @property
    def held(self) -> bool:
        return not self.reason and self.error <= HELD and self.at_rest

    @property
    def stopped_safely(self) -> bool:
        return self.reason != "" and self.at_rest


class Witness:
    """Notes every state that a driver believes, in a thread of its own."""

    def __init__(self, inverter: FrInverter) -> None:
        self._inverter, self._ended = inverter, threading.Event()
        self.states: list[MotorState] = []
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> Witness:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._ended.wait(0.002):
            state = self._inverter.state
            if state is not None and (not self.states or state is not self.states[-1]):
                self.states.append(state)


def differences(state: MotorState, truth: Truth, since_s: float, told_to_stop_s: float) -> list[str]:
    """What of a state was not so at any time of the look that it came from, which began after `since_s`.

    The drive rounds to 0.01 Hz and 0.1 V: half of that, and 1e-9 for the arithmetic, is no difference.
    """
    low_hz, high_hz = truth.range_hz(max(state.at_s - LOOK_S, since_s), state.at_s)
    stands = low_hz == 0.0
    set_hz = (SET_HZ,) if state.at_s < told_to_stop_s else (SET_HZ, 0.0)
    right = {
        "output frequency": _within(state.output_frequency_hz, low_hz, high_hz, 0.005),
        "speed": _within(state.speed_rpm, low_hz * RPM_PER_HZ, high_hz * RPM_PER_HZ, 0.005 * RPM_PER_HZ),
        "voltage": _within(state.output_voltage_v, low_hz * VOLTS_PER_HZ, high_hz * VOLTS_PER_HZ, 0.05),
        "current": abs(state.output_current_a - NO_LOAD_A) < 1e-9 or (stands and not state.output_current_a),
        "set value": any(abs(state.set_rpm - hz * RPM_PER_HZ) < 1e-9 for hz in set_hz),
        "running": state.running or stands,
        "fault": state.fault == "" or stands,
    }
    return [f"{name} of {state}" for name, is_right in right.items() if not is_right]


def _within(value: float, low: float, high: float, rounding: float) -> bool:
    return low - rounding - 1e-9 <= value <= high + rounding + 1e-9


def one(
    seed: int,
    share: float,
    kinds: tuple[str, ...],
    seconds: float,
    on_pty: bool = False,
    patience: float = 1.0,
) -> Outcome:
    """Run, disturb, stop and close a drive; its answers may take `patience` times as long as by default."""
    with _emulated(on_pty) as (port, rehearsal, truth):
        settings = replace(
            SETTINGS,
            port=port,
            parity="N" if on_pty else "E",
            answer_s=SETTINGS.answer_s * patience,
            silent_s=SETTINGS.silent_s * patience,
        )
        inverter = FrInverter(settings)
        inverter.open()
        try:
            inverter.set_speed(ASKED_RPM)
            inverter.start()
            assert truth.await_hz(SET_HZ, 10.0)
            since_s = time.monotonic()
            time.sleep(0.5)  # the looks that began on the ramp have ended
            with Witness(inverter) as witness:
                rehearsal.send(LineFaults(share, kinds, seed))
                began_s = time.monotonic()
                told_s, reason = _hold(inverter, seconds)
                with suppress(InstrumentError):
                    inverter.stop()
                health = inverter.health
        finally:
            inverter.close()
        at_rest = truth.await_hz(0.0, REST_S)
        assert health is not None
        states = [state for state in witness.states if state.at_s > began_s]
        stopped_s = told_s if not reason else began_s  # by itself, at a time that only it knows
        wrong = [text for state in states for text in differences(state, truth, since_s, stopped_s)]
        error = max(abs(hz * RPM_PER_HZ / ASKED_RPM - 1.0) for hz in truth.range_hz(began_s, told_s))
        counts = (len(states), tuple(wrong), health.asked, health.unanswered)
        return Outcome(seed, error, reason, at_rest, *counts)


def _hold(inverter: FrInverter, seconds: float) -> tuple[float, str]:
    """Look after a motor that runs; until when, and why it was stopped, empty where it was not."""
    end_s = time.monotonic() + seconds
    while True:
        now_s = time.monotonic()
        try:
            inverter.check()
        except InstrumentError as error:
            return now_s, str(error)
        if now_s >= end_s:
            return now_s, ""
        with suppress(InstrumentError):  # what is the matter with one look, `check` knows
            inverter.read()
        time.sleep(0.02)


@contextmanager
def _emulated(on_pty: bool) -> Iterator[tuple[str, Connection, Truth]]:
    context = multiprocessing.get_context("spawn")
    outputs, their_outputs = context.Pipe(duplex=False)
    their_rehearsal, rehearsal = context.Pipe(duplex=False)
    # 60 Hz in 0.5 s and a watchdog of 2 s; no pty keeps a parity.
    setup = InverterSetup({7: 5, 8: 5, 122: 20, 120: 0 if on_pty else 2})
    wiring = InverterWiring(their_outputs, None, their_rehearsal)
    with outputs, rehearsal, start_inverter(wiring, setup) as emulator:
        their_outputs.close()
        their_rehearsal.close()
        yield emulator.addresses[int(on_pty)], rehearsal, Truth(outputs)


def main() -> int:
    arguments = _arguments()
    wire = "a pty" if arguments.pty else "TCP"
    print(
        f"{arguments.seeds} seeds each, {arguments.seconds:g} s at {ASKED_RPM:g} rpm, then a stop, on {wire}"
    )
    good = True
    with ThreadPoolExecutor(arguments.at_once) as pool:
        for name, (share, kinds) in LINES.items():
            work = partial(one, share=share, kinds=kinds, seconds=arguments.seconds, on_pty=arguments.pty)
            seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
            good &= _report(name, list(pool.map(work, seeds)))
    print(f"every bar met: {'yes' if good else 'no'}")
    return 0 if good else 1


def _report(name: str, outcomes: list[Outcome]) -> bool:
    held = [outcome for outcome in outcomes if outcome.held]
    stopped = [outcome for outcome in outcomes if outcome.stopped_safely]
    wrong = [text for outcome in outcomes for text in outcome.wrong]
    asked, unanswered = (sum(getattr(each, of) for each in outcomes) for of in ("asked", "unanswered"))
    worst = max((outcome.error for outcome in held), default=0.0)
    print(
        f"{name}: held within 1 % {len(held)} (worst {worst:.2%}), stopped safely {len(stopped)}, "
        f"neither {len(outcomes) - len(held) - len(stopped)}; wrong values in {len(wrong)} of "
        f"{sum(each.believed for each in outcomes)} states; {unanswered} of {asked} requests unanswered",
        flush=True,
    )
    for outcome in outcomes:
        if not outcome.held:
            rest = "at rest" if outcome.at_rest else "NOT AT REST"
            print(f"  seed {outcome.seed}: {rest}, speed off by {outcome.error:.2%}; told: {outcome.reason}")
    for text in wrong:
        print(f"  wrong: {text}")
    enough = held if name == MUST_HOLD else held + stopped
    return len(enough) == len(outcomes) and not wrong


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=10.0, help="on the bad line, before the stop")
    parser.add_argument("--pty", action="store_true", help="a serial port in place of TCP")
    parser.add_argument("--at-once", type=int, default=4, help="drives at once; each waits most of the time")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())

"""What a log gets besides samples: its name and origin, events, and how the clocks lie."""

from __future__ import annotations

import datetime
import hashlib
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from daq.block import NS_PER_S
from daq.clock import Clock
from daq.disk import make_folder
from daq.errors import RecorderFailed, show_fault
from daq.log.records import CALIBRATED, ClockRecord, Event, Gap, Impact
from daq.recorder import Recorder
from daq.time_base.run_clock import RunClock
from drivers.protocols.instrument import Notice
from rig.files.bench import Bench
from rig.files.software import software
from rig.session.devices import Devices
from rig.session.progress import Screen
from rig.stream import Block, Consumer, Metadata, Record, Stream
from rig.twin.chains import CHAIN, declared_by

_LONGEST_NAME = 60
_EVERY_S = 1.0
_JOIN_S = 5.0  # nothing moves any more


def new_log(folder: Path, name: str, clock: Clock) -> Path:
    """A log whose stem, the run's id, is of its scenario and the time; makes `folder` if needed."""
    started = _now(clock)
    plain = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:_LONGEST_NAME] or "run"
    run_id = f"{plain}_{started:%Y%m%d-%H%M%S}-{started.microsecond // 1000:03d}"
    try:
        make_folder(folder)
    except OSError as error:
        raise RecorderFailed(f"cannot make {folder}: {error.strerror}") from error
    return folder / f"{run_id}.mcap"


def run_record(
    bench: Bench, devices: Devices, notes: Mapping[str, str], run_id: str, clock: Clock
) -> dict[str, str]:
    """The log's `run` record: identity, time, software, digests of what the run depended on, and `notes`."""
    calibration = [
        f"{c.name} {c.serial} {c.sensitivity} {c.gain} {c.calibrated} {c.valid_until}"
        for c in bench.daq_card.channels
    ]
    sensors = declared_by(bench, devices.card.sample_rate)
    calibration += [f"{key} {sensors[key]}" for key in sorted(sensors) if key.startswith(CHAIN)]
    for c in bench.daq_card.channels:
        if c.calibrated:
            until = f", valid until {c.valid_until}" if c.valid_until else ""
            sensors[CALIBRATED + c.name] = f"{c.calibrated}{until}"
    beside = {} if devices.encoder is None else {"encoder": devices.encoder.identity}
    beside |= {f"instrument.{table}": logger.identity for table, logger in devices.loggers.items()}
    return {
        "id": run_id,
        "started": f"{_now(clock):%Y-%m-%dT%H:%M:%S.%fZ}",
        **software(),
        "bench": bench.source,
        "bench_sha256": _digest(bench.text),
        "calibration_sha256": _digest("\n".join(calibration)),
        "actuator": devices.actuator.identity,
        "card": devices.card.address,
        **beside,
        **sensors,
        **notes,
    }


def _now(clock: Clock) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(clock.unix_ns() / NS_PER_S, datetime.UTC)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def logged_by(recorder: Recorder) -> Consumer:
    """Everything but shapes goes to the log: it holds what was measured and what follows from that."""

    def log(record: Record) -> None:
        match record:
            case Block(origin, samples):
                recorder.block(origin, samples)
            case Impact():
                recorder.impact(record)
            case Event():
                recorder.event(record)
            case Gap():
                recorder.gap(record)
            case ClockRecord():
                recorder.clock_record(record)
            case Metadata(name, values):
                recorder.metadata(name, values)

    return log


class Logbook:
    """Writes what is told, and once a second what `events` and `clocks` have to say.

    `events` gives what devices did since it was last asked, `clocks(at_last)` records where there is news: in
    a thread, for beside much else a fit may take many times as long, and a sequence that looks at nothing
    meanwhile is taken for dead. What is no mere information also goes to the screen. Leaving its context
    writes what is left; a log that takes nothing more is then no second error.
    """

    def __init__(self, clock: RunClock, stream: Stream, screen: Screen) -> None:
        self._clock, self._stream, self._screen = clock, stream, screen
        self._looked_s = clock.monotonic_s()
        self.events: list[Callable[[], tuple[Event, ...]]] = []
        self.clocks: list[Callable[[bool], list[ClockRecord]]] = []
        self._left = threading.Event()
        self._thread = threading.Thread(target=self._fit_clocks, name="clocks", daemon=True)
        self._failed: RecorderFailed | None = None

    def tell(self, level: str, code: str, text: str) -> None:
        self._stream(Event(self._clock.unix_ns(), level, "rig", code, text))

    def stamped(self, source: str, notices: Iterable[Notice]) -> tuple[Event, ...]:
        """Events of what an instrument told by the monotonic clock, at the run's time."""
        return tuple(
            Event(self._clock.at_ns(told.arrival_s), told.level, source, told.code, told.text)
            for told in notices
        )

    def note(self, event: Event) -> None:
        """Write down what a device or worker has to say."""
        self._stream(event)
        if event.level != "info":
            self._screen.warn(f"{event.source}: {event.text}")

    def look(self) -> None:
        """Ask for news, if the last time was a second ago; raises RecorderFailed."""
        if self._failed is not None:
            raise self._failed
        if self._clock.monotonic_s() - self._looked_s >= _EVERY_S:
            self._looked_s = self._clock.monotonic_s()
            self._ask()

    def __enter__(self) -> Logbook:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._left.set()
        self._thread.join(_JOIN_S)
        try:
            self._ask()
            self._tell_clocks(at_last=True)
        except RecorderFailed:
            if error is None:
                raise

    def _ask(self) -> None:
        set_by_somebody = self._clock.look()
        told = () if set_by_somebody is None else (set_by_somebody,)
        for event in (*told, *(event for ask in self.events for event in ask())):
            self.note(event)

    def _tell_clocks(self, at_last: bool) -> None:
        for clocks in tuple(self.clocks):
            try:
                records = clocks(at_last)
            except RecorderFailed:  # steps of a clock go to the log, too
                raise
            except Exception as error:  # a fault of ours; but where a clock lies moves no sample
                self.clocks.remove(clocks)
                told = f"how a clock lies is told no more: {type(error).__name__}: {error}"
                self.note(Event(self._clock.unix_ns(), "warning", "rig", "clock.not_fitted", told))
                show_fault(error)
                continue
            for record in records:
                self._stream(record)

    def _fit_clocks(self) -> None:
        try:
            while not self._left.wait(_EVERY_S):
                self._tell_clocks(at_last=False)
        except RecorderFailed as error:
            self._failed = error

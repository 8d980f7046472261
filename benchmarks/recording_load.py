"""Sixteen channels or more from the emulated card to the log, twin, live view and derived channels on.

Runs `rattle run --live` as a user would and watches its processes from outside: samples lost, blocks that the
view dropped, processor time, memory. With `--channels 64` the bench is made for it: the five channels of the
impact beam and accelerometers along it, or with `--crank` the five of the planar crank and accelerometers of
its bed, beside an encoder on CAN at 1 kHz and an inverter that is read at 20 Hz. Of an hour what each process
keeps is told by itself (`benchmarks.in_use`) and has to grow by less than 1 MB/h, known better than to that;
its resident memory moves by more, and has to grow by less than 60 MB/h.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
from numpy.typing import NDArray

from benchmarks.in_use import told as told_of
from benchmarks.in_use import told_into
from daq.log.reader import LogReader
from daq.log.recover import verify_log
from drivers.emulator_truth import TRUTH_FOLDER
from rig.live.page_server import PORT_VARIABLE
from tests.accounting import discrepancies, sent_in
from tests.accounting_by_pieces import PIECE_S, discrepancies_by_pieces

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "impact_beam_sixteen_channels.toml"
BENCH = ROOT / "scenarios" / "sixteen_channels.bench.toml"
SAMPLE_RATE_HZ = 51_200
EVERY_S = 2.0
_AN_HOUR_S, MOST_MB_AN_HOUR, MOST_RESIDENT_MB_AN_HOUR = 3600.0, 1.0, 60.0
_SLOPE_S = 1800.0
"""Of a shorter run memory has no slope: what is taken into use once would be one of GB/h."""
MIB = 1 << 20
MOST_CPU = {16: 0.5}
"""Share of a core that the acquisition process may take, by channels; one core where nothing is said."""
MOST_MIB = {16: 400}
_INPUTS = 4
_STATIONS = range(5, 97)
_ACCELEROMETER = """
[[daq_card.channels]]
name = "{location}.acceleration_{station:02d}"
physical = "cDAQ1Mod{module}/ai{number}"
kind = "acceleration_iepe"{not_modelled}
sensitivity = "10 mV/g"
range = "400 g"
serial = "EMU-{serial}"
calibrated = 2026-05-04
valid_until = 2036-05-04
"""
_STALL = """
[emulation]
faults = [{faults}]
"""
CRANK = ROOT / "scenarios" / "planar_slider_crank.toml"
_CRANK_BENCH = ROOT / "rig" / "rigs" / "planar_slider_crank.toml"
_ON_CAN = """
[encoder]
driver = "canopen_cia406"
interface = "socketcand"
channel = "can0"
node = 7
period = "1 ms"
emulated = true
"""
_READ_AT_20_HZ = 'rpm_per_hz = 5.0\npoll = "50 ms"'
_STALLS_EVERY_S = 300.0
_BUSY_S, _IDLE_S = 2.0, 18.0
_RATES_HZ = {"encoder": 1000.0}
_COMPARED_S = 120.0
"""Records up to this are compared at once with what the emulators kept of what they sent, a MB a second on
the disk; longer ones piece by piece."""
_MOST_TOLD = 10
VIEWER = "viewer's server"
"""Not ours: it keeps what it shows, up to the memory that it is given."""
_LOOKED_AT_S = 60.0
"""Longer than a stall, and what it leaves to be caught up with: the least of it is what a process keeps."""
_FEWEST, _TOLD_EVERY = 20, 5
"""Minutes by which a line and its deviation can be told; between two that are printed."""
_NOT_STEADY = 1 / 3
"""Of the record, at its begin, in which memory is still taken into use."""


@dataclass(slots=True)
class Watched:
    """CPU (share of a core) and memory (MiB) of each process in each stretch of 2 s.

    `own`, with when that was (s of the record, MB): without pages of files, which the system takes away and
    reads again as it likes. `in_use`, the same of a long run alone: what Python and glibc have handed out and
    not got back.
    """

    cpu: dict[str, list[float]] = field(default_factory=dict)
    rss: dict[str, list[float]] = field(default_factory=dict)
    own: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    in_use: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    code: int = 0
    """With which the run ended."""


def main() -> int:
    arguments = _arguments()
    print(f"load before the run       {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder, _neighbour() if arguments.neighbour else nullcontext():
        scenario = Path(folder) / "scenario.toml"
        text = (CRANK if arguments.crank else SCENARIO).read_text()
        text = re.sub(r'sample_rate = ".*"', f'sample_rate = "{SAMPLE_RATE_HZ} Hz"', text)
        scenario.write_text(re.sub(r'duration = ".*"', f'duration = "{arguments.seconds:g} s"', text))
        bench = Path(folder) / "bench.toml"
        times = (
            np.arange(3.0, arguments.seconds - arguments.stall, _STALLS_EVERY_S) if arguments.stall else ()
        )
        faults = ", ".join(f'"disk.stalls@{at:g}:for={arguments.stall:g}"' for at in times)
        of_bench = _crank_bench(arguments.channels) if arguments.crank else _beam_bench(arguments.channels)
        bench.write_text(of_bench + _STALL.format(faults=faults))
        command = [sys.executable, "-m", "rig.start", "run", str(scenario), "--bench", str(bench)]
        command += ["--out", folder] + (["--live"] if not arguments.no_live else [])
        os.environ[PORT_VARIABLE] = "0"
        os.environ[TRUTH_FOLDER] = folder
        watched = _watch(command, arguments.seconds, folder)
        return _report(list(Path(folder).glob("*.mcap")), watched, arguments.seconds, arguments.channels)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--channels", type=int, default=16)
    parser.add_argument("--crank", action="store_true", help="the planar crank, with CAN and inverter")
    parser.add_argument(
        "--stall",
        type=float,
        default=0.0,
        help=f"s for which the disk takes nothing, every {_STALLS_EVERY_S:g} s",
    )
    parser.add_argument(
        "--neighbour", action="store_true", help=f"a process that takes a core for {_BUSY_S:g} s now and then"
    )
    parser.add_argument("--no-live", action="store_true")
    return parser.parse_args()


@contextmanager
def _neighbour() -> Iterator[None]:
    code = f"import time\nwhile True:\n end = time.monotonic() + {_BUSY_S}\n"
    code += f" while time.monotonic() < end: pass\n time.sleep({_IDLE_S})\n"
    with subprocess.Popen([sys.executable, "-c", code]) as busy:  # noqa: S603 - our own
        try:
            yield
        finally:
            busy.kill()


def _beam_bench(channels: int) -> str:
    """The bench of sixteen channels with as many accelerometers as are asked for."""
    if channels == 16:
        return BENCH.read_text()
    head, *tables = BENCH.read_text().split("[[daq_card.channels]]")
    kept = [table for table in tables if "beam.acceleration" not in table]
    count = channels - len(kept)
    stations = [_STATIONS[number * len(_STATIONS) // count] for number in range(count)]
    return "[[daq_card.channels]]".join([head, *kept]) + _accelerometers(stations, "beam")


def _crank_bench(channels: int) -> str:
    """The bench of the planar crank with accelerometers that no twin predicts beside its own channels."""
    bench = _CRANK_BENCH.read_text().replace("rpm_per_hz = 5.0", _READ_AT_20_HZ) + _ON_CAN
    places = range(channels - bench.count("[[daq_card.channels]]"))
    return bench + _accelerometers(places, "bed", "\nmodelled = false")


def _accelerometers(places: Iterable[int], location: str, more: str = "") -> str:
    return "".join(
        _ACCELEROMETER.format(
            location=location,
            station=place,
            not_modelled=more,
            module=4 + number // _INPUTS,
            number=number % _INPUTS,
            serial=400 + number,
        )
        for number, place in enumerate(places)
    )


def _watch(command: list[str], seconds: float, folder: str) -> Watched:
    memory = Path(tempfile.mkdtemp(dir=folder))
    variables = os.environ | (told_into(memory, EVERY_S) if seconds >= _SLOPE_S else {})
    run = subprocess.Popen(  # noqa: S603 - our own
        command, cwd=ROOT, env=variables, stdout=subprocess.PIPE, text=True
    )
    assert run.stdout is not None
    for line in run.stdout:
        print(line, end="")
        if line.startswith("recording"):
            break
    process = psutil.Process(run.pid)
    processes = [process, *process.children(recursive=True)]
    names = {each.pid: _name(each, run.pid) for each in processes}
    watched = Watched()
    for name in names.values():
        watched.cpu[name], watched.rss[name], watched.own[name] = [], [], []
    begun = at = time.monotonic()
    before, end = [_seconds(each) for each in processes], begun + seconds
    while at + EVERY_S < end and run.poll() is None:
        time.sleep(EVERY_S)
        now, elapsed = [_seconds(each) for each in processes], time.monotonic() - at
        for each, used, earlier in zip(processes, now, before, strict=True):
            watched.cpu[names[each.pid]].append(max(used - earlier, 0.0) / elapsed)
            with suppress(psutil.NoSuchProcess):
                watched.rss[names[each.pid]].append(each.memory_info().rss / MIB)
                watched.own[names[each.pid]].append((at + elapsed - begun, _own_mb(each.pid)))
        before, at = now, at + elapsed
    print(run.stdout.read(), end="")
    watched.code = run.wait()
    watched.in_use = {name: told_of(memory, pid, begun, end) for pid, name in names.items()}
    return watched


def _name(process: psutil.Process, acquisition: int) -> str:
    if process.pid == acquisition:
        return "acquisition"
    try:
        line = " ".join(process.cmdline())
    except psutil.Error:
        return f"gone {process.pid}"
    known = {"rerun": VIEWER, "resource_tracker": "resource tracker"}
    named = Path(f"/proc/{process.pid}/comm").read_text().strip()
    return f"{next((name for part, name in known.items() if part in line), named)} {process.pid}"


def _own_mb(pid: int) -> float:
    """Memory of a process that no file holds, swapped or not; raises psutil.NoSuchProcess if it is gone."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError) as error:
        raise psutil.NoSuchProcess(pid) from error
    kib = map(int, re.findall(r"^(?:RssAnon|RssShmem|VmSwap):\s+(\d+)", status, re.MULTILINE))
    return sum(kib) * 1024 / 1e6


def _seconds(process: psutil.Process) -> float:
    try:
        times = process.cpu_times()
    except psutil.NoSuchProcess:
        return 0.0
    return times.user + times.system


def _report(logs: list[Path], watched: Watched, seconds: float, channels: int) -> int:
    if len(logs) != 1 or not any(watched.cpu.values()):
        print(f"nothing was recorded; ended with {watched.code}")
        return 1
    report = verify_log(logs[0])
    with LogReader(logs[0]) as log:
        told = {event.code: event.text for event in log.events() if event.source in ("rig", "derived")}
    counted = [topic for topic in report.topics if topic.topic.startswith(("/measured/", "/predicted/"))]
    missing = sum(topic.missing for topic in counted)
    short = {topic.topic: _short(topic.topic, topic.samples + topic.missing, seconds) for topic in counted}
    unaccounted = sum(short.values())
    measured = sum(topic.topic.startswith("/measured/") and not _beside(topic.topic) for topic in counted)
    derived = sum(topic.samples for topic in report.topics if topic.topic.startswith("/derived/"))
    means = {name: statistics.mean(shares) for name, shares in watched.cpu.items() if shares}
    busiest = max(means, key=lambda name: means[name])
    most_mib = {name: max(rss) for name, rss in watched.rss.items() if rss}
    ours = [name for name in most_mib if not name.startswith(VIEWER)]
    slopes = {name: _slope(watched.in_use[name]) for name in ours}
    resident = {name: _slope(watched.own[name]) for name in ours}
    worst = max(watched.cpu["acquisition"])
    print(f"\nlog                       {logs[0].stat().st_size / MIB:.0f} MiB, sound: {report.sound}")
    print(f"channels                  {measured} of the card; {len(counted)} measured and predicted in all")
    print(f"samples unaccounted       {unaccounted} (missing: {missing}); {derived} derived values")
    wrong, compared = _compared(logs[0], seconds)
    print(f"as the emulators sent it  {compared}")
    print(f"view                      {told.get('view.dropped', 'none')}")
    print(f"derived                   {told.get('derived.stopped', 'all of it')}")
    long = seconds >= _SLOPE_S
    for name, share in sorted(means.items(), key=lambda each: -each[1]):
        print(f"{name:<25} {share:.2f} of a core, {most_mib[name]:.0f} MiB", end="")
        if long and name in slopes:
            least = " ".join(f"{each:.1f}" for each in _least(watched.in_use[name])[1][::_TOLD_EVERY])
            print("; in use {:+.2f} +- {:.2f} MB/h".format(*slopes[name]), f"({least})", end="")
            print("; resident {:+.1f} +- {:.1f} MB/h".format(*resident[name]), end="")
        print()
    print(f"acquisition, worst 2 s    {worst:.2f} of a core")
    print(f"busiest process           {busiest}, {means[busiest]:.2f} of a core")
    print(f"all processes             {sum(means.values()):.2f} cores")
    print(f"load after the run        {os.getloadavg()[0]:.2f}")
    kept = report.sound and not unaccounted and not missing and not wrong and measured == channels
    kept = kept and "derived.stopped" not in told
    gone = [name for name, rss in watched.rss.items() if len(rss) < len(watched.rss["acquisition"])]
    print(f"ended                     with {watched.code}; gone before it: {', '.join(gone) or 'none'}")
    kept = kept and not watched.code and not gone
    within = means["acquisition"] < MOST_CPU.get(channels, 1.0)
    bars = ((slopes, MOST_MB_AN_HOUR), (resident, MOST_RESIDENT_MB_AN_HOUR))
    level = seconds < _AN_HOUR_S or all(
        max(slope, deviation) < bar for each, bar in bars for slope, deviation in each.values()
    )
    return 0 if kept and within and level and most_mib["acquisition"] < MOST_MIB.get(channels, 1500) else 1


def _compared(log: Path, seconds: float) -> tuple[list[str], str]:
    """What of a log is not as the emulators sent it, and what is told of that."""
    if seconds <= _COMPARED_S:
        wrong, all_of_it = discrepancies(log, sent_in(log.parent)), "all"
    else:
        wrong, all_of_it = discrepancies_by_pieces(log, log.parent), f"all, {PIECE_S:g} s at a time"
    more = [f"and {len(wrong) - _MOST_TOLD} more"] if len(wrong) > _MOST_TOLD else []
    return wrong, "; ".join([*wrong[:_MOST_TOLD], *more]) or all_of_it


def _slope(told_mb: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """MB an hour that this has grown by in the last two thirds, and its deviation; NaN where nothing tells.

    By the least of each minute: in a stall a process takes up what waits, and frees it again. Neighbouring
    minutes are alike, by which the deviation is larger (as of an autoregression of first order).
    """
    hours, least = _least(told_mb)
    steady = slice(round(len(least) * _NOT_STEADY), None)
    if len(least[steady]) < _FEWEST or not np.isfinite(least).all():
        return math.nan, math.nan
    (slope, start), scatter = np.polyfit(hours[steady], least[steady], 1, cov=True)
    off = least[steady] - slope * hours[steady] - start
    alike = float(off[1:] @ off[:-1]) / max(float(off @ off), 1e-12)
    alike = min(max((alike * len(off) + 1) / (len(off) - 4), 0.0), 0.99)  # Kendall: of few too low
    return float(slope), math.sqrt(scatter[0, 0] * (1 + alike) / (1 - alike))


def _least(told_mb: Sequence[tuple[float, float]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of each whole minute when it began (h), and the least (MB)."""
    at_s, mb = np.reshape(told_mb, (-1, 2)).T
    whole = int((max(at_s, default=0.0) + 2 * EVERY_S) / _LOOKED_AT_S)
    number = at_s // _LOOKED_AT_S
    least = [mb[number == k].min(initial=math.inf) for k in range(whole)]
    return np.arange(whole, dtype=np.float64) * _LOOKED_AT_S / 3600.0, np.array(least)


def _beside(topic: str) -> float:
    """Samples a second of what is not the card's; 0 of what is."""
    return next((hz for place, hz in _RATES_HZ.items() if topic.split("/")[-1].startswith(place)), 0.0)


def _short(topic: str, samples: int, seconds: float) -> int:
    """How many samples a record lacks; what has a clock of its own may lack the last tenth of a second."""
    if rate_hz := _beside(topic):
        return max(math.floor((seconds - 0.1) * rate_hz) - samples, 0)
    return abs(round(seconds * SAMPLE_RATE_HZ) - samples)


if __name__ == "__main__":
    sys.exit(main())

"""`rattle check`: every fault of a file at once."""

from __future__ import annotations

import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq.errors import ConfigurationError, Problem
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from rig.files.bench import Bench
    from rig.files.scenario import Scenario
    from rig.files.sweep import Sweep


def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A scenario, bench or sweep.")],
    bench_file: Annotated[
        Path | None,
        typer.Option("--bench", metavar="BENCH.toml", help="Check a scenario or sweep on this bench."),
    ] = None,
) -> None:
    from drivers.ni_daq.sensors import SENSORS
    from rig.instruments import INSTRUMENTS
    from rig.rigs import RIGS

    # looks at what other packages add, whether the file asks for it or not
    (len(INSTRUMENTS), len(RIGS), len(SENSORS))
    screen, today = Screen(Terminal()), datetime.datetime.now(datetime.UTC).date()
    sound = _alone(file, today, screen) if bench_file is None else _on_bench(file, bench_file, today, screen)
    where = "" if bench_file is None else f" on {bench_file}"
    screen.say(f"{file}: {type(sound).__name__.lower()}, no faults{where}")


def load_any(path: str | Path) -> Scenario | Bench | Sweep:
    """Read a scenario, bench or sweep file; raises ConfigurationError with every fault in it."""
    from rig.files.bench import parse_bench
    from rig.files.faults import read_toml
    from rig.files.file_kind import kind_of_tables, read_file
    from rig.files.scenario import parse_scenario
    from rig.files.sweep import parse_sweep

    text, source = read_file(path, "scenario", "bench", "sweep"), str(path)
    folder = Path(path).resolve().parent
    match kind_of_tables(read_toml(text, source)):
        case "sweep":
            return parse_sweep(text, source, folder)
        case "scenario":
            return parse_scenario(text, source)
        case "bench":
            return parse_bench(text, source, folder)
    allowed = (
        "a scenario (rig, [model], [drive], [acquisition]), "
        "a bench ([signal_generator], [inverter] or what else drives, [daq_card]) "
        "or a sweep ([sweep], [axes])"
    )
    raise ConfigurationError(source, [Problem("file", "(unknown kind)", allowed)])


def _alone(file: Path, today: datetime.date, screen: Screen) -> Scenario | Bench | Sweep:
    """What a file holds; what only the emulated bench forbids is told as a remark."""
    from rig.files.bench import Bench, embedded_bench
    from rig.files.faults import raised_by
    from rig.files.pairing import check_bench
    from rig.rigs import unit_of

    loaded = load_any(file)
    if isinstance(loaded, Bench):
        check_bench(loaded, today)
        line = loaded.stop_line
        read = "none is read" if line is None else f"{line.line} is read, {line.contact}"
        screen.say(f"emergency stop: {read}")
        if names := [each.name for each in loaded.daq_card.channels if unit_of(each.name) is None]:
            screen.say(f"recorded without a prediction: {', '.join(names)}")
        _remark(loaded, screen)
        return loaded
    _check(loaded, None, str(file), today)
    # Another bench may well allow it: no fault of the scenario.
    for problem in raised_by(lambda: _check(loaded, embedded_bench(loaded.rig), "", today)):
        screen.warn(f"needs a bench of its own, the emulated one refuses {problem}")
    return loaded


def _on_bench(file: Path, bench_file: Path, today: datetime.date, screen: Screen) -> Scenario | Sweep:
    """What a file holds that is to run on a bench; where one of the two is faulty, the other's faults too."""
    from rig.files.bench import Bench, load_bench
    from rig.files.faults import Gathered
    from rig.files.pairing import check_bench

    gathered = Gathered()
    loaded = gathered.of(lambda: load_any(file))
    if isinstance(loaded, Bench):
        allowed = "a scenario or a sweep to check on it"
        raise ConfigurationError(str(bench_file), [Problem("--bench", f"beside {file}, a bench", allowed)])
    bench = gathered.of(lambda: load_bench(bench_file, None if loaded is None else loaded.rig))
    if loaded is not None and bench is not None:
        _check(loaded, bench, str(file), today)
        _remark(bench, screen)
        return loaded
    if loaded is not None:
        gathered.of(lambda: _check(loaded, None, str(file), today))
    if bench is not None:
        gathered.of(lambda: check_bench(bench, today))
    raise gathered.error()


def _remark(bench: Bench, screen: Screen) -> None:
    """Say what is no fault of a bench, and still to be known."""
    from rig.files.pairing import undelayed, unmeasured
    from rig.rigs import RIGS
    from rig.twin.alignment import nothing_tells

    table, names = RIGS[bench.rig].channels, [each.name for each in bench.daq_card.channels]
    for told in filter(None, (unmeasured(bench), nothing_tells(table, names), undelayed(bench))):
        screen.warn(told)


def _check(wanted: Scenario | Sweep, bench: Bench | None, source: str, today: datetime.date) -> None:
    """Raise ConfigurationError with all that no bench allows, and what this `bench` does not."""
    from rig.files.faults import Faults, raised_by
    from rig.files.pairing import check_pair, check_scenario
    from rig.files.scenario import Scenario
    from rig.twin.scenario_twin import check_twin

    if isinstance(wanted, Scenario):
        faults = Faults(source if bench is None else f"{source} on {bench.source}")
        fits = partial(check_scenario, wanted, source)
        if bench is not None:
            fits = partial(check_pair, wanted, bench, today)
        for problem in raised_by(fits, lambda: check_twin(wanted)):
            faults.note(problem)
        faults.raise_if_any()
        return
    from rig.sweep.plan import check_points

    check_points(wanted, bench, today)

"""`rattle run`: drive the rig, record, predict, overlay; `rattle emulate`: its emulated instruments alone."""

from __future__ import annotations

import datetime
import signal
import threading
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Final

import typer

from daq.errors import ConfigurationError, Problem
from rig.commands.arguments import (
    RUNS,
    BenchFile,
    Json,
    Live,
    Model,
    Note,
    ScenarioFile,
    as_toml,
    load_pair,
    noted,
    once,
    out_folder,
    overrides,
    print_json,
)
from rig.session.pace import Work, lasting
from rig.session.progress import Screen, Terminal
from rig.session.signals import Stopped


def run(
    scenario_file: ScenarioFile,
    bench_file: BenchFile = None,
    out: Annotated[Path, out_folder("Where logs go.")] = RUNS,
    live: Live = False,
    model: Model = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Another value of the scenario. May come again."),
    ] = None,
    note: Note = None,
    duration: Annotated[
        str | None, typer.Option("--duration", metavar="TIME", help="How long to record.")
    ] = None,
    until_stopped: Annotated[
        bool,
        typer.Option("--until-stopped", help="Record until Enter; --duration, or the disk, ends it too."),
    ] = False,
    as_json: Json = False,
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.files.model_file import load_model
    from rig.files.pairing import check_pair, free_bytes, longest_s, too_late
    from rig.files.scenario import load_scenario
    from rig.session.on_page import come_to, on_page
    from rig.session.run import RunRequest, run_scenario
    from rig.sweep.plan import real_instruments
    from rig.twin.scenario_twin import check_twin

    screen = Screen(Terminal(stderr=as_json))
    given = [*noted(note), *overrides(settings or [])]
    if duration is not None:
        given.append(("acquisition.duration", as_toml(duration)))
    changed = once(given)
    scenario, bench = load_pair(partial(load_scenario, settings=changed), scenario_file, bench_file)
    open_ended = until_stopped and "acquisition.duration" not in changed
    if until_stopped:
        if screen.nobody_enters():
            raise typer.BadParameter(
                "--until-stopped: standard input is at its end, so no Enter can come; say --duration instead"
            )
        if open_ended:
            changed["acquisition.duration"] = longest_s(scenario.acquisition, bench, free_bytes(out))
            scenario = load_scenario(scenario_file, changed)
        at_most = lasting(scenario.acquisition.duration)
        screen.say(f"Enter ends the record, at the latest after {at_most}; Ctrl-C stops the run at once")
    fitted = None if model is None else load_model(model, scenario.rig, scenario.specimen)
    clock = SystemClock()
    check_pair(scenario, bench, datetime.datetime.now(datetime.UTC).date(), free_bytes(out))
    check_twin(scenario)
    for told in too_late(scenario, bench):
        screen.warn(told)
    request = RunRequest(scenario, bench, connect, out, model=fitted, armed=live and screen.attended)
    if until_stopped:
        request = replace(request, enough=screen.enter_pressed(), open_ended=open_ended)
    lasts = scenario.acquisition.settle + scenario.acquisition.duration
    real = "real" if real_instruments(bench) else "emulated"
    work = None if live or until_stopped else Work(f"run {scenario.rig} on {real} instruments", lasts)
    with on_page(screen) if live else nullcontext() as view:
        with screen.within("lasts", work):
            log = run_scenario(replace(request, view=view), screen, clock)

        # The rig stands: what its report takes, most of scipy, is loaded only now.
        from rig.commands.logs import read_and_judged, report_and_name, show

        found = read_and_judged(log, screen)
        show(found, screen)
        report = report_and_name(found, screen)
        if as_json:
            from rig.report.summary import as_json as figures

            print_json({"log": str(log), "report": str(report), **figures(found)})
        if view is not None:
            come_to(view, screen, f"finished: {log}", found.verdict, report, stays=not as_json)


def live(
    port: Annotated[
        int | None, typer.Option("--port", min=1, max=65_535, help="Default: RATTLE_LIVE_PORT, else 8710.")
    ] = None,
    stop: Annotated[bool, typer.Option("--stop", help="End the one that is up.")] = False,
) -> None:
    from rig.live.page_server import (
        PORT,
        PORT_VARIABLE,
        answering,
        page_port,
        page_url,
        serve_page,
        stop_page,
    )

    screen, of_runs = Screen(Terminal()), page_port()
    at = port or of_runs or PORT
    if stop:
        screen.say(f"{page_url(at)} {'ended' if stop_page(at) else 'was not up'}")
        return
    up, elsewhere = answering(at) is not None, port is not None and at != of_runs
    which = f" --port {at}" if elsewhere else ""
    how = f" is up; rattle live{which} --stop ends it" if up else "; Ctrl-C ends it"
    screen.say(f"live view  {page_url(at)}{how}")
    if elsewhere:
        screen.say(f"runs       come here with {PORT_VARIABLE}={at} in their environment")
    if not up:
        serve_page(at)


_NO_PARITY: Final = (
    "inverter: a pseudo terminal (/dev/pts/...) carries no parity, which the bench asks for; use the socket, "
    'or parity = "N" in the bench file of rattle emulate and in that of rattle run'
)


def emulate(
    scenario_file: Annotated[
        Path | None, typer.Argument(metavar="SCENARIO.toml", help="What to run.")
    ] = None,
    bench_file: BenchFile = None,
    as_json: Json = False,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[@TIME][:key=value]...", help="A fault to rehearse; list: what there is."),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="The same rig and faults again.")] = None,
) -> None:
    from drivers.rehearsal import FAULTS, rehearsed
    from rig.emulation import STARTING, bench_reaching, emulated_bench, first_start
    from rig.files.pairing import nowhere
    from rig.files.scenario import load_scenario

    if fault == ["list"]:
        for name, known in FAULTS.items():
            typer.echo(f"{known.spelled(name):<52} {known.number:<4} {known.told}; {known.seen}")
        return
    if scenario_file is None:
        raise typer.BadParameter("SCENARIO.toml is missing: what to emulate")
    scenario, bench = load_pair(load_scenario, scenario_file, bench_file)
    faults = (*bench.emulation.faults, *(fault or ()))
    allowed = f"a fault of {', '.join(bench.emulated)}; one of the disk stands in the bench of rattle run"
    others = [told.name for told in map(rehearsed, fault or ()) if told.table not in bench.emulated]
    emulation = replace(bench.emulation, faults=faults, seed=bench.emulation.seed if seed is None else seed)
    bench = replace(bench, emulation=emulation)
    if problems := [*(Problem("fault", name, allowed) for name in others), *nowhere(bench)]:
        raise ConfigurationError("faults to rehearse", problems)
    screen = Screen(Terminal(stderr=as_json))
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with ExitStack() as stack:
        with screen.busy(STARTING, Work(f"start {scenario.rig}"), first_start(bench)):
            emulated = stack.enter_context(emulated_bench(scenario, bench))
        addresses = {
            table: list(emulated.instruments[table].addresses) if table in emulated.instruments else []
            for table in bench.instruments
        }
        if as_json:
            print_json(addresses)
        for name, each in addresses.items():
            screen.say(f"{name}: {', '.join(each) or 'real, not emulated'}")
        if "inverter" in emulated.instruments and bench.actuator.parity != "N":
            screen.say(_NO_PARITY)
        screen.say(
            f"to reach them: rattle run {scenario_file} --bench BENCH.toml, with these lines in BENCH.toml\n"
        )
        places = {table: instrument.address for table, instrument in emulated.instruments.items()}
        screen.say(bench_reaching(bench, places))
        screen.say("Ctrl-C ends them")
        ended.wait()
    raise Stopped("emulated instruments ended")

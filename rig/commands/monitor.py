"""`rattle monitor`: all sensors live with nothing driven, and what taps and turns by hand say of a bench."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from rig.commands.arguments import BenchFile, Json, Live, ScenarioFile, load_pair, print_json, seconds
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from rich.table import Table

    from rig.files.bench import Bench
    from rig.files.bench_edit import Change
    from rig.session.at_rest import Shown
    from rig.session.monitor import Monitor

_QUIET_S: Final = 1.2
"""Hands off for so long first: a tap is known by the noise before it."""
_WATCHES: Final = "nothing is driven: tap a sensor, turn the shaft"


def monitor(
    scenario_file: ScenarioFile,
    bench_file: BenchFile = None,
    live: Live = False,
    duration: Annotated[
        str | None,
        typer.Option("--duration", metavar="TIME", help="How long to watch. Without: until Enter."),
    ] = None,
    write: Annotated[
        bool,
        typer.Option(
            "--write", help="Ask for taps and a turn, then whether the bench file gets what they show."
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    from daq.clock import SystemClock
    from rig.app import sensing
    from rig.files.scenario import load_scenario
    from rig.session.monitor import Monitor
    from rig.session.on_rest_page import on_rest_page
    from rig.session.signals import StopRequest

    screen, clock = Screen(Terminal(stderr=as_json)), SystemClock()
    scenario, bench = load_pair(load_scenario, scenario_file, bench_file)
    lasts_s = math.inf if duration is None else seconds(duration, "--duration")
    if write and (bench_file is None or duration is not None):
        raise typer.BadParameter("--write asks one thing after the other: with --bench, and no --duration")
    if duration is None and screen.nobody_enters():
        raise typer.BadParameter("standard input is at its end, so no Enter can come; say --duration instead")
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        page = stack.enter_context(on_rest_page(screen, clock)) if live else None
        instruments = sensing(scenario, bench, stack, screen)
        stop.check()
        with screen.busy("connecting"):
            watched = stack.enter_context(Monitor(bench, instruments, clock))
        card = instruments.card
        screen.say(f"card       {len(card.channels)} channels at {card.sample_rate:g} Hz, {card.address}")
        show = stack.enter_context(_on_terminal(screen))

        def look(ask: str = "") -> None:
            stop.check()
            watched.look()
            while watched.unread:
                screen.say(watched.unread.popleft())
            show(watched)
            if page is not None:
                page(scenario.name, ask or _WATCHES, bool(ask), watched)

        found: list[Change] = []
        if write:
            found = _asked(watched, bench, screen, look)
        else:
            screen.say(f"{_WATCHES}{'; Enter ends it' if duration is None else ''}")
            end_s = clock.monotonic_s() + lasts_s
            while clock.monotonic_s() < end_s and not (duration is None and screen.entered()):
                look()
        shown, seen = watched.sensors.shown(), list(watched.seen)
    if not screen.console.is_terminal:
        screen.console.print(_table(shown))
    written = bool(found) and bench_file is not None and _written(found, bench_file, bench, screen)
    if as_json:
        rows = [_without_nan(asdict(each)) for each in shown]
        changes = [asdict(each) for each in found]
        print_json(
            {"channels": rows, "seen": [text for _, text in seen], "changes": changes, "written": written}
        )


def _asked(watched: Monitor, bench: Bench, screen: Screen, look: Callable[[str], None]) -> list[Change]:
    """What a person's taps and turn say against the bench file, asked one after the other."""
    from rig.session.set_up import Findings, answered, changes, questions

    findings, sensors = Findings(), watched.sensors
    watched.tells_of_turns = False
    screen.say("each of these goes on with Enter, done or not")
    while sensors.end_s < _QUIET_S:
        look("")
    for question in questions(sensors, bench):
        screen.say(question.text)
        sensors.shaft.begin()
        watched.tap = None
        while (typed := screen.line()) is None:
            look(question.text)
        nothing = "nothing was typed" if question.typed else "nothing of it was seen"
        screen.say(f"  {answered(question, sensors, watched.tap, findings, typed) or nothing}")
    found, doubts = changes(findings, sensors, bench)
    for doubt in doubts:
        screen.warn(doubt)
    return found


def _written(found: list[Change], bench_file: Path, bench: Bench, screen: Screen) -> bool:
    """Write them into the bench file, where a person says so."""
    from rig.files.bench import parse_bench
    from rig.files.bench_edit import change_bench, changed

    for change in found:
        screen.say(f"  {change}")
    text = changed(bench_file.read_text(encoding="utf-8"), found, str(bench_file))
    parse_bench(text, f"{bench_file} with these", bench_file.resolve().parent, bench.rig)
    try:
        answer = screen.console.input(f"write these into {bench_file}? y and Enter: ", markup=False)
    except EOFError:
        answer = ""
    if answer.strip().lower() not in ("y", "yes"):
        screen.say(f"{bench_file} stays as it is")
        return False
    change_bench(bench_file, found)
    screen.say(f"written to {bench_file}")
    return True


@contextmanager
def _on_terminal(screen: Screen) -> Iterator[Callable[[Monitor], None]]:
    """A table that stays up to date below what is said; nothing on a pipe."""
    if not screen.console.is_terminal:
        yield lambda watched: None
        return
    from rich.live import Live as Region

    with Region(console=screen.console, auto_refresh=False) as region:
        yield lambda watched: region.update(_table(watched.sensors.shown()), refresh=True)


def _table(shown: list[Shown]) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for head in ("channel", "level", "noise", "mains", "drift", ""):
        table.add_column(head, overflow="fold", no_wrap=head in ("channel", "level", "noise", "drift"))
    for each in shown:
        words, says = each.words, each.state or each.sheet
        told = (words[key] for key in ("level", "noise", "mains", "drift"))
        where = ", ".join(filter(None, (each.physical, says)))
        table.add_row(each.name, *told, where, style="red" if each.state else "")
    return table


def _without_nan(value: Any) -> Any:
    """For JSON, which has no NaN and no infinity."""
    if isinstance(value, dict):
        return {key: _without_nan(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""`rattle emulate`: the emulated instruments as servers, for another program to use."""

from __future__ import annotations

import signal
import threading

import typer
from rich.console import Console

from rig.commands.arguments import BenchFile, Json, ScenarioFile, load_pair, print_json
from rig.emulation import EmulatedBench
from rig.session.progress import Screen
from rig.session.signals import Stopped


def add_to(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def emulate(scenario_file: ScenarioFile, bench_file: BenchFile = None, as_json: Json = False) -> None:
        """Start the emulated instruments on their real wire protocols; prints where each listens."""
        scenario, bench = load_pair(scenario_file, bench_file)
        screen = Screen(Console(stderr=as_json))
        ended = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ended.set())
        with EmulatedBench(scenario, bench) as emulated:
            addresses = {
                table: list(emulated.instruments[table].addresses) if table in emulated.instruments else []
                for table in bench.instruments
            }
            if as_json:
                print_json(addresses)
            for name, each in addresses.items():
                screen.say(f"{name}: {', '.join(each) or 'real, not emulated'}")
            screen.say("Ctrl-C ends them")
            ended.wait()
        raise Stopped("emulated instruments ended")

"""`rattle emulate`: the emulated instruments as servers, for another program to use."""

from __future__ import annotations

import signal
import threading
from contextlib import ExitStack
from typing import Final

from rich.console import Console

from rig.commands.arguments import BenchFile, Json, ScenarioFile, load_pair, print_json
from rig.session.progress import Screen
from rig.session.signals import Stopped

_NO_PARITY: Final = (
    "inverter: a pseudo terminal (/dev/pts/...) carries no parity, which the bench asks for; use the socket, "
    'or parity = "N" in the bench file of rattle emulate and in that of rattle run'
)


def emulate(scenario_file: ScenarioFile, bench_file: BenchFile = None, as_json: Json = False) -> None:
    from rig.emulation import EmulatedBench, bench_reaching, starting

    scenario, bench = load_pair(scenario_file, bench_file)
    screen = Screen(Console(stderr=as_json))
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with ExitStack() as stack:
        with screen.busy(starting(bench)):
            emulated = stack.enter_context(EmulatedBench(scenario, bench))
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

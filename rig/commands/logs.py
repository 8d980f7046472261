"""`rattle overlay`, `replay`, `verify` and `recover`: what is done with a log; and what a run came to."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from daq.errors import ConfigurationError, LogError, RattleError
from rig.commands.arguments import EffectsFile, Json, Live, Model, RunFile, print_json
from rig.session.pace import Work, reading
from rig.session.progress import MEGABYTES, Screen, Terminal

if TYPE_CHECKING:
    from daq.log.reader import LogReader, Origin
    from daq.log.recover import LogReport
    from rig.report.record import RunRecord


def recorded(log: Path, screen: Screen) -> RunRecord:
    """What a log tells; how long reading takes is told where it takes long."""
    work = reading("read a run", log)
    with (
        screen.busy("reading", work)
        if screen.console.is_terminal or work.units >= _LARGE_MB
        else nullcontext()
    ):
        from rig.report.record import read_run  # with most of scipy, which takes as long

        return read_run(log)


def read_and_judged(log: Path, screen: Screen) -> RunRecord:
    """What a log tells, with the verdict on it."""
    read = recorded(log, screen)
    from rig.diagnosis.health import judged  # with the rest of scipy

    return judged(read, screen)


def overlay(
    run: RunFile,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Default: RUN.overlay.mcap")
    ] = None,
    effects: EffectsFile = None,
    model: Model = None,
) -> None:
    from rig.report.sections.summary import farther_off
    from rig.report.summary import closeness, overall
    from rig.session.overlay import overlay_run

    screen = Screen(Terminal())
    target = out or run.with_suffix(".overlay.mcap")
    overlay_run(run, target, effects, model, screen.warn, screen=screen)
    overlaid = read_and_judged(target, screen)
    show(overlaid, screen)
    if effects is not None and (channels := closeness(overlaid)):
        close = overall(channels)
        apart = f"the run's own halves lie {close.halves_db:.1f} dB apart"
        screen.say(f"nominal    autospectra {close.nominal_db:.1f} dB off those measured")
        screen.say(f"repaired   {close.repaired_db:.1f} dB; {apart}")
        if worse := farther_off(overlaid, channels):
            screen.warn(worse)
    report_and_name(overlaid, screen)


_UNSOUND, _LOST = 1, 3
_LARGE_MB = 50.0
"""What is read in less than five seconds on any machine is less."""


def verify(log: RunFile, as_json: Json = False) -> None:
    from daq.log.recover import verify_log

    with _read("verifying", log, Screen(Terminal(stderr=as_json))) as passing:
        report = verify_log(log, passing)
    _show(report, as_json)
    if not report.sound:
        raise typer.Exit(_UNSOUND)


@contextmanager
def _read(what: str, log: Path, screen: Screen) -> Iterator[Callable[[int], None]]:
    """Show how far a log has been read; of one that is soon read nothing is said."""
    work = reading(what, log)
    if work.units < _LARGE_MB:
        yield lambda _: None
        return
    with screen.bar(what, round(work.units), MEGABYTES, work) as bar:
        yield lambda passed: bar(passed / 1e6)


def recover(
    log: RunFile, out: Annotated[Path, typer.Option("-o", metavar="FILE", help="The new log.")]
) -> None:
    from daq.log.recover import recover_log
    from rig.files.software import software

    screen = Screen(Terminal())
    with _read("recovering", log, screen) as passing:
        report = recover_log(log, out, passing, software())
    if not report.whole:
        screen.say(_lost(report))
    if report.left_out:
        screen.say(f"left out   {', '.join(report.left_out)}: none of rattle's topics")
    _show(report, as_json=False)
    if not report.whole:
        raise typer.Exit(_LOST)
    if not report.sound:
        raise typer.Exit(_UNSOUND)


def _lost(report: LogReport) -> str:
    """What is missing of a log that was not only cut."""
    lost = f"{report.lost} samples were lost" if report.lost else "no sample was seen to be lost"
    if report.all_told:
        return f"{lost}; something else at the damage may be" if not report.lost else lost
    return f"{lost}; how many came after the damage, nothing tells"


def _show(report: LogReport, as_json: bool) -> None:
    from daq.log.reader import LogReader

    if as_json:
        verdicts = {"sound": report.sound, "unverified": report.unverified}
        print_json({**dataclasses.asdict(report), "path": str(report.path), **verdicts})
    else:
        table = Table(box=None, pad_edge=False)
        table.add_column("topic", min_width=max((len(each.topic) for each in report.topics), default=0))
        for heading in ("blocks", "samples", "missing"):
            table.add_column(heading, min_width=len(heading))
        for topic in report.topics:
            table.add_row(topic.topic, str(topic.messages), str(topic.samples), str(topic.missing))
        screen = Screen(Terminal())
        screen.console.print(table)
        with LogReader(report.path) as log:
            with suppress(LogError):  # in a damaged chunk, which the verdict tells
                for gap in log.gaps():
                    whose = f"{gap.origin} {gap.channel}".strip()
                    screen.say(f"gap: {whose}, {gap.count} samples from {gap.first_sample}: {gap.cause}")
            screen.say(f"{report.path}: {_verdict(report, log)}")


def _verdict(report: LogReport, log: LogReader) -> str:
    """What a log is worth, in one line."""
    from rig.files.scenario import parse_scenario
    from rig.session.run import ENDS

    reaches = f"{report.seconds:.4g} s"
    early = report.recovered_from or not report.complete
    with suppress(LogError):  # of what is damaged, which is told below
        early = early or log.stopped_ns is not None
    if early and ENDS not in log.metadata.get("run", {}):
        with suppress(ConfigurationError):
            reaches += f" of the {parse_scenario(log.scenario).acquisition.duration:g} s asked for"
    samples = sum(topic.samples for topic in report.topics)
    reaches += f", {samples} samples"
    if report.ledger_missing:
        reaches += f", {report.ledger_missing} more missing by its ledger"
    if not report.complete:
        return f"{reaches}; cut short ({report.damage or 'no end'}): rattle recover"
    if not samples and not report.damage and not report.recovered_from:
        return f"{reaches}: nothing was recorded"
    if not report.sound and not report.unverified:
        twice = any(topic.repeats for topic in report.topics)
        untold = "samples come twice" if twice else "samples are missing outside the ledger"
        return f"{reaches}: NOT SOUND, {report.damage or untold}"
    unverified = f"UNVERIFIED, {_unchecked(report)} no checksum that would show damage"
    if not report.recovered_from:
        return f"{reaches}: {'sound' if report.sound else unverified}"
    part = f"{report.whole_bytes / 1e6:.2f} of {report.size_bytes / 1e6:.2f} MB of "
    whose = f"{part if report.whole_bytes < report.size_bytes else ''}a log ({report.recovered_from})"
    nothing = f"; of {', '.join(report.untold)} nothing is left, however much it was" if report.untold else ""
    state = "sound as far as it goes," if report.sound else f"{unverified};"
    return f"{reaches}: {state} recovered from {whose}{nothing}"


def _unchecked(report: LogReport) -> str:
    """How much of a log, or else of the one that it was recovered from, has no checksum."""
    if report.unchecked:
        return f"{report.unchecked} of its parts (chunks, summary) have"
    return f"{report.unchecked_before} parts of the log that it was recovered from had"


def replay(
    run: RunFile,
    speed: Annotated[
        float, typer.Option("--speed", min=0.0, metavar="X", help="Times real time; 0: as fast as possible.")
    ] = 1.0,
    live: Live = False,
) -> None:
    from daq.clock import SystemClock
    from daq.log.reader import LogReader
    from rig.diagnosis.health import judged
    from rig.report.record import RunCollector
    from rig.session.on_page import come_to, on_page
    from rig.session.replay import replay_log

    screen = Screen(Terminal())
    with on_page(screen) if live else nullcontext() as view, LogReader(run) as log:
        collector = RunCollector(log)
        replay_log(run, speed, view, screen, SystemClock(), (collector,))
        replayed = judged(collector.record(), screen)
        show(replayed, screen)
        if view is not None:
            report = run.with_suffix(".html")
            come_to(view, screen, f"replayed: {run}", replayed.verdict, report if report.is_file() else None)


def show(run: RunRecord, screen: Screen) -> None:
    """Print what a run comes to."""
    from rig.pages.words import as_written
    from rig.report.summary import warnings_passed

    table = Table(box=None, pad_edge=False)
    table.add_column("channel", min_width=max(map(len, run.channels), default=0), no_wrap=True)
    origins: tuple[Origin, Origin] = ("measured", "predicted")
    first, second = (run.names.get(origin, origin) for origin in origins)
    for column in (f"rms {first}", second, f"peak {first}", second, "unit"):
        table.add_column(column, justify="left" if column == "unit" else "right")
    for name, channel in run.channels.items():
        factor, unit = as_written(channel.unit)
        turns = name in run.roles.unwrapped  # its figures tell only how long the run was
        both = [None if turns else run.tallies.get((origin, name)) for origin in origins]
        rms, peaks = (
            ["-" if each is None else f"{factor * getattr(each, what):.4g}" for each in both]
            for what in ("rms", "peak")
        )
        table.add_row(name, *rms, *peaks, unit)
    screen.console.print(table)
    for line in (*_half_cycle_lines(run), *_impact_lines(run)):
        screen.say(line)
    if run.missing:
        screen.warn(f"{run.missing} measured samples are missing: rattle verify lists the gaps")
    if passed := warnings_passed(run):
        screen.warn(passed)
    for name, tally in run.measured.items():
        if tally.overloaded_blocks:
            screen.warn(f"{name}: overload in {tally.overloaded_blocks} blocks")
    screen.say(f"gaps       {run.measured_gaps}; overloaded blocks {run.overloaded_blocks}")
    if run.verdict is not None:
        first, *more = run.verdict.sentences
        screen.say(f"verdict    {first}", "bold yellow" if run.verdict.well is False else None)
        for sentence in more:
            screen.say(f"           {sentence}")


def _half_cycle_lines(run: RunRecord) -> Iterator[str]:
    from rig.report.record import ORIGINS
    from rig.report.summary import half_cycle_statistics

    if not run.channels.keys() & {*(run.roles.stops or ())}:
        return
    for origin in ORIGINS:
        if any(whose == origin for whose, _ in run.tallies):
            found, text = half_cycle_statistics(run, origin), "no contact"
            if found is not None:
                first = f"first {found.first_mean_n:.1f} +- {found.first_sd_n:.1f} N"
                largest = f"max {found.max_mean_n:.1f} +- {found.max_sd_n:.1f} N"
                text = f"{first}, {largest} a half cycle ({found.count} half cycles)"
            yield f"{run.whose(origin):<10} {text}"


def _impact_lines(run: RunRecord) -> Iterator[str]:
    from rig.pages.words import as_written
    from rig.report.crank_figures import impacts_by_group

    for group, by_whose in impacts_by_group(run).items():
        if run.roles.impacts[group] == run.roles.stops:  # which half cycles tell
            continue
        for whose, found in by_whose.items():
            factor, unit = as_written(found.unit)
            mean, deviation = (factor * each for each in found.spread)
            often = f", {found.a_revolution:.2f} a revolution" if found.revolutions > 0 else ""
            peaks = f", mean peak {mean:.1f} +- {deviation:.1f} {unit}" if len(found.peak) else ""
            yield f"{whose:<10} {group}: {len(found.peak)} impacts{often}{peaks}"


def report_and_name(run: RunRecord, screen: Screen) -> Path:
    """Write the report beside the log of a run and name both, the log last; returns where it is."""
    from rig.report.page import write_report

    log, report = run.path, run.path.with_suffix(".html")
    try:
        with screen.busy("writing the report", Work("report", log.stat().st_size / 1e6)):
            write_report(run, report)
        screen.say(f"report     {report}")
    except OSError as error:
        raise RattleError(f"the log {log} is complete, but not its report: {error}") from error
    screen.say(f"log        {log}")
    return report

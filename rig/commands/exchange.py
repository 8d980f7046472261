"""`rattle export` and `rattle import`: logs in other programs' formats, and their files as logs."""

from __future__ import annotations

import dataclasses
import datetime
import fnmatch
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from daq.errors import ConfigurationError, Problem, RattleError
from rig.commands.arguments import RunFile, seconds
from rig.session.pace import Work, reading
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from daq.formats.recording import Recording
    from daq.log.reader import LogReader, Origin
    from rig.files.foreign import Answers
    from rig.files.scenario import Scenario

Pairs = list[str] | None
_NAMED = 3


def export(
    run: RunFile,
    to: Annotated[str, typer.Option("--to", metavar="uff|tdms|mat|csv|parquet", help="The format.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Default: RUN in that format.")
    ] = None,
    channels: Annotated[
        str | None, typer.Option("--channels", metavar="A,B", help="Only these; contact.* means all of it.")
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option("--origin", metavar="ORIGIN,...", help="Only these: measured,predicted."),
    ] = None,
    start: Annotated[
        str, typer.Option("--from", metavar="TIME", help="In s since the start of recording.")
    ] = "0",
    end: Annotated[str | None, typer.Option("--to-time", metavar="TIME", help="Up to there.")] = None,
    all_rates: Annotated[
        bool,
        typer.Option(
            "--all-rates", help="csv, parquet: also what has other rates, a file each, and impacts."
        ),
    ] = False,
) -> None:
    from daq.formats import all_formats
    from daq.formats.contents import exists_already
    from daq.formats.recording import read_log, within
    from daq.formats.samples import Scratch
    from daq.formats.tables import other_rates
    from daq.log.reader import LogReader

    screen, formats = Screen(Terminal()), all_formats()
    chosen = formats.get(to)
    if chosen is None or chosen.write is None:
        known = ", ".join(name for name, each in formats.items() if each.write is not None)
        raise typer.BadParameter(f"--to {to}: one of {known}")
    target = out or run.with_suffix(chosen.suffixes[0])
    if target.exists():  # before minutes of reading
        raise exists_already(target)
    start_s, end_s = seconds(start, "--from"), math.inf if end is None else seconds(end, "--to-time")
    with LogReader(run) as log, Scratch(target.parent) as scratch:
        origins, names = _chosen(log, channels, origin)
        work = reading("read for export", run)
        with screen.busy("reading", work):
            recording = read_log(log, scratch, origins, names)
            if all_rates or not chosen.one_rate:
                recording = _with_impacts(recording, log)
            if start_s > 0 or end_s < math.inf:
                recording = within(recording, start_s, end_s)
                if not any(track.stretches for track in recording.tracks):
                    until = "the end" if end is None else f"{end_s:g} s"
                    raise RattleError(f"{run}: there is no sample in it between {start_s:g} s and {until}")
        if not log.complete:
            screen.warn(f"{run} is cut short: exported as far as it goes")
        if chosen.one_rate and not all_rates:
            asked = set() if channels is None else {*map(str.strip, channels.split(","))}
            left = [each for each in other_rates(recording) if each.channel.name not in asked]
            kept = tuple(each for each in recording.tracks if each not in left)
            recording = dataclasses.replace(recording, tracks=kept, impacts=())
            for told in _left_out([each.name for each in left], bool(log.impacts())):
                screen.say(f"left out   {told} (--all-rates)")
        with screen.busy("writing", Work(f"write {to}", len(recording.tracks) * work.units)):
            written = chosen.write(recording, target, screen.warn)
    for path in written:
        screen.say(f"file       {path}")


def _left_out(names: Sequence[str], impacts: bool) -> Iterator[str]:
    """What one table of one rate has no room for, in words."""
    if names:
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        yield f"{', '.join(names[:_NAMED])}{more}: other rates"
    if impacts:
        yield "impacts"


def _with_impacts(recording: Recording, log: LogReader) -> Recording:
    """With those of its channels by the rule, whatever the log has."""
    from rig.derived.derivation import impacts_of

    there = {(track.origin, track.channel.name) for track in recording.tracks}
    impacts = [each for each in impacts_of(log) if (each.origin, each.channel) in there]
    return dataclasses.replace(recording, impacts=impacts)


def _chosen(
    log: LogReader, channels: str | None, origin: str | None
) -> tuple[tuple[Origin, ...], frozenset[str] | None]:
    """What is asked for of a log; raises ConfigurationError with every name that is not there."""
    from daq.log.reader import Origin
    from rig.files.faults import Faults

    faults, there = Faults(str(log.path)), [each for each in get_args(Origin) if log.channels(each)]
    asked = there if origin is None else [name.strip() for name in origin.split(",")]
    for name in set(asked) - set(there):
        faults.unknown("--origin", name, name, there, "origin of this log")
    origins = tuple(each for each in there if each in asked)
    known = {name for each in origins or there for name in log.channels(each)}
    names = set[str]()
    for pattern in () if channels is None else map(str.strip, channels.split(",")):
        found = fnmatch.filter(known, pattern)
        names.update(found)
        if not found:
            faults.unknown("--channels", pattern, pattern, sorted(known), "channel of this log")
    faults.raise_if_any()
    return origins, None if channels is None else frozenset(names)


def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="A file, or the files of one run.")],
    scenario: Annotated[
        Path | None,
        typer.Option("--scenario", metavar="S.toml", help="Default: the one that the file carries."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE.mcap", help="Default: FILE.mcap")
    ] = None,
    rename: Annotated[Pairs, typer.Option("--rename", metavar="THEIRS=OURS", help=_RENAME)] = None,
    unit: Annotated[Pairs, typer.Option("--unit", metavar="THEIRS=UNIT", help=_UNIT)] = None,
    skip: Annotated[Pairs, typer.Option("--skip", metavar="THEIRS", help="Leave a channel out.")] = None,
    sample_rate: Annotated[Pairs, typer.Option("--sample-rate", metavar="RATE", help=_RATE)] = None,
    started: Annotated[str | None, typer.Option("--started", metavar="TIME", help=_STARTED)] = None,
) -> None:
    from rig.files.foreign import Answers
    from rig.files.quantity import QuantityError, si_value

    renamed, units = _pairs(rename, "--rename"), _pairs(unit, "--unit")
    rates, started_ns = list[float](), None
    for text in sample_rate or ():
        try:
            rates.append(float(text) if re.fullmatch(r"[\d.]+", text) else si_value(text, "Hz"))
        except (QuantityError, ValueError) as error:
            raise typer.BadParameter(f"--sample-rate {text}: {error}") from error
        if not 0 < rates[-1] < 1e9:
            raise typer.BadParameter(f"--sample-rate {text}: more than 0 Hz")
    if started is not None:
        match = _ISO.fullmatch(started)
        try:
            if match is None:
                raise ValueError(started)
            moment = datetime.datetime.fromisoformat(match[1]).replace(tzinfo=datetime.UTC)
        except ValueError as error:
            raise typer.BadParameter(f"--started {started}: a time such as 2026-09-21T14:13:20.5Z") from error
        started_ns = int(moment.timestamp()) * 10**9 + int((match[2] or "0").ljust(9, "0"))
    answers = Answers(renamed, units, skip or (), rates, started_ns)
    target = out or files[0].with_suffix(".mcap")
    screen = Screen(Terminal())
    import_files(files, scenario, target, answers, screen)
    screen.say(f"log        {target}")


_RENAME = "What the file calls a channel, and its name on the rig. May come again."
_UNIT = "The unit of a channel, where the file has none or a wrong one. May come again."
_RATE = 'Such as "51.2 kHz", where the file does not say it in full. May come again.'
_STARTED = "When the recording began, ISO 8601 in UTC, up to nine digits of a second."


def import_files(
    files: Sequence[Path], scenario_file: Path | None, target: Path, answers: Answers, screen: Screen
) -> None:
    """Make the new log `target` of `files`; raises ConfigurationError, LogError, RecorderFailed."""
    from daq.formats import format_of
    from daq.formats.contents import Contents
    from daq.formats.recording import write_log
    from daq.formats.samples import Scratch
    from rig.files.foreign import matched_to_rig
    from rig.files.scenario import load_scenario, parse_scenario
    from rig.twin.prediction_file import whole_log

    given = None if scenario_file is None else load_scenario(scenario_file)
    source = ", ".join(map(str, files))
    with ExitStack() as stack:
        scratch = stack.enter_context(Scratch(target.parent))
        work = reading(f"read {files[0].suffix}", *files)
        with screen.busy("reading", work):
            found = [format_of(path).read(path, scratch) for path in files]
            ids = {each.rest.run_id for each in found if each.rest.metadata}
            if len(ids) > 1:
                raise ConfigurationError(
                    "files", [Problem("run", ", ".join(sorted(ids)), "files of one run")]
                )
            columns = tuple(column for each in found for column in each.columns)
            impacts = [impact for each in found for impact in each.rest.impacts]
            # what is no column comes from the first that says it; a table of impacts says nothing else
            first = next((each for each in found if each.rest.metadata), found[0])
            rest = dataclasses.replace(first.rest, impacts=impacts)
            contents = Contents(columns, rest, [note for each in found for note in each.notes])
        for note in dict.fromkeys(contents.notes):
            screen.warn(note)
        text = contents.rest.metadata.get("scenario", {}).get("toml", "")
        if given is None and not text:
            raise ConfigurationError(source, [Problem("--scenario", "(missing)", "the file carries none")])
        scenario = given or parse_scenario(text, f"scenario in {source}")
        recording = matched_to_rig(contents, scenario, answers, source, screen.warn)
        writer = stack.enter_context(whole_log(target))
        with screen.busy("writing", Work(f"import {files[0].suffix}", work.units)):
            write_log(_with_records(recording, scenario, files), writer)


def _with_records(recording: Recording, scenario: Scenario, files: Sequence[Path]) -> Recording:
    """The recording with the scenario in it, and with where it came from in its `run` record."""
    from rig.files.software import software

    starts = [track.stretches[0].time_ns for track in recording.tracks if track.stretches]
    seconds, nanoseconds = divmod(min(starts, default=0), 10**9)
    moment = datetime.datetime.fromtimestamp(seconds, datetime.UTC)
    run = {
        "id": files[0].stem,
        "started": f"{moment:%Y-%m-%dT%H:%M:%S}.{nanoseconds:09d}Z",
        **recording.metadata.get("run", {}),
        "imported_from": ", ".join(path.name for path in files),
        "imported_by": ", commit ".join(software().values()),
    }
    records: Mapping[str, Mapping[str, str]] = {"scenario": {"toml": scenario.text}, "run": run}
    return dataclasses.replace(recording, metadata={**recording.metadata, **records})


_ISO = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?Z?")


def _pairs(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for text in texts or ():
        theirs, mark, ours = text.rpartition("=")
        if not mark or not theirs or not ours:
            raise typer.BadParameter(f"{option} {text}: two texts with = between them")
        pairs[theirs] = ours
    return pairs

"""The end of a run in the terminal: peaks measured and predicted, gaps, overloads."""

from __future__ import annotations

from rich.table import Table

from daq.errors import RattleError
from rig.report.page import write_report
from rig.report.record import RunRecord
from rig.report.summary import ChannelSummary, HalfCycleStatistics, RunSummary, TraceSummary
from rig.session.progress import Screen


def show(summary: RunSummary, screen: Screen) -> None:
    """Print what a run comes to."""
    screen.console.print(_channels(summary))
    _say_peaks(summary, screen)
    if summary.missing:
        screen.warn(f"{summary.missing} measured samples are missing: rattle verify lists the gaps")
    for channel in summary.channels:
        if channel.measured is not None and channel.measured.overloaded_blocks:
            screen.warn(f"{channel.name}: overload in {channel.measured.overloaded_blocks} blocks")
    screen.say(f"gaps       {len(summary.gaps)}; overloaded blocks {summary.overloaded_blocks}")


def report_and_name(run: RunRecord, screen: Screen) -> None:
    """Write the report beside the log of a run and name both, the log last."""
    log, report = run.path, run.path.with_suffix(".html")
    try:
        with screen.busy("writing the report"):
            write_report(run, report)
        screen.say(f"report     {report}")
    except OSError as error:
        raise RattleError(f"the log {log} is complete, but not its report: {error}") from error
    screen.say(f"log        {log}")


def _channels(summary: RunSummary) -> Table:
    table = Table(box=None, pad_edge=False)
    longest = max((len(channel.name) for channel in summary.channels), default=0)
    table.add_column("channel", min_width=longest, no_wrap=True)
    for column in ("rms measured", "predicted", "peak measured", "predicted", "unit"):
        table.add_column(column, justify="left" if column == "unit" else "right")
    for channel in summary.channels:
        table.add_row(channel.name, *_numbers(channel, "rms"), *_numbers(channel, "peak"), channel.unit)
    return table


def _numbers(channel: ChannelSummary, what: str) -> tuple[str, str]:
    return _number(channel.measured, what), _number(channel.predicted, what)


def _number(trace: TraceSummary | None, what: str) -> str:
    return "-" if trace is None else f"{getattr(trace, what):.4g}"


def _say_peaks(summary: RunSummary, screen: Screen) -> None:
    if not any(channel.name.startswith("contact.") for channel in summary.channels):
        return
    for origin, peaks in (("measured", summary.measured_peaks), ("predicted", summary.predicted_peaks)):
        if not any(getattr(channel, origin) for channel in summary.channels):
            continue
        if peaks is None:
            screen.say(f"{origin:<10} no contact")
        else:
            screen.say(f"{origin:<10} {_peaks(peaks)}")


def _peaks(peaks: HalfCycleStatistics) -> str:
    first = f"first {peaks.first_mean_n:.1f} +- {peaks.first_sd_n:.1f} N"
    largest = f"max {peaks.max_mean_n:.1f} +- {peaks.max_sd_n:.1f} N"
    return f"{first}, {largest} a half cycle ({peaks.count} half cycles)"

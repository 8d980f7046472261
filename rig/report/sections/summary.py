"""The run on one screen."""

from __future__ import annotations

from rig.report.blows import Blows, blows
from rig.report.content import BigNumber, BigNumbers, Part, Sentence, Table
from rig.report.mean_cycle import GROWS
from rig.report.record import RunRecord
from rig.report.sections.comparison import parts as comparison
from rig.report.sections.numbers import DASH, counted, difference, number, spread
from rig.report.speed import set_rpm, speed_figures, speeds
from rig.report.summary import ChannelSummary, HalfCycleStatistics, RunSummary, TraceSummary, summary_of

_NARROW = "\N{NARROW NO-BREAK SPACE}"


def parts(run: RunRecord) -> list[Part]:
    """Duration, state of the data, peaks, and a row for each channel."""
    summary = summary_of(run)
    numbers = [
        BigNumber("Recorded", number(summary.duration_s, "s"), summary.drive),
        _data_state(summary),
        *_peak_numbers(summary),
        *_speed_numbers(run),
        *_blow_numbers(run),
    ]
    table = _table_of_three(summary) if run.repaired else _channel_table(summary)
    return [*comparison(run), BigNumbers(numbers), *_warnings(summary), table]


def _data_state(summary: RunSummary) -> BigNumber:
    remark = f"{counted(len(summary.gaps), 'gap')}, {counted(summary.overloaded_blocks, 'overloaded block')}"
    if not any(channel.measured for channel in summary.channels):
        return BigNumber("Measured", "nothing", "a prediction only")
    text = f"{summary.missing} missing" if summary.missing else "complete"
    return BigNumber("Samples", text, remark)


def _peak_numbers(summary: RunSummary) -> list[BigNumber]:
    measured, predicted, nominal = summary.measured_peaks, summary.predicted_peaks, summary.nominal_peaks
    return [
        BigNumber(f"Peak force, {name}", _mean(measured, name), _remark(measured, predicted, nominal, name))
        for name in ("first", "max")
        if measured or predicted
    ]


def _speed_numbers(run: RunRecord) -> list[BigNumber]:
    """One, where a crank's speed is known."""
    found = {whose: speed_figures(speed) for whose, speed in speeds(run).items()}
    if not found:
        return []
    set_to, measured = set_rpm(run), found.pop("measured", None)
    remarks = [] if set_to is None else [f"set {number(set_to, 'rpm')}"]
    remarks += [] if measured is None else [f"ripple {measured.ripple:.2f} rpm"]
    remarks += [f"{whose} {each.mean:.2f} rpm" for whose, each in found.items()]
    return [BigNumber("Crank speed", f"{measured.mean:.2f} rpm" if measured else DASH, "; ".join(remarks))]


def _blow_numbers(run: RunRecord) -> list[BigNumber]:
    """One for each group of channels on which there are impacts."""
    return [
        _blow_number(group, by_whose)
        for group, by_whose in blows(run).items()
        if any(len(each.peak) for each in by_whose.values())
    ]


def _blow_number(group: str, by_whose: dict[str, Blows]) -> BigNumber:
    measured = by_whose.get("measured")
    remarks = []
    for whose, each in by_whose.items():
        if whose == "measured":
            continue
        against = f": {difference(each.mean, measured.mean)}" if measured else ""
        remarks.append(f"{whose} {spread(each.mean, each.deviation, each.unit)}{against}")
    text = spread(measured.mean, measured.deviation, measured.unit) if measured else DASH
    return BigNumber(f"Peak of an impact, {group}", text, "; ".join(remarks))


def _remark(
    measured: HalfCycleStatistics | None,
    predicted: HalfCycleStatistics | None,
    nominal: HalfCycleStatistics | None,
    name: str,
) -> str:
    if nominal is None:
        return _against(measured, predicted, name, "predicted")
    twins = _against(measured, nominal, name, "nominal"), _against(measured, predicted, name, "repaired")
    return "; ".join(twins)


def _mean(peaks: HalfCycleStatistics | None, name: str) -> str:
    return DASH if peaks is None else spread(*_pair(peaks, name), "N")


def _against(
    measured: HalfCycleStatistics | None, predicted: HalfCycleStatistics | None, name: str, whose: str
) -> str:
    if predicted is None:
        return "no prediction"
    text = f"{whose} {spread(*_pair(predicted, name), 'N')}"
    if measured is None:
        return text
    return f"{text}: {difference(_pair(predicted, name)[0], _pair(measured, name)[0])}"


def _pair(peaks: HalfCycleStatistics, name: str) -> tuple[float, float]:
    if name == "first":
        return peaks.first_mean_n, peaks.first_sd_n
    return peaks.max_mean_n, peaks.max_sd_n


def _warnings(summary: RunSummary) -> list[Sentence]:
    found = []
    if not summary.complete:
        found.append("The log was never finished (a crash). It is read up to its last whole chunk.")
    if not any(channel.predicted for channel in summary.channels):
        found.append("The log holds no prediction.")
    if not summary.channels:
        found.append("The log holds no channel.")
    wrong = [channel.name for channel in summary.channels if channel.measured and channel.measured.not_finite]
    if wrong:
        found.append(f"Samples that are no numbers: {', '.join(wrong)}.")
    return [Sentence(text, warning=True) for text in found]


def _channel_table(summary: RunSummary) -> Table:
    headings = (
        "channel", "unit", "rms measured", "rms predicted", "difference", "peak measured", "peak predicted",
        "overloaded blocks", "missing samples",
    )  # fmt: skip
    return Table(headings, [_channel_row(channel) for channel in summary.channels], "Channels")


def _channel_row(channel: ChannelSummary) -> list[str]:
    measured, predicted = channel.measured, channel.predicted
    figures = [
        _value(measured, "rms"),
        _value(predicted, "rms"),
        difference(predicted.rms, measured.rms) if measured and predicted else DASH,
        _value(measured, "peak"),
        _value(predicted, "peak"),
    ]
    return [
        channel.name,
        channel.unit or DASH,
        *_unless_it_grows(channel, figures),
        str(measured.overloaded_blocks) if measured else DASH,
        str(measured.missing) if measured else DASH,
    ]


def _unless_it_grows(channel: ChannelSummary, figures: list[str]) -> list[str]:
    """Rms and peak of an angle that is unwrapped only tell how long the run was."""
    return [DASH] * len(figures) if channel.name.endswith(GROWS) else figures


def _table_of_three(summary: RunSummary) -> Table:
    headings = (
        "channel", "unit", "rms measured", "nominal", "repaired", "peak measured", "nominal", "repaired",
        "overloaded blocks", "missing samples",
    )  # fmt: skip
    return Table(headings, [_row_of_three(channel) for channel in summary.channels], "Channels")


def _row_of_three(channel: ChannelSummary) -> list[str]:
    measured = channel.measured
    figures = [
        _value(measured, "rms"),
        _value_against(channel.nominal, measured),
        _value_against(channel.predicted, measured),
        *(_value(each, "peak") for each in (measured, channel.nominal, channel.predicted)),
    ]
    return [
        channel.name,
        channel.unit or DASH,
        *_unless_it_grows(channel, figures),
        str(measured.overloaded_blocks) if measured else DASH,
        str(measured.missing) if measured else DASH,
    ]


def _value_against(twin: TraceSummary | None, measured: TraceSummary | None) -> str:
    if twin is None or measured is None:
        return _value(twin, "rms")
    return f"{number(twin.rms)} ({difference(twin.rms, measured.rms)})".replace(" ", _NARROW)


def _value(trace: TraceSummary | None, name: str) -> str:
    return DASH if trace is None else number(trace.rms if name == "rms" else trace.peak)

"""What one reads in a minute."""

from __future__ import annotations

from rig.diagnosis.report.content import Lead, Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.verdict import interval, sentences
from rig.diagnosis.report.words import floors, listed, number, percent, plain
from rig.report.content import BigNumber, BigNumbers, Sentence

_UNIT = (
    "A gap of 1.0 is as far as a healthy rig of the same scenario lies from the twin, with its tolerances, "
    "its noise and the same amount of data. It compares distributions over the cycles, never waveforms."
)


def parts(reported: Reported) -> list[Part]:
    """Two sentences, the numbers that matter, and what was lost of the recordings."""
    lost = [Sentence(remark, warning=True) for remark in reported.remarks]
    return [Lead(sentences(reported)), *lost, BigNumbers(_numbers(reported)), Sentence(_UNIT)]


def _numbers(reported: Reported) -> list[BigNumber]:
    found, gap = reported.findings, reported.findings.gap
    sure = {"effect": found.effect, "none": found.none, "unknown": found.unknown}[reported.verdict]
    numbers = [
        BigNumber("Verdict", reported.verdict, f"probability {percent(sure)}"),
        BigNumber("Gap before", floors(gap.before), "nominal twin; 1.0 = healthy"),
    ]
    if reported.repaired:
        within = listed([plain(cause.name) for cause in found.selected])
        numbers.append(BigNumber("Gap after", floors(gap.after), f"with {within}"))
        numbers.append(_shrink(reported))
    horizon = reported.diagnosis.get("horizon_s")
    if horizon is not None:
        numbers.append(BigNumber("Horizon", number(horizon, "s"), "no waveform holds longer"))
    return numbers


def _shrink(reported: Reported) -> BigNumber:
    gap = reported.findings.gap
    if gap.shrink is None:
        return BigNumber("Shrink", "–", "no gap to shrink")
    return BigNumber("Shrink", f"{100 * gap.shrink:.0f} %", interval(gap))

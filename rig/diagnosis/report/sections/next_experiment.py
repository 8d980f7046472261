"""The run that would tell most."""

from __future__ import annotations

from rig.diagnosis.report.content import Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import listed, percent, plain
from rig.report.content import Listing, Sentence

_SURE = 0.95


def parts(reported: Reported) -> list[Part]:
    """What it separates, how sure one would be then, and its scenario."""
    following = reported.diagnosis.get("next_experiment")
    if not following:
        return [Sentence(_nothing(reported))]
    told = listed([plain(name) for name in following.get("separates", [])] or ["what is still confused"])
    expected = following.get("expected_probability")
    sure = (
        "" if expected is None else f" The answer's probability is then expected to be {percent(expected)}."
    )
    does = "best separates" if _in_doubt(reported) else "would best confirm the answer: it separates"
    text = f"This run, as a scenario file, {does} {told}.{sure}"
    return [Sentence(text), Listing(following["scenario"])]


def _nothing(reported: Reported) -> str:
    if reported.findings.verdict == "none":
        return "Nothing is missing, so there is nothing to tell apart."
    return "No further run was found that would tell more."


def _in_doubt(reported: Reported) -> bool:
    first = reported.judged[0]
    return first.probability < _SURE or bool(first.indistinguishable_from)

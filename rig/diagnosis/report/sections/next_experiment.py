"""The run that would tell most."""

from __future__ import annotations

from rig.diagnosis.report.content import Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import listed, percent, plain
from rig.report.content import Listing, Sentence
from sim_twin.diagnosis.next_experiment import rivals_of


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
    text = f"This run, as a scenario file, best separates {told}.{sure}"
    return [Sentence(text), Listing(following["scenario"])]


def _nothing(reported: Reported) -> str:
    if reported.findings.verdict == "none":
        return "Nothing is missing, so there is nothing to tell apart."
    if rivals_of(reported.findings) is None:
        return "These runs tell the answer from every other effect; no further run is needed for that."
    return "No further run was found that would tell more."

"""The run that would tell most."""

from __future__ import annotations

from rig.diagnosis.report.content import Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import listed, percent, plain
from rig.report.content import Listing, Sentence


def parts(reported: Reported) -> list[Part]:
    """What it separates, how sure one would be then, and its scenario."""
    following = reported.diagnosis.get("next_experiment")
    if not following:
        return [Sentence("No further run was found that would tell more.")]
    told = listed([plain(name) for name in following.get("separates", [])] or ["what is still confused"])
    expected = following.get("expected_probability")
    sure = (
        "" if expected is None else f" The answer's probability is then expected to be {percent(expected)}."
    )
    text = f"This run, as a scenario file, best separates {told}.{sure}"
    return [Sentence(text), Listing(following["scenario"])]

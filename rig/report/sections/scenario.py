"""The scenario as it was run."""

from __future__ import annotations

from rig.report.content import Listing, Part, Sentence
from rig.report.record import RunRecord


def parts(run: RunRecord) -> list[Part]:
    """The scenario's text."""
    return [Listing(run.scenario)] if run.scenario else [Sentence("The log holds no scenario.")]

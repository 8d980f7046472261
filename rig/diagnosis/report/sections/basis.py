"""What all this rests on, and how to argue with it."""

from __future__ import annotations

from shlex import quote

from rig.diagnosis.report.content import Part
from rig.diagnosis.report.reported import Reported
from rig.diagnosis.report.words import floors, number
from rig.report.content import Listing, Sentence, Table


def parts(reported: Reported) -> list[Part]:
    """Runs, what was lost, figures of trust, and the commands that repeat it."""
    return [_runs(reported), *_trust(reported), *_again(reported)]


def _runs(reported: Reported) -> Table:
    rows = [[run.name, run.scenario] for run in reported.runs] or [["not named", ""]]
    return Table(("run", "scenario"), rows, "Runs", words=True)


def _trust(reported: Reported) -> list[Part]:
    found = reported.findings
    cost = reported.diagnosis.get("cost") or {}
    seconds = f" in {number(cost['seconds'])} s" if cost.get("seconds") is not None else ""
    steady = Sentence(
        f"The recordings' own blocks of cycles lie {floors(found.gap.recording)} from their mean, in the "
        "same measure. What is missing may scatter the motion more than a healthy rig does; a rig that "
        "changed while it was recorded would show here too."
    )
    misfit = Sentence(
        f"From rigs simulated as the best explanation says, the recordings lie {number(found.left.gap)} "
        "times as far as nine in ten of such rigs do from each other; where no effect shows, "
        f"{number(found.left.outside)} times. Far above 1 speaks for a cause outside the catalogue."
    )
    made = Sentence(
        f"{len(found.layout.cells)} cells of {found.layout.size} numbers were compared with "
        f"{cost.get('simulations', found.simulations)} simulated recordings{seconds}."
    )
    return [steady, misfit, made]


def _again(reported: Reported) -> list[Part]:
    runs = [quote(path) for path in reported.diagnosis.get("runs", [])] or ["RUN.mcap"]
    model = reported.diagnosis.get("provenance", {}).get("model")
    effects = quote(str(reported.folder / "effects.json"))
    given = f"--effects {effects}" + (f" --model {quote(model)}" if model else "")
    text = f"rattle gap {' '.join(runs)} {given}\nrattle overlay {runs[0]} {given}"
    return [Sentence("To repeat it with these effects, or with others of your own:"), Listing(text)]

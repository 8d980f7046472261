"""The run that would tell most, what all this rests on, and how to argue with it."""

from __future__ import annotations

from shlex import quote

from rig.diagnosis.report.case import Case
from rig.diagnosis.report.words import floors, plain
from rig.pages.content import Listing, Part, Sentence, Table
from rig.pages.words import estimate, listed, probability

_SURE = 0.95


def next_experiment(case: Case) -> list[Part]:
    """What it separates, how sure one would be then, and its scenario."""
    following = case.diagnosis.get("next_experiment")
    if not following:
        if case.findings.verdict == "none":
            return [Sentence("Nothing is missing, so there is nothing to tell apart.")]
        return [Sentence("No further run was found that would tell more.")]
    told = listed([plain(name) for name in following.get("separates", [])] or ["what is still confused"])
    first = case.judged[0]
    in_doubt = first.probability < _SURE or first.indistinguishable_from
    does = "best separates" if in_doubt else "would best confirm the answer: it separates"
    text = f"This run, as a scenario file, {does} {told}."
    expected = following.get("expected_probability")
    if expected is not None:
        text += f" The answer's probability is then expected to be {probability(expected)}."
    return [Sentence(text), Listing(following["scenario"])]


def basis(case: Case) -> list[Part]:
    """Runs, figures of trust, and the commands that repeat it."""
    found = case.findings
    cost = case.diagnosis.get("cost") or {}
    seconds = f" in {estimate(cost['seconds'])} s" if cost.get("seconds") is not None else ""
    rows = [[run.name, run.scenario] for run in case.runs] or [["not named", ""]]
    return [
        Table(("run", "scenario"), rows, "Runs", words=True),
        Sentence(
            f"The recordings' own blocks of cycles lie {floors(found.gap.recording)} from their mean, in the "
            "same measure. What is missing may scatter the motion more than a healthy rig does; a rig that "
            "changed while it was recorded would show here too."
        ),
        Sentence(
            f"From rigs simulated as the best explanation says, the recordings lie "
            f"{estimate(found.left.gap)} times as far as nine in ten of such rigs do from each other; where "
            f"no effect shows, {estimate(found.left.outside)} times. Far above 1 speaks for a cause outside "
            "the catalogue."
        ),
        Sentence(
            f"{len(case.cells)} cells of {found.layout.size} numbers were compared with "
            f"{cost.get('simulations', found.simulations)} simulated recordings{seconds}."
        ),
        Sentence("To repeat it with these effects, or with others of your own:"),
        Listing(_commands(case)),
    ]


def _commands(case: Case) -> str:
    runs = [quote(path) for path in case.diagnosis.get("runs", [])] or ["RUN.mcap"]
    model = case.diagnosis.get("provenance", {}).get("model")
    given = f"--effects {quote(str(case.folder / 'effects.json'))}"
    given += f" --model {quote(model)}" if model else ""
    return f"rattle gap {' '.join(runs)} {given}\nrattle overlay {runs[0]} {given}"

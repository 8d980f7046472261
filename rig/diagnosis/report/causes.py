"""Every effect with its probability, what looks like it, what would tell more, what this rests on."""

from __future__ import annotations

from collections.abc import Sequence
from shlex import quote

from rig.diagnosis.report.case import Case, floors, identified, parameter_words, plain, plausible
from rig.pages.content import Bar, BarTable, Listing, Part, Sentence, Table
from rig.pages.words import DASH, estimate, listed, probability, span
from sim_twin.diagnosis.findings import Judged

_RANKING = ("", "probability", "where", "in the rig", "gap with it alone", "shrink", "not told apart from")
_HOW = (
    "Probability of an effect: that it is the largest cause. Nothing missing, all effects and unknown add up "
    "to 100 %. In the rig: that it is there at all, alone or with others; of two that act together each is. "
    "Gap and shrink are those of a twin with that effect alone."
)
_BELIEVED = 0.02
_MOST = 6
_REJECTED, _FEW = 0.005, 2
_COULD_HIDE = "Nothing is selected. The most probable effects, each as it would have to be if it were there"
_ALIKE, _HARDLY = 0.75, 0.95
_MATRIX = (
    "Twin against twin: how many of a hundred rigs with the effect of the row, as it may be here, are not "
    "taken for one with the effect of the column; 50 % is a coin."
)


def ranking(case: Case) -> list[Part]:
    """Bars, "nothing" and "unknown" among them."""
    found = case.findings
    bars: list[Bar] = []
    order: dict[Bar, float] = {}
    rejected = [each for each in case.judged if each.present < _REJECTED and each.after is None]
    if len(rejected) > _FEW:
        names = listed([plain(each.cause.name) for each in rejected])
        share, most = sum(each.probability for each in rejected), max(each.present for each in rejected)
        more = (names, _unbroken(probability(most)), "", "", "")
        bars.append(Bar(f"{len(rejected)} others", share, probability(share), more))
    else:
        rejected = []
    for each in case.judged:
        cause = each.cause
        if each in rejected:
            continue
        where = f"{cause.location}, {cause.channel}" if cause.channel else cause.location
        shrink = DASH if each.shrink is None else "grows" if each.shrink < 0 else f"{100 * each.shrink:.0f} %"
        alike = ", ".join(plain(name) for name in each.indistinguishable_from)
        more = (where, _unbroken(probability(each.present)), floors(each.after), shrink, alike)
        bars.append(Bar(plain(cause.name), each.probability, probability(each.probability), more))
        order[bars[-1]] = max(each.probability, each.present)
    for label, share, gap in (
        ("nothing missing", found.none, floors(found.gap.before)),
        ("unknown to the catalogue", found.unknown, ""),
    ):
        bars.append(Bar(label, share, probability(share), ("", "", gap, "", ""), apart=True))
    bars.sort(key=lambda bar: -order.get(bar, bar.share))
    return [BarTable(_RANKING, bars), Sentence(_HOW)]


def _unbroken(text: str) -> str:
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def parameters(case: Case) -> list[Part]:
    """Best values with intervals and the plausible range, of what is selected and of its rivals."""
    found = case.selected
    alike = {name for each in found for name in each.indistinguishable_from}
    others = [each for each in case.judged if each not in found]
    rivals = [each for each in others if each.probability >= _BELIEVED or each.cause.name in alike][:_MOST]
    if not found:
        rivals = rivals or others[:_MOST]
    tables: list[Part] = []
    if found:
        tables.append(_table(case, found, "Selected"))
    if rivals:
        tables.append(_table(case, rivals, "Rivals, each as it would have to be" if found else _COULD_HIDE))
    return tables or [Sentence("No effect of the catalogue was judged.")]


def _table(case: Case, judged: Sequence[Judged], caption: str) -> Table:
    written = dict(case.findings.effects)
    headings = ["effect", "in the rig", "parameter", "value", "95 % interval", "plausible range"]
    headings += ["in effects.json"] if any(each.cause.name in written for each in judged) else []
    rows = []
    for each in judged:
        cause = each.cause
        effect = f"{plain(cause.name)} ({cause.channel})" if cause.channel else plain(cause.name)
        share = probability(each.present)
        for parameter in cause.parameters:
            found, unit = each.parameters[parameter.name], parameter.unit
            row = [effect, share, parameter_words(parameter), estimate(found.value, unit)]
            told = "" if identified(parameter, found) else " (not identified)"
            row += [span(found.low, found.high, unit) + told, plausible(parameter)]
            if len(headings) > len(row):
                value = written.get(cause.name, {}).get(parameter.name)
                row.append("" if value is None else estimate(float(value), unit))
            rows.append(row)
            effect = share = ""  # said once for all parameters of an effect
    return Table(headings, rows, caption)


def not_told_apart(case: Case) -> list[Part]:
    """Sentences for the pairs that look alike, and the matrix."""
    found = case.findings.separability
    if not found:
        return [Sentence("Fewer than two effects were compared, so nothing is said about what looks alike.")]
    worst: dict[tuple[str, str], float] = {}  # of each pair, the direction in which it is told apart worse
    for (one, other), share in found.items():
        pair = (min(one, other), max(one, other))
        worst[pair] = min(share, worst.get(pair, 1.0))
    told: list[Part] = []
    for (one, other), share in sorted(worst.items(), key=lambda each: each[1]):
        if share < _HARDLY:
            how = "cannot tell" if share < _ALIKE else "can hardly tell"
            text = f"These sensors and settings {how} {plain(one)} from {plain(other)}"
            sentence = f"{text}: right in {probability(share)} of cases."
            told.append(Sentence(sentence, warning=share < _ALIKE))
    told = told or [Sentence("Whatever was compared is told apart in 95 of 100 cases or more.")]
    names = list(dict.fromkeys(one for one, _ in found))
    rows = [
        [plain(one), *(probability(found[one, other]) if (one, other) in found else "" for other in names)]
        for one in names
    ]
    return [*told, Sentence(_MATRIX), Table(["", *map(plain, names)], rows)]


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
    runs = [quote(path) for path in case.diagnosis.get("runs", [])] or ["RUN.mcap"]
    model = case.diagnosis.get("provenance", {}).get("model")
    given = f"--effects {quote(str(case.folder / 'effects.json'))}"
    given += f" --model {quote(model)}" if model else ""
    with_these = "To repeat it with these effects, or with others of your own:"
    if wrong := [plain(cause.name) for cause in found.selected if cause.entered]:
        left = "with the effects alone more of the gap is left"
        with_these = f"Correct {listed(wrong)} first: {left}. {with_these}"
    again = f"rattle gap {' '.join(runs)} {given}\nrattle overlay {runs[0]} {given}"
    if case.subject:
        asked = case.diagnosis["provenance"]
        with_these = "To repeat it:"
        again = f"rattle diagnose --subject {quote(case.subject)} {' '.join(runs)}"
        again += f" --out {quote(str(case.folder))}"
        again += "".join(f" --{name} {asked[name]}" for name in ("seed", "seeds", "rigs"))
    return [
        Table(("run", "scenario"), rows, "Runs", words=True),
        Sentence(
            f"The recordings' own blocks lie {floors(found.gap.recording)} from their mean, in the "
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
        Sentence(with_these),
        Listing(again),
    ]

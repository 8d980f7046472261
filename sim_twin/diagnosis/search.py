"""Simulates where it tells most: every cause first, then what explains the measurement, alone or in pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import factorial, prod

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Cause, Hypothesis, allowed_by, drawn, parts_of, places_of, values_of
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.gap import gap_measure
from sim_twin.diagnosis.library import FEWEST, TOGETHER, Library, Order, learned, order_of
from sim_twin.diagnosis.posterior import Estimate, Posterior
from sim_twin.diagnosis.screening import Screening, layout_of, numbers_of
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.subject import Doubtful, Draw, Execute, Observed, OfRuns, Subject

Array = NDArray[np.float64]
BEFOREHAND = (0.35, 0.45, 0.17, 0.03)
"""What is believed of nothing, one, two or three effects being missing."""
_FIRST = 0.45
_REFINED = (0.17, 0.18, 0.12, 0.08)
_PARTNERS_IN = 1
"""Shares of the motions: every cause evenly, then round by round what explains the measurement; in one of
the rounds the leading effect with each other one."""
_NEEDS_PARTNER = 0.5
"""Misfit of the leading effect from which on that round is spent on its partners."""
_EACH_PARTNER = 8
_HEALTHY_SHARE = 0.2
_FEWEST_HEALTHY = 50
_FEWEST_EACH = 9
_FEWEST_AT_ONCE = 6
_PAIRS_LOOKED_AT = 24
_PAIRS_SIMULATED = 6
_PARTNERS = 8
_LEAVES_ROOM = 0.2
"""Misfit of the best explanation by one effect, below which a second one has nothing to explain."""
_LEAST_SHARE = 0.004
_FROM_PRIOR = 0.1
_FROM_WIDER, _WIDER = (0.3, 0.3, 0.1, 0.0), 0.2
"""Of each round's motions, the share about places of the posterior whose weights are taken to that power."""
_RULED_OUT = 8.0
"""Below the best in the logarithm of the evidence: emulators of a dozen rigs are off by a few at most. By
all runs, or by some that one effect nearly explains."""
_LEFT_IN = 4
"""Effects that stay in the search whatever one run says: the best needs rivals to be held against."""
_OPEN, _BROUGHT_BACK = 1.0, 8
"""Misfit of the best explanation after a closer look (of one effect in another engine's rig, one in ten has
it) from which on so many of what was ruled out by itself are looked at beside it."""
_SURE = 3.0
"""Lead over each other in the logarithm of the evidence; a round of more rigs moves it by one or two."""
_FITS = 1.5
"""Misfit up to which the runs are explained: two deviations more than what the catalogue holds leaves of
another engine's rigs (see `belief`)."""
_NEARLY_FITS = 3.0
"""Misfit up to which one effect that leads is looked at more closely before more is spent."""
_DOUBTED = 0.3
"""That any value was entered wrongly, as a share of what is believed beforehand of all effects."""
_DISTINCT = 40
_STEP = 0.02
"""Of a parameter's whole range."""


@dataclass(frozen=True, slots=True)
class Ranked:
    """One hypothesis after the search: its share of belief among all, its posterior, what it leaves."""

    hypothesis: Hypothesis
    probability: float
    posterior: Posterior
    misfit: float

    def values(self) -> Array:
        """Parameters of the posterior's places, shape (n, parameters)."""
        return values_of(self.hypothesis, self.posterior.places)

    def best(self) -> Array:
        """The middle of the posterior, shape (parameters,); its most probable place where that may not be."""
        values = self.values()
        middle = np.array([e.value for e in self.estimates()])
        if not allowed_by(self.hypothesis, middle[None])[0]:
            return np.asarray(values[self.posterior.likeliest])
        place = places_of(self.hypothesis, middle[None])[0]
        central = self.posterior.central(place)
        return middle if central is place else np.asarray(values_of(self.hypothesis, central[None])[0])

    def estimates(self) -> list[Estimate]:
        """Median and interval of each parameter in order; of an angle, about the mean direction."""
        parameters = [p for cause in self.hypothesis for p in cause.parameters]
        weights, found = self.posterior.weights, []
        for parameter, values in zip(parameters, self.values().T, strict=True):
            turning = parameter.unit == "rad"
            about = float(np.angle(np.sum(weights * np.exp(1j * values)))) if turning else 0.0
            off = np.angle(np.exp(1j * (values - about))) if turning else values
            low, middle, high = (about + quantile(off, weights, share) for share in (0.025, 0.5, 0.975))
            found.append(Estimate(middle, low, high))
        return found


@dataclass(frozen=True, slots=True)
class Weighed:
    """One hypothesis by itself: the logarithm of prior times evidence, its posterior, what it leaves."""

    hypothesis: Hypothesis
    log: float
    posterior: Posterior
    misfit: float


def believed(weighed: Sequence[Weighed]) -> list[Ranked]:
    """All hypotheses by their share of belief."""
    logs = np.array([each.log for each in weighed])
    belief = np.exp(logs - logs.max())
    belief /= belief.sum()
    ranked = [
        Ranked(each.hypothesis, float(share), each.posterior, each.misfit)
        for each, share in zip(weighed, belief, strict=True)
    ]
    return sorted(ranked, key=lambda each: -each.probability)


def leads(ranked: Sequence[Ranked], before: Ranked | None, whole: bool) -> bool:
    """Whether another round would put the same first: it leads each other clearly, and did so `before`.

    One effect leads at once, where the first look was `whole`, if it rules out all others. Those with a
    second one beside it need only lie clearly below: that is looked for where the first leaves something.
    """
    first = ranked[0]
    again = before is not None and before.hypothesis == first.hypothesis
    single = first.hypothesis[0] if whole and len(first.hypothesis) == 1 else None
    if not again and (single is None or single.entered):
        return False
    for each in ranked[1:]:
        lead = _SURE if again or single in each.hypothesis else _RULED_OUT
        if first.probability <= np.exp(lead) * each.probability:
            return False
    return True


@dataclass(frozen=True, slots=True)
class _Seen:
    """A subject that is not simulated any more."""

    layout: Layout
    causes: tuple[Cause, ...]

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        return [() for _ in draws]


def doubts_of(subject: Subject) -> tuple[Cause, ...]:
    """Values of a subject that may have been entered wrongly, if it says any."""
    return subject.doubts if isinstance(subject, Doubtful) else ()


def in_order(*causes: Cause) -> Hypothesis:
    """Several are one hypothesis, whichever was found first."""
    return tuple(sorted(causes, key=lambda cause: (cause.name, cause.channel or "")))


def quantile(values: Array, weights: Array, share: float) -> float:
    """The value below which `share` of the weight lies."""
    order = np.argsort(values)
    at = np.searchsorted(np.cumsum(weights[order]), share * weights.sum())
    return float(values[order[min(at, len(values) - 1)]])


@dataclass(slots=True)
class Search:
    """A library that grows towards what explains `measured` (blocks, numbers), see `diagnose`."""

    subject: Subject
    measured: NDArray[np.float32]
    execute: Execute
    rng: np.random.Generator
    library: Library
    motions: int
    told: Sequence[float] = ()
    causes: Sequence[Cause] = ()
    """What is searched for; none given: all of the subject's."""
    of_longest: int = 0
    """Motions that the longest run would have by itself; none said: as many. The first look is that of this
    run, as far as there are so many; of the others hardly more is simulated than it leaves open, and rounds
    have what that saves, as far as this run would. Runs are taken as equally long."""
    doubting: bool = True
    """Whether values that may have been entered wrongly are looked at where nothing else explains it."""
    _screening: Screening | None = None
    _ruled_out: dict[Hypothesis, Weighed] = field(default_factory=dict)
    """By the runs that were looked at first; logarithms are those below the best."""
    _seen_first: tuple[int, ...] = ()
    _rest: float = 0.0
    _number: int = 0
    _before: Ranked | None = None
    _leading: Ranked | None = None
    """Motions and rounds, and what came first in the last; what leads, as far as anything does."""
    _all_done: bool = True
    _learnt: tuple[Library, int, Attribution] | None = None
    """What was learnt last, of which library when it held so many observations."""

    def __post_init__(self) -> None:
        self.causes, self.of_longest = self.causes or self.subject.causes, self.of_longest or self.motions

    def until_one_leads(self) -> tuple[Attribution, list[Ranked]]:
        """Spend the motions, as far as they tell, or until one effect leads that nearly fits.

        Rigs about that one tell more of it than further rounds: responses as sharp as a resonance lie between
        those that were simulated. The most probable hypothesis comes first.
        """
        self._rest = min(self.motions - self._first_look(), (1 - _FIRST) * self.of_longest)
        return self._rounds(doubtful=False)

    def go_on(self) -> tuple[Attribution, list[Ranked]]:
        """Spend what is left, until what leads fits as well."""
        return self._rounds(doubtful=True)

    @property
    def may_go_on(self) -> bool:
        """Whether what leads may be something else, and there is something left to spend."""
        leading, most = self._leading, _OPEN if self._ruled_out else _FITS
        return leading is not None and leading.misfit > most and self._number < len(_REFINED)

    @property
    def whole(self) -> bool:
        """Whether there was time for all so far."""
        return self._all_done and (self._screening is None or self._screening.whole)

    def _rounds(self, doubtful: bool) -> tuple[Attribution, list[Ranked]]:
        """Round by round what is left, until what leads fits; nearly, of one effect not `doubtful`."""
        while self._number < len(_REFINED):
            number = self._number
            motions = int(self._rest * _REFINED[number] / sum(_REFINED[number:]))
            alone, ranked = self._weighed()
            if doubtful and ranked[0].misfit > _OPEN and self._bring_back():
                alone, ranked = self._weighed()
            leading = self._leading = ranked[0] if leads(ranked, self._before, self.whole) else None
            nearly = not doubtful and leading is not None and len(leading.hypothesis) == 1
            if leading and leading.misfit <= (_NEARLY_FITS if nearly else _FITS):
                break
            if number > 0 and ranked[0].misfit > _OPEN and self._bring_back():
                alone, ranked = self._weighed()
            order = Order()
            if number == _PARTNERS_IN and alone[0].misfit > _NEEDS_PARTNER:
                order = self.partners(alone[0], motions, _FROM_WIDER[number])
            order += self.next_order(ranked, motions - len(order), _FROM_WIDER[number])
            self._rest -= len(order)
            if number > 0 and ranked[0].misfit > _OPEN:
                order += self._doubts()
            # what there was no time for leaves nothing settled
            self._before = ranked[0] if self._do(order) else None
            self._number += 1
        return self._in_the_end()

    def _weighed(self) -> tuple[list[Ranked], list[Ranked]]:
        """What is believed so far, of effects alone, and with pairs of them."""
        attribution = self.learn()
        weighed = self.weigh(attribution, self.singles())
        alone = ranked = believed(weighed)
        if alone[0].misfit > _LEAVES_ROOM:
            ranked = believed([*weighed, *self.weigh(attribution, self.promising_pairs(attribution, alone))])
        return alone, ranked

    def _in_the_end(self) -> tuple[Attribution, list[Ranked]]:
        """What the library says of all that was looked at, with more effort."""
        attribution = self.learn()
        pairs = [h for h in attribution.emulators if len(h) == 2]
        weighed = self.weigh(attribution, [*self.singles(), *pairs], effort=2.0)
        best = max(each.log for each in weighed)
        gone = [replace(each, log=best + each.log) for each in self._ruled_out.values()]
        return attribution, believed([*weighed, *gone])

    def _doubts(self) -> Order:
        """What else may be wrong, from now on: values that were entered wrongly, each evenly."""
        doubts = doubts_of(self.subject)
        if not doubts or not self.doubting:
            return Order()
        self.doubting = False
        self.causes = [*self.causes, *doubts]
        return order_of({(cause,): drawn((cause,), FEWEST, self.rng) for cause in doubts}, self.rng)

    def doubt(self) -> bool:
        """Look at values that may have been entered wrongly, if nobody has; whether there are any."""
        order = self._doubts()
        if len(order):
            self._do(order)
        return any(cause.entered and self.library.count((cause,)) >= FEWEST for cause in self.causes)

    def _first_look(self) -> float:
        """Healthy rigs and every cause, of further runs what is not ruled out; returns how many motions."""
        healthy, causes = self.first_order()
        self._do(healthy)
        layout = self.subject.layout
        runs = sorted({cell.run for cell in layout.cells})
        if len(runs) == 1 or not isinstance(self.subject, OfRuns):
            self._do(causes)
            self._require_enough()
            return len(healthy) + len(causes)
        if not self.library.count(()):
            self._require_enough()
        screening = self._screening = Screening(causes, self.execute)
        every: list[Hypothesis] = [(cause,) for cause in self.causes]
        wanted, seen = list(every), list[int]()
        for run in self._telling(runs):
            screening.observe(run, wanted)
            seen.append(run)
            if len(seen) < len(runs):
                wanted = self._not_ruled_out(screening, sorted(seen), wanted)
        screening.add_to(self.library, runs, wanted)
        self._require_enough()
        return len(healthy) + screening.asked / len(runs)

    def _telling(self, runs: Sequence[int]) -> list[int]:
        """Runs in the order in which they lie off the nominal twin."""
        measure = gap_measure(self.library.fingerprints(()), self.subject.layout)
        gaps = measure.of_runs(self.measured)
        return [runs[k] for k in np.argsort(gaps)[::-1]]

    def _not_ruled_out(
        self, screening: Screening, seen: Sequence[int], among: Sequence[Hypothesis]
    ) -> list[Hypothesis]:
        """What could still be there after a look at some runs; all of it where nothing explains them."""
        part = self._first_seen(screening, seen, among)
        part._require_enough(among)
        weighed = part.weigh(part.learn(), [(), *among])
        best = max(weighed, key=lambda each: each.log)
        if best.misfit > (_NEARLY_FITS if best.hypothesis else _FITS):
            return list(among)
        effects = sorted((each for each in weighed if each.hypothesis), key=lambda each: -each.log)
        out = [each for each in effects[_LEFT_IN:] if each.log < best.log - _RULED_OUT]
        if out and not self._seen_first:
            self._seen_first = tuple(seen)
        self._ruled_out |= {each.hypothesis: replace(each, log=each.log - best.log) for each in out}
        return [h for h in among if h not in self._ruled_out]

    def _first_seen(self, screening: Screening, runs: Sequence[int], wanted: Sequence[Hypothesis]) -> Search:
        """The search as far as some runs tell of what was first seen of them."""
        library = self.library.of([()], numbers_of(self.subject.layout, runs))
        screening.add_to(library, runs, wanted)
        return self.of_runs(runs, library)

    def of_runs(self, runs: Sequence[int], library: Library) -> Search:
        """The same as far as some runs tell, whose fingerprints are in `library`; it simulates nothing."""
        layout = layout_of(self.subject.layout, runs)
        subject = _Seen(layout, tuple(self.causes))
        return replace(
            self,
            subject=subject,
            measured=self.measured[:, numbers_of(self.subject.layout, runs)],
            execute=subject.observe,
            library=library,
            told=tuple(self.told[run] for run in runs) if self.told else (),
        )

    def _bring_back(self) -> bool:
        """Look at all runs for what may be beside others, though it was ruled out by itself."""
        screening = self._screening
        if screening is None or not self._ruled_out:
            return False
        every: list[Hypothesis] = [(cause,) for cause in self.causes]
        part = self._first_seen(screening, self._seen_first, every)
        attribution = part.learn()
        pairs = part.promising_pairs(attribution, believed(part.weigh(attribution, part.singles())))
        alone = dict.fromkeys((cause,) for pair in pairs for cause in pair)
        return self.bring_back([h for h in alone if h in self._ruled_out][:_BROUGHT_BACK])

    def bring_back(self, ruled_out: Sequence[Hypothesis]) -> bool:
        """Look at all runs for some of what was ruled out by those looked at first; whether any came."""
        screening = self._screening
        back = [h for h in ruled_out if h in self._ruled_out]
        if screening is None or not back:
            return False
        runs = sorted({cell.run for cell in self.subject.layout.cells})
        asked = screening.asked
        for run in runs:
            screening.observe(run, back)
        self._rest -= (screening.asked - asked) / len(runs)
        screening.add_to(self.library, runs, back)
        back = [h for h in back if self.library.count(h) >= FEWEST]
        for h in back:
            del self._ruled_out[h]
        return bool(back)

    def learn(self) -> Attribution:
        """What the library says so far."""
        library, held = self.library, self.library.observations
        if self._learnt is None or self._learnt[0] is not library or self._learnt[1] != held:
            moments = Moments(self.subject.layout)
            each = [len(self.measured)] * (int(moments.runs.max()) + 1)
            self._learnt = library, held, learned(library, moments, self.told or each)
        return self._learnt[2]

    def singles(self) -> list[Hypothesis]:
        """Nothing, and every effect alone."""
        return [
            (),
            *((cause,) for cause in self.causes if self.library.count((cause,)) >= FEWEST),
        ]

    def first_order(self) -> tuple[Order, Order]:
        """Healthy rigs; and every cause evenly over its parameters, more of those with many.

        Those of sensors share motions.
        """
        causes = self.causes
        motions = min(self.motions, int(_FIRST * self.of_longest))
        healthy = max(_FEWEST_HEALTHY, int(_HEALTHY_SHARE * motions))
        # by the dimensions of the space in which its response is nearly straight
        any_place = {cause: drawn((cause,), 1, np.random.default_rng(0)) for cause in causes}
        weight = {cause: np.sqrt(cause.coordinates(any_place[cause]).shape[1]) for cause in causes}
        together = sum(weight[cause] / (TOGETHER if cause.sensing else 1) for cause in causes)
        each = (motions - healthy) / max(1.0, together)
        cases: dict[Hypothesis, Array] = {
            (cause,): drawn((cause,), max(_FEWEST_EACH, int(each * weight[cause])), self.rng)
            for cause in causes
        }
        return order_of({(): np.zeros((healthy, 0))}, self.rng, blocks=2), order_of(cases, self.rng)

    def promising_pairs(self, attribution: Attribution, ranked: Sequence[Ranked]) -> list[Hypothesis]:
        """Pairs whose responses, added up, explain the measurement best; one of each is a likely cause."""
        place = attribution.place(self.measured).mean(axis=0)
        causes = [each.hypothesis[0] for each in ranked if each.hypothesis]
        likely = _PARTNERS if ranked[0].misfit > _NEEDS_PARTNER else 1
        pairs = [
            in_order(first, second)
            for k, first in enumerate(causes[:likely])
            for second in causes[k + 1 :]
            if first.name != second.name or first.channel
        ]
        found = attribution.glances(pairs, place, self.rng)
        best = [pairs[k] for k in np.argsort(found)[::-1][:_PAIRS_LOOKED_AT]]
        # of a pair that was simulated more is known than the sum
        return list(dict.fromkeys([*best, *(pair for pair in pairs if pair in attribution.emulators)]))

    def partners(self, leading: Ranked, motions: int, wider: float) -> Order:
        """The leading effect, as it may be here, with each other one that moves: their sum need not hold."""
        moving = [c for c in self.causes if not (c.sensing or c.entered) and (c,) != leading.hypothesis]
        if len(leading.hypothesis) != 1 or not moving:
            return Order()
        each = min(_EACH_PARTNER, motions // len(moving))
        if each < _FEWEST_AT_ONCE:
            return Order()
        cases: dict[Hypothesis, Array] = {}
        for partner in moving:
            pair = in_order(leading.hypothesis[0], partner)
            values = drawn(pair, each, self.rng)
            at = parts_of(pair)[pair.index(leading.hypothesis[0])]
            values[:, at] = self._around(leading, each, wider)
            cases[pair] = values
        return order_of(cases, self.rng)

    def weigh(
        self, attribution: Attribution, hypotheses: Sequence[Hypothesis], effort: float = 1.0
    ) -> list[Weighed]:
        """How well each hypothesis explains the measurement."""
        place = attribution.place(self.measured).mean(axis=0)
        # effects are alike beforehand, however many channels they may sit on
        names = [cause.name for cause in self.causes if not cause.entered]
        share = {name: 1 / len(set(names)) / names.count(name) for name in names}
        entered = [cause.name for cause in self.causes if cause.entered]
        share |= {name: _DOUBTED / len(entered) for name in entered}
        whole = sum(share[cause.name] for cause in self.causes)
        share = {name: part / whole for name, part in share.items()}
        found = []
        for h in hypotheses:
            prior = BEFOREHAND[len(h)] * factorial(len(h)) * prod(share[cause.name] for cause in h)
            posterior = attribution.posterior(h, place, self.rng, effort)
            best = values_of(h, posterior.places[[posterior.likeliest]])
            misfit = float(attribution.misfit(h, best, place)[0])
            found.append(Weighed(h, posterior.log_evidence + float(np.log(prior)), posterior, misfit))
        return found

    def _require_enough(self, wanted: Sequence[Hypothesis] | None = None) -> None:
        """An effect that was not simulated cannot be ruled out; neither can anything without healthy rigs."""
        if wanted is None:
            wanted = [(c,) for c in self.causes if (c,) not in self._ruled_out]
        missing = [h[0].name for h in wanted if self.library.count(h) < FEWEST]
        if missing or self.library.count(()) < _FEWEST_HEALTHY // 3:
            what = ", ".join(dict.fromkeys(missing)) or "healthy rigs"
            failed = self.library.failed
            advice = "give it more time: --budget"
            if failed > self.library.observations:
                advice = f"{failed} simulations failed; try the scenario's [model] by rattle predict"
            raise SimulationFailed(f"not enough was simulated of {what}", advice, None)

    def next_order(self, ranked: Sequence[Ranked], motions: int, wider: float) -> Order:
        """More of what is believed, about where it is believed."""
        if motions < _FEWEST_AT_ONCE:
            return Order()
        kept = [each for each in ranked if each.hypothesis and each.probability > _LEAST_SHARE]
        several = [each for each in kept if len(each.hypothesis) > 1][:_PAIRS_SIMULATED]
        chosen = [each for each in kept if len(each.hypothesis) == 1] + several
        if not chosen:
            chosen = [each for each in ranked if each.hypothesis][:3]
        weight = np.sqrt([each.probability for each in chosen])
        cost = np.array([1 / TOGETHER if all(c.sensing for c in each.hypothesis) else 1.0 for each in chosen])
        counts = np.maximum(_FEWEST_AT_ONCE, motions * weight / np.sum(weight * cost)).astype(int)
        counts = np.minimum(counts, np.where(cost < 1, 150, motions))
        cases = {
            each.hypothesis: self._around(each, int(count), wider)
            for each, count in zip(chosen, counts, strict=True)
        }
        return order_of(cases, self.rng)

    def _around(self, ranked: Ranked, count: int, wider: float) -> Array:
        """Parameters from the posterior, flattened, a share from `wider` about it, and some from anywhere.

        Where responses are emulated from few rigs, the truth may lie in what is believed little as yet.
        """
        some = ranked.posterior.flattened(_DISTINCT).sample(count, self.rng)
        far = self.rng.uniform(size=count) < wider
        some[far] = ranked.posterior.tempered(_WIDER).sample(int(far.sum()), self.rng)
        moved = some + _STEP * self.rng.standard_normal(some.shape)
        near = values_of(ranked.hypothesis, np.clip(moved, 0.0, np.nextafter(1.0, 0.0)))
        anywhere = self.rng.uniform(size=count) < _FROM_PRIOR
        anywhere |= ~allowed_by(ranked.hypothesis, near)
        near[anywhere] = drawn(ranked.hypothesis, count, self.rng)[anywhere]
        return near

    def _do(self, order: Order) -> bool:
        """Simulate; whether there was time for all of it."""
        shown = self.execute(order.draws)
        self.library.add(order, shown)
        self._all_done &= all(shown)
        return all(shown)

"""The one checker: what emulated instruments sent against what a log holds.

Every index that was sent is in the log once or in `/gap`; nothing is there twice, and nothing that was not
sent; times rise, on one time base. Values tell that each index is the one that was sent, by the declared
scale. A log with a run's name has to be readable, to say how it ended, and to hold the tail of each channel
that it declares, measured or predicted; a test that ruins one says so: `ruined`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations, islice, pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.block import NS_PER_S, Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import LogError, RattleError
from daq.log.codec import decode_block
from daq.log.reader import LogReader
from daq.log.records import RECORD_END, RECORD_START, STOPPING, Event, Gap
from daq.log.recover import recover_log
from rig.files.scenario import parse_scenario
from rig.instruments import INSTRUMENTS
from rig.session.driven_rig import STOPPED
from rig.session.interlock import HUNG_S
from rig.session.run import PRE_TRIGGER_S, RECORDED

CRASH_S = 0.5
"""What a crash may cost of each stream, beyond what its samples came late by: that the log itself shows."""
_MOST_PLACES = 20_000
_SHIFTS = sorted(range(-30, 31), key=abs)
"""Places tried: clocks agree better than so many samples. Not fewer: when a card began the host knows by how
long the call took, on a busy machine half a millisecond. A block goes through whole: one sample in 101 of
every channel, with the ledger, tells where each block belongs.
"""
_ALIKE = 1e-5
_TIME_BASE_S = 0.1
_ANSWERS_S = 1.0
"""An instrument that is asked may take so long for what a crash then loses."""
_VOLTS = ("V",)
_ANALOG = (*_VOLTS, "")
_COUNT, _COUNTERS = "count", ("count", "edge", "Hz")
_COUNTER = 1 << 32
"""What the card's counters give; the first, of an encoder, begins anew there."""
ENCODER = "encoder.angle"
_OF_A_RUN = re.compile(r"_\d{8}-\d{6}-\d{3}\.mcap")
ONLY_A_HEAD = 64
"""Bytes: what a run that was killed as it opened its log leaves."""
_BEGINNINGS = (RECORD_START, "dwell.start")
_ENDINGS = (RECORD_END, "dwell.end", "drive.off")
_STANDS = "inverter.off"
"""Where a motor's stop has its end; that of a generator ends as it begins."""
_RUINED: set[Path] = set()
_DISK_FAILED: set[Path] = set()
_MADE_UP: set[Path] = set()


def ruined(log: Path) -> Path:
    """A log of a run that a test is about to spoil: from now on it is no run's."""
    _RUINED.add(log)
    return log


def disk_failed(log: Path) -> Path:
    """A log whose disk took nothing more from some time on: it holds what was read by then."""
    _DISK_FAILED.add(log)
    return log


def made_up(folder: Path) -> Path:
    """Where logs lie whose samples a test makes up: no emulated instrument sent them."""
    _MADE_UP.add(folder)
    return folder


@dataclass(slots=True)
class SentByCard:
    """A run of the card's sample clock: `made` samples of each input, some of which are `shown`, by index.

    Of each counter the same are `counted`. Somebody has `read` so many of them, told with each block made:
    what came after the last is not owed.
    """

    started_ns: int
    rate: float
    inputs: Sequence[str]
    made: int = 0
    shown: dict[int, list[float]] = field(default_factory=dict)
    counted: dict[int, list[int]] = field(default_factory=dict)
    read: int = 0


@dataclass(slots=True)
class SentByEncoder:
    """Frames since a node was started: due at (s, Unix epoch), counts, and whether sent as it should be."""

    counts_per_revolution: int
    unix_s: list[float] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    sent: list[bool] = field(default_factory=list)


@lru_cache(maxsize=64)
def _told(path: Path, size: int) -> list[SentByCard | SentByEncoder]:
    found: list[SentByCard | SentByEncoder] = []
    since_s = counts_per_revolution = None
    for line in path.read_bytes()[:size].splitlines():
        told = json.loads(line)
        if "started_ns" in told:
            found.append(SentByCard(told["started_ns"], told["rate"], told["inputs"]))
        elif "values" in told and isinstance(card := found[-1], SentByCard):
            assert told["first"] == card.made
            card.made, card.read = card.made + told["count"], told["read"]
            card.shown |= values_told(told)
            card.counted |= {int(index): counts for index, counts in told["counted"].items()}
        elif "counts_per_revolution" in told:
            counts_per_revolution = told["counts_per_revolution"]
        elif "frame" in told:
            if told["since_s"] != since_s:
                since_s = told["since_s"]
                found.append(SentByEncoder(counts_per_revolution or 1))
            if isinstance(encoder := found[-1], SentByEncoder):
                encoder.unix_s.append(told["unix_s"])
                encoder.counts.append(told["counts"])
                encoder.sent.append(told["sent"])
    return found


def values_told(told: Mapping[str, Any]) -> dict[int, list[float]]:
    """Of a card's inputs, by sample; the floats are told as hex of their bytes."""
    return {int(index): np.frombuffer(bytes.fromhex(each)).tolist() for index, each in told["values"].items()}


def sent_in(folder: Path) -> list[SentByCard | SentByEncoder]:
    """All that emulators kept in a folder."""
    return [each for path in folder.glob("*.jsonl") for each in _told(path, path.stat().st_size)]


def discrepancies(log: Path, sent: Sequence[SentByCard | SentByEncoder]) -> list[str]:
    """What of a log is not as it was sent; also of one that a crash cut, by what is recovered of it."""
    of_a_run = _OF_A_RUN.search(log.name) is not None
    if log in _RUINED or (of_a_run and log.stat().st_size < ONLY_A_HEAD):
        return []
    if not _MADE_UP.isdisjoint(log.parents):
        sent = ()
    try:
        with LogReader(log) as reader:
            complete = reader.complete
        if complete:
            return list(_compared(Log.of(log, of_a_run, None), sent))
        written_ns = log.stat().st_mtime_ns
        with TemporaryDirectory() as scratch:
            recover_log(log, Path(scratch) / "recovered.mcap")
            recovered = Log.of(Path(scratch) / "recovered.mcap", of_a_run, written_ns)
            return list(_compared(replace(recovered, disk_failed=log in _DISK_FAILED), sent))
    except LogError as error:
        return [f"it cannot be read: {error}"] if of_a_run else []


@dataclass(frozen=True, slots=True)
class Log:
    """What is in a log; `written_ns`: where a crash or a disk cut it, when it was last written."""

    of_a_run: bool
    written_ns: int | None
    gaps: list[Gap]
    events: list[Event]
    late_s: float
    series: dict[tuple[str, str], list[SampleBlock]]
    channels: dict[str, Channel]
    predicted: Sequence[str]
    scenario: str
    emulated: str
    disk_failed: bool = False

    @classmethod
    def of(cls, path: Path, of_a_run: bool, written_ns: int | None) -> Log:
        with LogReader(path) as log:
            series: dict[tuple[str, str], list[SampleBlock]] = {}
            for whose_samples, block in log.blocks(("measured", "predicted", "nominal")):
                series.setdefault((whose_samples, block.channel), []).append(block)
            return cls.of_series(log, series, of_a_run, written_ns, late_s(log))

    @classmethod
    def of_series(
        cls,
        log: LogReader,
        series: dict[tuple[str, str], list[SampleBlock]],
        of_a_run: bool,
        written_ns: int | None,
        late_s: float,
    ) -> Log:
        emulated = log.metadata.get("run", {}).get("emulated", "")
        channels = log.channels("measured"), list(log.channels("predicted"))
        told = log.gaps(), log.events(), late_s, series, *channels
        return cls(of_a_run, written_ns, *told, log.scenario, emulated)

    @property
    def measured(self) -> dict[str, list[SampleBlock]]:
        return {name: blocks for (origin, name), blocks in self.series.items() if origin == "measured"}

    @property
    def begin_ns(self) -> int | None:
        """When its sample 0 was due; None where no record was begun."""
        firsts = (blocks[0] for blocks in self.measured.values())
        begun = [sample_time_ns(each.time_ns, -each.first_sample, each.sample_rate) for each in firsts]
        begun = begun or [self.codes[code].time_ns for code in _BEGINNINGS if code in self.codes]
        return min(begun, default=None)

    def gaps_of(self, name: str, origin: str) -> list[Gap]:
        return [gap for gap in self.gaps if (gap.channel, gap.origin) == (name, origin)]

    @property
    def codes(self) -> dict[str, Event]:
        """The first event of each code; of the dwells the last."""
        of_dwells = [event for event in self.events if event.code == "dwell.end"]
        return {event.code: event for event in (*reversed(self.events), *of_dwells)}


def _compared(log: Log, sent: Sequence[SentByCard | SentByEncoder]) -> Iterator[str]:
    cards, encoder = cards_of(log.measured, sent), _encoder_of(log.measured.get(ENCODER, []), sent)
    places = [place_on_card(each, log) for each in cards]
    card, (offset, wrong) = min(
        zip(cards, places, strict=True), key=lambda each: len(each[1][1]), default=(None, (0, []))
    )
    yield from of_nobody(log, sent, card, encoder)
    if card is None and encoder is None and not (log.of_a_run and log.emulated):
        return  # it is of no emulator
    names = (("measured", list(log.channels)), ("predicted", log.predicted))
    declared = {(origin, name): list[SampleBlock]() for origin, each in names for name in each}
    for (origin, name), blocks in (declared | log.series).items():
        yield from (f"{origin} {name}: {wrong}" for wrong in tiled(blocks, log.gaps_of(name, origin)))
    yield from wrong
    until_ns = yield from ended_by(log, card, offset)
    if encoder is not None and "encoder.numbering" not in log.codes:
        place = place_on_encoder(encoder, log)
        if place is None:
            yield f"{ENCODER}: its values are not those that were sent"
            return
        yield from off_time_base(encoder, log, place)
        yield from tail_of_encoder(encoder, log, place, until_ns)


def ended_by(log: Log, card: SentByCard | None, offset: int) -> Generator[str, None, float]:
    """What its end lacks; returns until when (ns, Unix epoch) all that was sent has to be there."""
    if any(code in log.codes for code in _ENDINGS):
        made_up = {gap.channel for gap in log.gaps if gap.cause == STOPPED}
        yield from (f"{name}: said to be stopped, but it had its end" for name in sorted(made_up))
    until_ns, planned = _ending(log, card)
    if log.of_a_run and until_ns is None:
        yield "nothing says how it ended"
    if card is not None:
        yield from _of_card(log, card, offset, until_ns, planned)
        if until_ns == math.inf:
            end_ns = sample_time_ns(card.started_ns, offset + round(planned), card.rate)
            until_ns = end_ns - _TIME_BASE_S * NS_PER_S
    yield from _of_others(log, card, until_ns)
    return until_ns or 0.0


def of_nobody(
    log: Log,
    sent: Sequence[SentByCard | SentByEncoder],
    card: SentByCard | None,
    encoder: SentByEncoder | None,
) -> Iterator[str]:
    """What the log has of an emulator that, by its times, sent nothing then."""
    for table, came, found in (
        ("daq_card", _came_of_card(log), card),
        ("encoder", ENCODER in log.measured, encoder),
    ):
        if came and found is None and INSTRUMENTS[table].word in log.emulated:
            yield f"its emulated {INSTRUMENTS[table].word} sent nothing then"
    if card is not None or not log.of_a_run or INSTRUMENTS["daq_card"].word in log.emulated:
        return
    rates = {blocks[0].sample_rate for name, blocks in log.measured.items() if name != ENCODER}
    cards = (each for each in sent if isinstance(each, SentByCard))
    if any(each.made and each.rate in rates for each in cards):
        yield "no card that sent samples at its rate did so then"


def _came_of_card(log: Log) -> list[str]:
    """What may be a card's; of what a crash cut soon after its begin, others may be all that was written."""
    if log.written_ns is None:
        return list(log.measured)
    units = (*_VOLTS, *_COUNTERS)
    return [name for name in log.measured if name != ENCODER and log.channels[name].raw_unit in units]


def _of_card(
    log: Log, card: SentByCard, offset: int, until_ns: float | None, planned: float
) -> Iterator[str]:
    made, must = card.made - offset, planned
    if until_ns != math.inf:
        by_then = math.floor(((until_ns or 0) - card.started_ns) * card.rate / NS_PER_S) - offset
        must = min(by_then, made, planned)
    if log.written_ns is not None and must > 0 and len(there := _of_inputs(log, card)) != len(card.inputs):
        yield f"{len(there)} analog channels of {len(card.inputs)} inputs"
    for name, blocks in log.measured.items():
        if blocks[0].sample_rate != card.rate or name == ENCODER:
            continue
        yield from _complete(name, blocks, log.gaps, made, must)
        if name in log.predicted and log.of_a_run and log.written_ns is None:
            predicted = log.series.get(("predicted", name), [])
            yield from _complete(name, predicted, log.gaps, math.inf, blocks[-1].end_sample, "predicted")


def _of_others(log: Log, card: SentByCard | None, until_ns: float | None) -> Iterator[str]:
    """What is neither the card's nor the encoder's, and what was declared and never came."""
    owed_ns = (until_ns or 0) - _ANSWERS_S * NS_PER_S
    if (begin_ns := log.begin_ns) is None or owed_ns <= begin_ns:
        return
    for name in log.channels:
        if not (blocks := log.measured.get(name, [])):
            if not log.gaps_of(name, "measured"):
                yield f"{name}: declared, but nothing of it is there"
        elif name != ENCODER and (card is None or blocks[0].sample_rate != card.rate):
            must = math.floor((owed_ns - begin_ns) / NS_PER_S * blocks[0].sample_rate)
            yield from _complete(name, blocks, log.gaps, math.inf, must)


def late_s(log: LogReader, channel: str | None = None) -> float:
    """By how much the samples of a log, or of a channel, came later than they were taken, at most."""
    late_ns, names = 0, log.channels("measured") if channel is None else [channel]
    for message in log.messages([f"/measured/{name}" for name in names]):
        block = decode_block("", message.data)
        if not block.flags & Flag.CLOCK_NOT_LOCKED:
            late_ns = max(
                late_ns, message.log_ns - sample_time_ns(block.time_ns, len(block), block.sample_rate)
            )
    return late_ns / NS_PER_S


def _ending(log: Log, card: SentByCard | None) -> tuple[float | None, float]:
    """Until when (ns, Unix epoch) all that was sent has to be there, and how many samples were planned.

    Infinite: all that was planned. None where nothing tells.
    """
    planned = math.inf
    if card is not None and not any(code.startswith(("dwell.", "centring.")) for code in log.codes):
        planned = _planned(log.scenario, card.rate)
    if (ended := next((log.codes[code] for code in _ENDINGS if code in log.codes), None)) is not None:
        if ended.text == RECORDED and math.isfinite(planned):
            return math.inf, planned
        return ended.time_ns - (HUNG_S + log.late_s) * NS_PER_S, planned
    if STOPPING in log.codes:
        stood = [event.time_ns for event in log.events if event.code == _STANDS]
        return max([log.codes[STOPPING].time_ns, *(at - _TIME_BASE_S * NS_PER_S for at in stood)]), planned
    if log.written_ns is not None:
        # A crash came when the run had read its last, however long before that its writer wrote.
        cut_ns = log.written_ns
        if card is not None and not log.disk_failed:
            cut_ns = sample_time_ns(card.started_ns, card.read, card.rate)
        return cut_ns - (CRASH_S + log.late_s) * NS_PER_S, planned
    return None, planned


def tiled(blocks: Sequence[SampleBlock], gaps: Sequence[Gap], expected: int = 0) -> Iterator[str]:
    """Every index from `expected` on once, in a block or in a gap; times rise."""
    spans = [(block.first_sample, block.end_sample, "block") for block in blocks]
    spans += [(gap.first_sample, gap.first_sample + gap.count, f"gap ({gap.cause})") for gap in gaps]
    for first, end, what in sorted(spans):
        if first < expected:
            yield f"{what} from {first}: index {first} is there twice"
        elif first > expected:
            yield f"indices {expected} to {first - 1} are neither there nor in /gap, before a {what}"
        expected = max(expected, end)
    for before, after in pairwise(blocks):
        if after.time_ns <= before.time_ns:
            yield f"time goes back at index {after.first_sample}"


def _planned(scenario: str, rate: float) -> float:
    """Samples of a whole record."""
    try:
        wanted = parse_scenario(scenario).acquisition
    except RattleError:
        return math.inf
    return round(wanted.duration * rate) + (0 if wanted.settle > 0 else round(PRE_TRIGGER_S * rate))


def cards_of(
    measured: Mapping[str, Sequence[SampleBlock]], sent: Sequence[SentByCard | SentByEncoder]
) -> list[SentByCard]:
    """Those that sampled then, several where runs went on beside each other; the last to begin first."""
    begins = {blocks[0].sample_rate: blocks[0].time_ns for blocks in measured.values()}
    cards = [each for each in sent if isinstance(each, SentByCard) and each.rate in begins]
    within = [
        each
        for each in cards
        if -0.1 < (begins[each.rate] - each.started_ns) / NS_PER_S < each.made / each.rate + 0.1
    ]
    return sorted(within, key=lambda each: -each.started_ns)


def place_on_card(card: SentByCard, log: Log, known: int | None = None) -> tuple[int, list[str]]:
    """Which sample of the card is the record's first, by time and then by values, if that is not `known`."""
    declared = _of_inputs(log, card)
    came = [name for name in declared if name in log.measured]
    of_card = (blocks[0] for name, blocks in log.measured.items() if name != ENCODER)
    first = next((block for block in of_card if block.sample_rate == card.rate), None)
    if first is None:
        return 0, []
    begin_s = (first.time_ns - card.started_ns) / NS_PER_S - first.first_sample / card.rate
    near = round(begin_s * card.rate)
    if not came:
        return near, []
    inputs = range(len(card.inputs))
    if len(came) == len(inputs):
        places = iter([tuple(inputs)])
    elif max(len(came), len(declared)) > len(inputs) or log.written_ns is None:
        return near, [f"{len(came)} analog channels of {len(inputs)} inputs"]
    elif len(declared) == len(inputs):
        places = iter([tuple(declared.index(name) for name in came)])
    else:  # a crash soon after the begin: some were not declared yet, so values tell which came
        places = islice(combinations(inputs, len(came)), _MOST_PLACES)
    logged = [_whole(log.measured[name]) / (log.channels[name].scale or 1.0) for name in came]
    counters = [name for name in log.channels if log.channels[name].raw_unit in _COUNTERS and name != ENCODER]
    counts = {
        row: np.rint(_whole(log.measured[name]) / (log.channels[name].scale or 1.0))
        for row, name in enumerate(counters)
        if log.channels[name].raw_unit == _COUNT and name in log.measured
    }
    turns = {row: round(math.tau / (log.channels[counters[row]].scale or 1.0)) for row in counts}
    for rows, offset in product(places, _tried(near, known)):
        of_rows = zip(rows, logged, strict=True)
        if all(_alike(card, row, values, offset) for row, values in of_rows) and all(
            _counts_alike(card, row, turns[row], each, offset) for row, each in counts.items()
        ):
            return offset, []
    told = [*came, *(counters[row] for row in counts)]
    return near, [f"the values of {', '.join(told)} are not those that were sent"]


def _tried(near: int, known: int | None) -> list[int]:
    return [near + shift for shift in _SHIFTS] if known is None else [known]


def _of_inputs(log: Log, card: SentByCard) -> list[str]:
    """What is declared of a card's analog inputs."""
    return [
        name
        for name, channel in log.channels.items()
        if channel.raw_unit in (_ANALOG if name in log.measured else _VOLTS)
        and (name not in log.measured or log.measured[name][0].sample_rate == card.rate)
    ]


def _whole(blocks: Sequence[SampleBlock]) -> NDArray[np.float64]:
    """Samples from index 0 on, NaN where none is."""
    values = np.full(blocks[-1].end_sample, np.nan)
    for block in blocks:
        values[block.first_sample : block.end_sample] = block.values
    return values


def _pairs(
    shown: Mapping[int, Sequence[float]], row: int, logged: NDArray[np.float64], offset: int
) -> list[tuple[float, float]]:
    """What came and what was sent."""
    return [
        (logged[index - offset], values[row])
        for index, values in shown.items()
        if row < len(values) and 0 <= index - offset < len(logged) and math.isfinite(logged[index - offset])
    ]


def _counts_alike(card: SentByCard, row: int, turn: int, logged: NDArray[np.float64], offset: int) -> bool:
    """Whether an unwrapped count is what was sent, forwards or backwards, but for whole turns of either."""
    came, gone = np.array(_pairs(card.counted, row, logged, offset)).reshape(-1, 2).T
    gone = np.where(gone < _COUNTER / 2, gone, gone - _COUNTER)
    return any(not ((came - sign * gone) % whole).any() for sign in (1, -1) for whole in (turn, _COUNTER))


def _alike(card: SentByCard, row: int, logged: NDArray[np.float64], offset: int) -> bool:
    """Whether samples, by the declared scale in what the card delivers, are what was sent."""
    came, gone = np.array(_pairs(card.shown, row, logged, offset)).reshape(-1, 2).T
    return bool((np.abs(came - gone) <= _ALIKE * np.abs(gone).max(initial=0.0)).all())


def _complete(
    name: str,
    blocks: Sequence[SampleBlock],
    gaps: Sequence[Gap],
    sent: float,
    must: float,
    origin: str = "measured",
) -> Iterator[str]:
    end = blocks[-1].end_sample if blocks else 0
    if end > sent:
        yield f"{name}: {end} samples, but only {sent} were sent"
    ends = [gap.first_sample + gap.count for gap in gaps if (gap.channel, gap.origin) == (name, origin)]
    accounted = max(end, *ends, 0)
    if accounted < must:
        yield f"{origin} {name}: {must} samples were sent, of which the last {must - accounted} are nowhere"


def _encoder_of(
    blocks: Sequence[SampleBlock], sent: Sequence[SentByCard | SentByEncoder]
) -> SentByEncoder | None:
    if not blocks:
        return None
    begin_s = blocks[0].time_ns / NS_PER_S
    encoders = (each for each in sent if isinstance(each, SentByEncoder))
    return next((each for each in encoders if each.unix_s[0] - 0.1 < begin_s < each.unix_s[-1] + 0.1), None)


def place_on_encoder(encoder: SentByEncoder, log: Log, known: int | None = None) -> int | None:
    """Which frame is the record's first, as on a card; None where the values are not those that were sent."""
    blocks, scale = log.measured[ENCODER], log.channels[ENCODER].scale or 1.0
    turn = encoder.counts_per_revolution
    index = np.concatenate([np.arange(block.first_sample, block.end_sample) for block in blocks])
    counts = np.rint(np.concatenate([block.values for block in blocks]) / scale).astype(np.int64) % turn
    unix_s, sent = np.array(encoder.unix_s), np.array(encoder.sent)
    shown = np.array(encoder.counts) % turn
    first = blocks[0]
    near = int(np.abs(unix_s - first.time_ns / NS_PER_S).argmin()) - first.first_sample
    fits = (
        offset
        for offset in _tried(near, known)
        if offset + index[0] >= 0
        and offset + index[-1] < len(shown)
        and (shown[offset + index] == counts).all()
        and sent[offset + index].all()
    )
    return next(fits, None)


def off_time_base(encoder: SentByEncoder, log: Log, offset: int) -> Iterator[str]:
    for block in log.measured[ENCODER]:
        off_s = block.time_ns / NS_PER_S - encoder.unix_s[offset + block.first_sample]
        if abs(off_s) > _TIME_BASE_S and not block.flags & Flag.CLOCK_NOT_LOCKED:
            yield f"{ENCODER}: index {block.first_sample} is {off_s:.3f} s off the time base"


def tail_of_encoder(encoder: SentByEncoder, log: Log, offset: int, until_ns: float) -> Iterator[str]:
    unix_s, sent = np.array(encoder.unix_s), np.array(encoder.sent)
    due = (sent & (unix_s < until_ns / NS_PER_S)).nonzero()[0]
    if due.size:
        must = int(due[-1]) + 1 - offset
        yield from _complete(ENCODER, log.measured[ENCODER], log.gaps, len(sent) - offset, must)

"""Checks a log sample by sample, and rebuilds one that a crash left without its end."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType
from typing import get_args

from daq.block import LATEST, NS_PER_S, SampleBlock
from daq.errors import LogError, RecorderFailed
from daq.log.codec import decode_block, decode_record
from daq.log.front import ANOTHER, CUT
from daq.log.reader import LogReader, Origin, origin_and_name
from daq.log.records import Gap
from daq.log.writer import LogWriter

LOST, UNWRITTEN = "lost in a damaged log", "not written before the log was cut"
RECOVERED, EVERYTHING = "recovered", "everything"
"""The metadata record in which a recovered log says what it comes from; where only the rest was damaged."""
_WHOLE_NUMBER = re.compile("[0-9]{1,40}")
_UNCHECKED, _LEFT_OUT, _ALL_TOLD = "unchecked", "left_out", "all_told"
"""Of its keys."""
_SOONER, _SOONER_S = 0.25, 0.025
"""Of a block, and s at most: by so much less than a block after the last one the next was due."""
_AGAIN = (
    "{topic}: sample {number} comes twice, as where another recording begins: nothing from there on is kept"
)
_SAMPLE_TOPICS = tuple(f"/{origin}/" for origin in get_args(Origin))
_SCHEMA_OF_TOPIC = {"/event": "Event", "/gap": "Gap", "/clock": "Clock", "/impact": "Impact"}


@dataclass(frozen=True, slots=True)
class TopicReport:
    """Accounting of one topic: blocks, samples, samples missing in between, breaks of `sequence`."""

    topic: str
    messages: int
    samples: int
    missing: int
    sequence_breaks: int
    repeats: int
    """Blocks with samples that came before."""
    unaccounted: int
    """Samples that are missing and in no gap, or in a gap and not missing."""

    @property
    def sound(self) -> bool:
        return not (self.sequence_breaks or self.repeats or self.unaccounted)


@dataclass(frozen=True, slots=True)
class LogReport:
    """What `verify_log` found; `sound` means complete, no checksum wrong or absent, no gap untold."""

    path: Path
    complete: bool
    damage: str
    topics: tuple[TopicReport, ...]
    ledger_missing: int
    seconds: float = 0.0
    """From sample 0 to where the channel that goes on longest ends."""
    recovered_from: str = ""
    """What was wrong with the log that this one was recovered from."""
    whole_bytes: int = 0
    size_bytes: int = 0
    """Of that log: up to where nothing was wrong with it, as far as it is known, and all of it."""
    lost: int = 0
    """Samples that were not in it any more, by its own count."""
    untold: tuple[str, ...] = ()
    """Topics of it of which no block was left: how many samples they had nothing tells."""
    unchecked: int = 0
    """Chunks, and the summary, that no checksum covers, as another program may leave them."""
    unchecked_before: int = 0
    """The same of the log that this one was recovered from."""
    left_out: tuple[str, ...] = ()
    """Topics of that log which are none of the format's."""
    all_told: str = ""
    """"samples" where that log says where each topic ended, so that `lost` is all; "everything" where nothing
    else is missing either."""

    @property
    def whole(self) -> bool:
        """True if a recovered log lacks nothing but what was never written."""
        unharmed = self.recovered_from in ("", CUT) or self.all_told == EVERYTHING
        return not self.lost and not self.untold and unharmed

    @property
    def sound(self) -> bool:
        """True if nothing is damaged, or could be unseen, and just what is missing of each topic is told."""
        return self._nothing_wrong and not (self.unchecked or self.unchecked_before)

    @property
    def unverified(self) -> bool:
        """True if nothing is wrong as far as can be seen, where samples may be wrong and nothing shows it."""
        return self._nothing_wrong and (self.unchecked or self.unchecked_before) > 0

    @property
    def _nothing_wrong(self) -> bool:
        return self.complete and not self.damage and all(topic.sound for topic in self.topics)


def verify_log(path: Path, passing: Callable[[int], None] = lambda _: None) -> LogReport:
    """Read every message of a log with its checksums and account for every sample index.

    `passing` hears how many bytes have been read.
    """
    damage, unchecked = "", 0
    state: dict[str, _Account] = {}
    with LogReader(path) as log:
        log.passing = passing
        try:
            for message in log.messages(skip_damaged=True):
                account = state.setdefault(message.topic, _Account())
                account.add(message.topic, message.sequence, message.data)
            log.passing = lambda _: None
            gaps = log.gaps()
            unchecked = log.check_frame()
        except LogError as error:
            damage, gaps = str(error), []
        ledger: dict[str, list[_Span]] = {}
        for gap in gaps:
            span = gap.first_sample, gap.first_sample + gap.count
            for topic in [f"/{gap.origin}/{gap.channel}"] if gap.origin else _lacking(gap, span, state):
                ledger.setdefault(topic, []).append(span)
        reports = tuple(account.report(topic, ledger.get(topic, [])) for topic, account in state.items())
        missing = sum(gap.count for gap in gaps)
        seconds = max((account.seconds for account in state.values()), default=0.0)
        origin = log.metadata.get(RECOVERED, {})
        whole, size, lost, before = (
            _whole_number(origin, name) for name in ("whole_bytes", "size_bytes", "lost", _UNCHECKED)
        )
        told, damage = origin.get("damage", ""), damage or log.damage
        untold, left_out = (tuple(origin.get(name, "").splitlines()) for name in ("untold", _LEFT_OUT))
        return LogReport(
            path,
            log.complete,
            damage,
            reports,
            missing,
            seconds,
            told,
            whole,
            size,
            lost,
            untold,
            unchecked,
            before,
            left_out,
            origin.get(_ALL_TOLD, ""),
        )


def _whole_number(record: Mapping[str, str], name: str) -> int:
    """0 where there is none."""
    text = record.get(name, "")
    return int(text) if _WHOLE_NUMBER.fullmatch(text) else 0


_Span = tuple[int, int]
"""First sample and end."""


def _lacking(gap: Gap, span: _Span, state: dict[str, _Account]) -> list[str]:
    """Topics of a gap that says no origin, as in logs of before: all of its channel that lack its samples."""
    topics = [origin + gap.channel for origin in _SAMPLE_TOPICS]
    return [topic for topic in topics if topic in state and state[topic].lacks(span)]


class _Account:
    """Running account of one topic."""

    def __init__(self) -> None:
        self.messages = self.samples = self.breaks = self.repeats = 0
        self.next_sample = 0
        self.seconds = 0.0
        self.holes: list[_Span] = []

    def add(self, topic: str, sequence: int, data: bytes) -> None:
        if sequence != self.messages:
            self.breaks += 1
        self.messages += 1
        if not topic.startswith(_SAMPLE_TOPICS):
            return
        block = decode_block(topic, data)
        self.repeats += block.first_sample < self.next_sample
        if block.first_sample > self.next_sample:
            self.holes.append((self.next_sample, block.first_sample))
        self.samples += len(block)
        self.next_sample = block.end_sample
        self.seconds = block.end_sample / block.sample_rate

    def lacks(self, span: _Span) -> bool:
        """Whether one hole holds all of it."""
        before = bisect_right(self.holes, span[0], key=itemgetter(0))
        return before > 0 and span[1] <= self.holes[before - 1][1]

    def report(self, topic: str, gaps: list[_Span]) -> TopicReport:
        """`gaps` are those of the ledger; any after the last sample are as they may be."""
        told = [(first, min(end, self.next_sample)) for first, end in gaps if first < self.next_sample]
        missing = sum(end - first for first, end in self.holes)
        unaccounted = _apart(self.holes, told)
        return TopicReport(
            topic, self.messages, self.samples, missing, self.breaks, self.repeats, unaccounted
        )


def _apart(some: list[_Span], others: list[_Span]) -> int:
    """How many samples lie in one of both and not in the other."""
    edges = sorted(
        (position, step, side)
        for side, spans in enumerate((some, others))
        for span in spans
        for position, step in zip(span, (1, -1), strict=True)
    )
    depth, apart, before = [0, 0], 0, 0
    for position, step, side in edges:
        if bool(depth[0]) != bool(depth[1]):
            apart += position - before
        depth[side] += step
        before = position
    return apart


def recover_log(
    damaged: Path,
    recovered: Path,
    passing: Callable[[int], None] = lambda _: None,
    by: Mapping[str, str] = MappingProxyType({}),
) -> LogReport:
    """Copy what is whole of `damaged` to the new file `recovered`, then verify what was written.

    Samples that were lost are in its gap ledger, and counted in the report: those in between, and at the end
    what a log that was finished says of it; of another those of topics that end before others do. How many
    came after the last that could be read of all, that does not tell: `recovered_from` says whether it was
    only cut there, and `untold` of which topics none was left. Topics that are none of the format's are
    `left_out`. `passing` hears how many bytes have been copied; `by` is
    what the copy says of the program that made it.
    """
    with LogReader(damaged, passing) as log:
        topics = {
            topic: _SCHEMA_OF_TOPIC.get(topic, "SampleBlock")
            for topic in log.topic_metadata()
            if topic.startswith(_SAMPLE_TOPICS) or topic in _SCHEMA_OF_TOPIC
        }
        writer = LogWriter(recovered, log.library or "rattle recover")
        try:
            writer.open()
            try:
                for name, record in log.metadata.items():
                    writer.add_metadata(name, record)
                for topic, schema in topics.items():
                    writer.register(topic, schema, log.topic_metadata()[topic])
                lost, lasts = _copied(log, topics, writer)
                unchecked = 0 if log.sealed else log.check_frame()
                cause, ends = UNWRITTEN if log.damage == CUT else LOST, _ends_of(log, topics)
                if log.damage:
                    at_end = _due(log, lasts, writer, cause) if not ends else _missing(ends, lasts, writer)
                    lost += at_end if cause == LOST else 0
                without = [each for each in topics if each.startswith(_SAMPLE_TOPICS) and each not in lasts]
                untold = log.may_hold(without) if cause == LOST and not ends else []
                left_out = [topic for topic in log.topic_metadata() if topic not in topics]
                record = origin_record(log, lost, untold, unchecked, left_out)
                if ends and log.damage:
                    nothing_else = log.whole_to_its_end and ANOTHER not in log.damage
                    record[_ALL_TOLD] = EVERYTHING if nothing_else else "samples"
                writer.add_metadata(RECOVERED, {**record, **by})
                writer.close()
            except BaseException:  # one that lacks the rest would look as if it were whole
                recovered.unlink(missing_ok=True)
                raise
            finally:
                writer.close()
        except RecorderFailed as error:
            raise LogError(str(error)) from error
        return verify_log(recovered)


def _ends_of(log: LogReader, topics: Collection[str]) -> dict[str, int]:
    """Where a log that was finished says that each topic of samples ends; nothing of another."""
    return {topic: _whole_number(log.ends, topic) for topic in topics if topic in log.ends}


def _missing(ends: Mapping[str, int], lasts: Mapping[str, tuple[int, SampleBlock]], writer: LogWriter) -> int:
    """Make gaps of what topics lack before they end; returns how many samples."""
    latest_ns, missing = max((log_ns for log_ns, _ in lasts.values()), default=0), 0
    for topic, told in ends.items():
        log_ns, block = lasts.get(topic, (latest_ns, None))
        end, before = min(told, LATEST - 1), block.end_sample if block else 0
        whose, name = origin_and_name(topic)
        if whose and end > before:
            writer.due(whose, name, end, log_ns, LOST)
            missing += end - before
    return missing


def _due(log: LogReader, lasts: Mapping[str, tuple[int, SampleBlock]], writer: LogWriter, cause: str) -> int:
    """Make gaps of what topics lack that end before others do; `lasts`: when the host had their last blocks.

    Returns how many samples.
    """
    held_ns = log.last_ns({topic: log_ns for topic, (log_ns, _) in lasts.items()})
    beside_ns: dict[Origin | None, int] = {}
    for topic, (log_ns, _) in lasts.items():
        whose, _ = origin_and_name(topic)
        beside_ns[whose] = max(beside_ns.get(whose, 0), log_ns)
    due = 0
    for topic, (log_ns, block) in lasts.items():
        whose, name = origin_and_name(topic)
        # of what is measured at once; a prediction comes later by as much as it likes
        late_s = (max(beside_ns[whose], held_ns[topic]) - log_ns) / NS_PER_S
        size = max(len(block), 1)
        a_second = block.sample_rate / size
        behind = size * math.floor(late_s * a_second + min(_SOONER, _SOONER_S * a_second))
        behind = min(behind, LATEST - 1 - block.end_sample)
        if whose and behind > 0 and whose != "derived":  # which come when a cycle ends
            writer.due(whose, name, block.end_sample + behind, log_ns, cause)
            due += behind
    return due


def origin_record(
    log: LogReader, lost: int, untold: Sequence[str], unchecked: int, left_out: Sequence[str]
) -> dict[str, str]:
    """What a recovered log says of the one that it comes from; of a sound one, what that says itself."""
    told = log.metadata.get(RECOVERED, {})
    unchecked += _whole_number(told, _UNCHECKED)
    left_out = [*told.get(_LEFT_OUT, "").splitlines(), *left_out]
    if log.damage or lost:
        size = log.path.stat().st_size
        told = {
            "damage": log.damage,
            "untold": "\n".join(untold),
            "whole_bytes": str(size if log.damaged_at is None else log.damaged_at),
            "size_bytes": str(size),
            "lost": str(lost),
        }
    more = {_UNCHECKED: str(unchecked) if unchecked else "", _LEFT_OUT: "\n".join(left_out)}
    return told | {name: text for name, text in more.items() if text}


def origin_of_copy(log: LogReader) -> dict[str, dict[str, str]]:
    """Metadata by which a copy of what a log holds says that it was cut, or that nobody could check it."""
    record = origin_record(log, 0, (), 0 if log.sealed else log.check_frame(), ())
    return {RECOVERED: record} if record else {}


def _copied(
    log: LogReader, topics: Collection[str], writer: LogWriter
) -> tuple[int, dict[str, tuple[int, SampleBlock]]]:
    """Samples that are missing in between of which the log knew nothing, and of each topic the last block.

    With when the host had that.
    """
    lost, lasts = 0, dict[str, tuple[int, SampleBlock]]()
    for message in log.messages(topics, skip_damaged=True):
        origin, name = origin_and_name(message.topic)
        if message.topic == "/gap":
            writer.add_gap(decode_record(Gap, message.data), message.log_ns)
        elif origin is None:
            writer.add_message(message.topic, message.data, message.log_ns, message.publish_ns)
        else:
            block = decode_block(name, message.data)
            if writer.comes_again(message.topic, block):
                again = _AGAIN.format(topic=message.topic, number=block.first_sample)
                log.damage = again if log.damage in ("", CUT) else f"{log.damage}; {again}"
                break
            lost += writer.add_encoded_block(origin, block, message.data, message.log_ns, cause=LOST)
            lasts[message.topic] = message.log_ns, block
    return lost, lasts

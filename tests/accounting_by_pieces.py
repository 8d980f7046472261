"""The checker for a run that is too long for memory: log, and what was sent, a piece at a time."""

from __future__ import annotations

import json
import math
from bisect import bisect_left
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from daq.block import NS_PER_S, SampleBlock
from daq.errors import LogError
from daq.log.reader import LogReader
from tests.accounting import (
    ENCODER,
    Log,
    SentByCard,
    SentByEncoder,
    cards_of,
    ended_by,
    of_nobody,
    off_time_base,
    place_on_card,
    place_on_encoder,
    tail_of_encoder,
    tiled,
    values_told,
)

PIECE_S = 5.0
"""A quarter of a GB where 64 channels are measured at 51.2 kHz."""
_AROUND_S = 0.5
"""What was sent is known so much longer than a piece at either end: more than times are off."""
_LONGEST_LINE = 1 << 20
"""Bytes of what a card keeps of a block."""
_Series = dict[tuple[str, str], list[SampleBlock]]
"""Blocks by origin and channel."""


def discrepancies_by_pieces(log: Path, folder: Path, piece_s: float = PIECE_S) -> list[str]:
    """What `discrepancies` finds of a run that came to its end, by what its emulators kept in a folder.

    Of one encoder at most, whose timer was last started for this run. Held are `piece_s` at a time.
    """
    try:
        with LogReader(log) as reader:
            return list(_by_pieces(reader, folder, piece_s)) if reader.complete else ["it was not finished"]
    except LogError as error:
        return [f"it cannot be read: {error}"]


def _by_pieces(reader: LogReader, folder: Path, piece_s: float) -> Iterator[str]:
    whole = Log.of_series(reader, {}, True, None, 0.0)
    course, card, encoder = _Course(whole), _OnCard(folder), _OnEncoder(folder)
    for series in _pieces(reader, piece_s):
        piece = replace(whole, series=series)
        yield from course.take(series)
        yield from card.compare(piece)
        yield from encoder.compare(piece)
    yield from course.rest()
    whole = replace(whole, series=course.series)
    yield from of_nobody(whole, card.every, card.sent, encoder.found)
    until_ns = yield from ended_by(whole, card.sent, card.offset or 0)
    yield from encoder.tail(whole, until_ns)


def _pieces(reader: LogReader, piece_s: float) -> Iterator[_Series]:
    """The log, cut before blocks of the channel that was declared first: a card's come in that order."""
    first = next(iter(reader.channels("measured")), "")
    series: _Series = {}
    begun_ns: int | None = None
    for origin, block in reader.blocks(("measured", "predicted", "nominal")):
        if (origin, block.channel) == ("measured", first):
            begun_ns = block.time_ns if begun_ns is None else begun_ns
            if block.time_ns - begun_ns >= piece_s * NS_PER_S:
                yield series
                series, begun_ns = {}, block.time_ns
        series.setdefault((origin, block.channel), []).append(block)
    if series:
        yield series


class _Course:
    """How far each series has come; `series` has its first block and its last."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self.series: _Series = {}
        self._behind: dict[tuple[str, str], int] = {}  # all before that index is accounted for
        self._gaps: dict[tuple[str, str], int] = {}  # so many of the ledger were taken

    def take(self, piece: _Series) -> Iterator[str]:
        for (origin, name), blocks in piece.items():
            begin, until = self._behind.get((origin, name), 0), blocks[-1].end_sample
            ledger, before = self._log.gaps_of(name, origin), self.series.get((origin, name))
            gaps = sorted(ledger, key=lambda gap: gap.first_sample)[self._gaps.get((origin, name), 0) :]
            gaps = [gap for gap in gaps if gap.first_sample < until]
            self._gaps[origin, name] = self._gaps.get((origin, name), 0) + len(gaps)
            yield from (f"{origin} {name}: {wrong}" for wrong in tiled(blocks, gaps, begin))
            if before is not None and blocks[0].time_ns <= before[-1].time_ns:
                yield f"{origin} {name}: time goes back at index {blocks[0].first_sample}"
            ends = [gap.first_sample + gap.count for gap in gaps]
            self._behind[origin, name] = max([begin, until, *ends])
            self.series[origin, name] = [(before or blocks)[0], blocks[-1]]

    def rest(self) -> Iterator[str]:
        """What the ledger has behind the last block, and of what never came."""
        declared = [("measured", name) for name in self._log.channels]
        declared += [("predicted", name) for name in self._log.predicted]
        for origin, name in dict.fromkeys([*declared, *self.series]):
            begin = self._behind.get((origin, name), 0)
            ledger = sorted(self._log.gaps_of(name, origin), key=lambda gap: gap.first_sample)
            gaps = ledger[self._gaps.get((origin, name), 0) :]
            yield from (f"{origin} {name}: {wrong}" for wrong in tiled([], gaps, begin))


class _OnCard:
    """What the card sent, of each piece; `offset`: which of its samples is the record's first."""

    def __init__(self, folder: Path) -> None:
        self._told = [_ToldByCard(path) for path in folder.glob("daq_card-*.jsonl") if path.stat().st_size]
        self._of_record: _ToldByCard | None = None
        self.offset: int | None = None

    @property
    def every(self) -> list[SentByCard | SentByEncoder]:
        return [told.sent for told in self._told]

    @property
    def sent(self) -> SentByCard | None:
        """The run of the card's clock that the record is of; None before its first sample."""
        return None if self._of_record is None else self._of_record.sent

    def compare(self, piece: Log) -> Iterator[str]:
        if self._of_record is None:
            found = next(iter(cards_of(piece.measured, self.every)), None)
            self._of_record = next((told for told in self._told if told.sent is found), None)
        if (told := self._of_record) is None:
            return
        sent = told.sent
        series = {
            (origin, name): blocks
            for (origin, name), blocks in piece.series.items()
            if origin == "measured" and name != ENCODER and blocks[0].sample_rate == sent.rate
        }
        if not series:
            return
        first = next(iter(series.values()))[0]
        base = min(blocks[0].first_sample for blocks in series.values())
        count = max(blocks[-1].end_sample for blocks in series.values()) - base
        begin_s = (first.time_ns - sent.started_ns) / NS_PER_S - (first.first_sample - base) / sent.rate
        near = round(begin_s * sent.rate) if self.offset is None else self.offset + base
        around = round(_AROUND_S * sent.rate)
        told.between(near - around, near + count + around)
        from_base = {
            key: [replace(each, first_sample=each.first_sample - base) for each in blocks]
            for key, blocks in series.items()
        }
        known = None if self.offset is None else self.offset + base
        place, wrong = place_on_card(sent, replace(piece, series=from_base), known)
        yield from (f"from index {base} on: {each}" for each in wrong)
        if not wrong:
            self.offset = place - base


class _ToldByCard:
    """One run of a card's clock, in whose `sent` is what was shown of the part that was asked for last."""

    def __init__(self, path: Path) -> None:
        self._lines = _lines(path)
        begun, last = next(self._lines), _last(path)
        made = last.get("first", 0) + last.get("count", 0)
        self.sent = SentByCard(
            begun["started_ns"], begun["rate"], begun["inputs"], made, read=last.get("read", 0)
        )
        self._until = 0

    def between(self, first: int, end: int) -> None:
        sent = self.sent
        while self._until < end and (told := next(self._lines, None)) is not None:
            self._until = told["first"] + told["count"]
            sent.shown |= values_told(told)
            sent.counted |= {int(index): counts for index, counts in told["counted"].items()}
        sent.shown = {index: values for index, values in sent.shown.items() if index >= first}
        sent.counted = {index: counts for index, counts in sent.counted.items() if index >= first}


class _OnEncoder:
    """What the encoder sent, of each piece."""

    def __init__(self, folder: Path) -> None:
        path = next(folder.glob("encoder-*.jsonl"), None)
        self._lines: Iterator[Mapping[str, Any]] = iter(()) if path is None else _lines(path)
        self._counts_per_revolution, self._since_s = 1, math.nan
        self._sent, self._dropped = SentByEncoder(1), 0  # frames around a piece; how many came before them
        self._offset: int | None = None  # which frame since the timer's start is the record's first

    @property
    def found(self) -> SentByEncoder | None:
        """None where it sent nothing then."""
        return self._sent if self._sent.unix_s else None

    def compare(self, piece: Log) -> Iterator[str]:
        blocks = piece.measured.get(ENCODER, [])
        if not blocks:
            return
        first, last = blocks[0], blocks[-1]
        end_s = last.time_ns / NS_PER_S + len(last) / last.sample_rate
        self._between(first.time_ns / NS_PER_S - _AROUND_S, end_s + _AROUND_S)
        if not self._sent.unix_s or "encoder.numbering" in piece.codes:
            return
        known = None if self._offset is None else self._offset - self._dropped
        offset = place_on_encoder(self._sent, piece, known)
        if offset is None:
            yield f"from index {first.first_sample} on: {ENCODER}: its values are not those that were sent"
            return
        self._offset = offset + self._dropped
        yield from off_time_base(self._sent, piece, offset)

    def tail(self, log: Log, until_ns: float) -> Iterator[str]:
        if self._offset is not None:
            self._between(-math.inf, math.inf)
            yield from tail_of_encoder(self._sent, log, self._offset - self._dropped, until_ns)

    def _between(self, begin_s: float, end_s: float) -> None:
        """Frames due from about one time to another, s (Unix epoch)."""
        for told in self._lines:
            self._take(told)
            if self._sent.unix_s and self._sent.unix_s[-1] > end_s:
                break
        sent = self._sent
        before = bisect_left(sent.unix_s, begin_s)
        del sent.unix_s[:before], sent.counts[:before], sent.sent[:before]
        self._dropped += before

    def _take(self, told: Mapping[str, Any]) -> None:
        if "counts_per_revolution" in told:
            self._counts_per_revolution = told["counts_per_revolution"]
            return
        if told["since_s"] != self._since_s:
            self._since_s, self._dropped = told["since_s"], 0
            self._sent = SentByEncoder(self._counts_per_revolution)
        self._sent.unix_s.append(told["unix_s"])
        self._sent.counts.append(told["counts"])
        self._sent.sent.append(told["sent"])


def _lines(path: Path) -> Iterator[Mapping[str, Any]]:
    with path.open("rb") as file:
        for line in file:
            yield json.loads(line)


def _last(path: Path) -> Mapping[str, Any]:
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - _LONGEST_LINE, 0))
        whole, _, _ = file.read().rpartition(b"\n")  # the last line may have been cut
    told: Mapping[str, Any] = json.loads(whole.rpartition(b"\n")[2])
    return told

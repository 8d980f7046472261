"""What a power loss leaves of a log can be read, and all of it that a sync had made safe is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.crash_images import NO_CHUNK, Image, count_images, examine, record
from daq.errors import LogError

IMAGES = 150  # 5,000 in the benchmark


def test_every_image_is_recovered_and_nothing_safe_is_lost() -> None:
    found = count_images(IMAGES, seed=13)
    assert set(found) <= {"", NO_CHUNK}, found
    assert found[""] == IMAGES


def test_what_a_sync_had_made_safe_is_missed_where_it_lacks(tmp_path: Path) -> None:
    recording = record(tmp_path / "log.mcap", 6.0, np.random.default_rng(3))
    (tmp_path / "log.mcap").unlink()
    safe = recording.syncs[-1]
    whole = b"".join(write.data for write in recording.writes)
    assert examine(Image(whole, recording.writes[safe - 1].at_s, recording.now_s), recording, tmp_path) == ""
    early = Image(
        whole[: recording.writes[safe // 4].offset], recording.writes[safe - 1].at_s, recording.now_s
    )
    assert "before a finished sync are lost" in examine(early, recording, tmp_path)


def test_a_sample_that_was_never_sent_is_seen(tmp_path: Path) -> None:
    recording = record(tmp_path / "log.mcap", 2.0, np.random.default_rng(3))
    whole = Image((tmp_path / "log.mcap").read_bytes(), 1.0, 2.0)
    (tmp_path / "log.mcap").unlink()
    key = next(iter(recording.sent))
    recording.sent[key] = recording.sent[key][:-1] + b"\x00"
    assert examine(whole, recording, tmp_path) == "a sample that was not sent"


@pytest.mark.parametrize("kind", ["messages", "metadata"])
def test_what_was_never_written_beside_samples_is_seen(tmp_path: Path, kind: str) -> None:
    recording = record(tmp_path / "log.mcap", 2.0, np.random.default_rng(3))
    whole = Image((tmp_path / "log.mcap").read_bytes(), 1.0, 2.0)
    written = getattr(recording, kind)
    first, at_s = next(iter(written.items()))
    del written[first]
    assert examine(whole, recording, tmp_path) == "what was not written, or in another order"
    written[first] = at_s
    assert examine(whole, recording, tmp_path) == "what was not written, or in another order"
    written["another",] = 0.0
    setattr(recording, kind, {first: at_s} | written)
    assert "before a finished sync are lost" in examine(whole, recording, tmp_path)


def test_one_whole_chunk_anywhere_has_to_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = record(tmp_path / "log.mcap", 2.0, np.random.default_rng(3))
    content = bytearray((tmp_path / "log.mcap").read_bytes())
    (tmp_path / "log.mcap").unlink()

    def fail(*_: Path) -> None:
        raise LogError("nothing is found")

    monkeypatch.setattr("benchmarks.crash_images.recover_log", fail)
    *others, last = recording.chunks
    for begin, end in others:
        content[begin:end] = bytes(end - begin)
    assert examine(Image(bytes(content), 0.0, 2.0), recording, tmp_path) == "cannot be read"
    content[last[0]] ^= 1
    assert examine(Image(bytes(content), 0.0, 2.0), recording, tmp_path) == NO_CHUNK

"""`rattle verify` and `rattle recover`, and how commands end."""

from __future__ import annotations

import errno
import json
import os
import re
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from daq.block import SampleBlock
from daq.channel import Channel
from daq.log.front import read_summary
from daq.log.reader import LogReader
from daq.log.records import STOPPING, Event, Gap
from daq.log.recover import RECOVERED, recover_log, verify_log
from daq.log.writer import LogWriter
from rig.commands.cli import FAILED, WRONG_USE
from rig.files.software import software
from rig.session.run import ENDS
from tests.daq.log.logs import START_NS, block, write_foreign, write_ramp
from tests.rig.commands.cli import Call
from tests.rig.synthetic_run import SCENARIO, write_log

ZSTANDARD = bytes.fromhex("28b52ffd")
"""With which a compressed chunk's content begins."""
ACQUISITION = '[acquisition]\nsample_rate = "1 kHz"\nduration = "7 s"\n'


def test_a_sound_log_is_called_sound(call: Call, tmp_path: Path) -> None:
    answer = call("verify", write_ramp(tmp_path / "log.mcap"))
    assert answer.code == 0
    assert answer.out.rstrip().endswith(": sound")
    found = json.loads(call("verify", tmp_path / "log.mcap", "--json").out)
    assert found["sound"] is True
    assert {topic["topic"]: topic["samples"] for topic in found["topics"]} == {
        "/measured/a": 3000,
        "/measured/b": 3000,
    }


def test_a_log_without_checksums_is_called_unverified(call: Call, tmp_path: Path) -> None:
    answer = call("verify", path := write_foreign(tmp_path / "log.mcap"))
    assert answer.code == 1
    why = "UNVERIFIED, 3 of its parts (chunks, summary) have no checksum that would show damage"
    assert answer.out.splitlines()[-1] == f"{path}: 0.2 s, 200 samples: {why}"
    found = json.loads(call("verify", path, "--json").out)
    assert (found["sound"], found["unverified"], found["unchecked"]) == (False, True, 3)
    answer = call("recover", path, "-o", tmp_path / "copy.mcap")
    assert answer.code == 1
    had = "UNVERIFIED, 3 parts of the log that it was recovered from had no checksum"
    assert had in answer.out.splitlines()[-1]
    assert call("verify", tmp_path / "copy.mcap").code == 1


def test_messages_outside_of_chunks_are_told(call: Call, tmp_path: Path) -> None:
    """They are never read: it may be all that was recorded."""
    path = write_foreign(tmp_path / "log.mcap", True, True, chunked=False)
    answer = call("verify", path)
    assert answer.code == 1
    verdict = "NOT SOUND, messages outside of chunks are not read"
    assert answer.out.splitlines()[-1] == f"{path}: 0 s, 0 samples: {verdict}"
    answer = call("recover", path, "-o", tmp_path / "copy.mcap")
    assert answer.code == 3
    assert "messages outside of chunks are not read" in answer.out.splitlines()[-1]


def test_topics_that_are_left_out_are_named(call: Call, tmp_path: Path) -> None:
    path = write_foreign(tmp_path / "log.mcap", True, True, topics=("/measured/a", "/camera/image"))
    answer = call("recover", path, "-o", tmp_path / "copy.mcap")
    assert answer.code == 0
    assert "left out   /camera/image: none of rattle's topics" in answer.out
    assert json.loads(call("verify", tmp_path / "copy.mcap", "--json").out)["left_out"] == ["/camera/image"]


def test_a_log_without_samples_says_that_nothing_was_recorded(call: Call, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        writer.declare("measured", Channel("a", "N"))
    answer = call("verify", tmp_path / "log.mcap")
    assert answer.code == 0
    assert answer.out.rstrip().endswith("0 samples: nothing was recorded")


@pytest.mark.parametrize(
    ("ends", "told"), [({}, "3 s of the 7 s asked for"), ({ENDS: "until stopped"}, "3 s, ")]
)
def test_of_a_run_until_stopped_no_duration_was_asked_for(
    call: Call, tmp_path: Path, ends: dict[str, str], told: str
) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as writer:
        writer.declare("measured", Channel("a", "N"))
        writer.add_metadata("scenario", {"toml": f"{SCENARIO}{ACQUISITION}"})
        writer.add_metadata("run", {"id": "run", **ends})
        for second in range(3):
            samples = np.zeros(1000, np.float32)
            writer.add_block(
                "measured",
                SampleBlock("a", 1000 * second, START_NS + second * 10**9, 1000.0, samples),
                START_NS,
            )
    path.write_bytes(path.read_bytes()[:-200])
    assert told in call("verify", path).out.splitlines()[-1]


def test_of_a_run_that_was_stopped_it_is_told_what_was_asked_for(call: Call, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        writer.declare("measured", Channel("a", "N"))
        writer.add_metadata("scenario", {"toml": f"{SCENARIO}{ACQUISITION}"})
        writer.add_block("measured", block(0), START_NS)
        writer.add_event(Event(START_NS, "warning", "rig", STOPPING, "stopping before its time"))
    assert "0.1 s of the 7 s asked for, 100 samples: sound" in call("verify", tmp_path / "log.mcap").out


def test_a_cut_log_exits_1_and_can_be_recovered(call: Call, tmp_path: Path) -> None:
    path = write_ramp(tmp_path / "log.mcap")
    path.write_bytes(path.read_bytes()[:-500])
    answer = call("verify", path)
    assert answer.code == 1
    assert "cut short" in answer.out
    assert call("recover", path, "-o", tmp_path / "whole.mcap").code == 0
    assert call("verify", tmp_path / "whole.mcap").code == 0


def test_a_large_log_says_that_it_is_read_and_a_program_hears_nothing_of_it(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.commands.logs._LARGE_MB", 0.0)
    path = write_ramp(tmp_path / "log.mcap")
    assert call("verify", path).out.startswith("verifying (0 MB) ...\n")
    assert call("recover", path, "-o", tmp_path / "again.mcap").out.startswith("recovering (0 MB) ...\n")
    assert json.loads(call("verify", path, "--json").out)["sound"] is True


def test_how_far_a_log_was_read_is_told_in_bytes(tmp_path: Path) -> None:
    path, passed = write_ramp(tmp_path / "log.mcap"), list[int]()
    verify_log(path, passed.append)
    assert passed == sorted(passed)
    assert 0 < passed[-1] < path.stat().st_size
    path.write_bytes(path.read_bytes()[:-500])  # without an index
    cut = list[int]()
    recover_log(path, tmp_path / "whole.mcap", cut.append)
    assert cut == sorted(cut)
    assert 0 < cut[-1] < path.stat().st_size


def damaged_at_the_end(path: Path, at: int, byte: int) -> Path:
    """The last chunk of a log, with bytes from its place `at` on changed."""
    write_ramp(path)
    with path.open("rb") as file:
        last = max(read_summary(file.fileno()).chunks)
    content = bytearray(path.read_bytes())
    content[last.start + at % last.length] = byte
    path.write_bytes(content)
    return path


def test_recovery_that_lacks_samples_exits_3_and_says_how_many(call: Call, tmp_path: Path) -> None:
    path = damaged_at_the_end(tmp_path / "log.mcap", -20, 0xAA)
    answer = call("recover", path, "-o", tmp_path / "rest.mcap")
    assert answer.code == 3
    (lost,) = re.findall(r"^(\d+) samples were lost", answer.out, re.MULTILINE)
    verified = json.loads(call("verify", tmp_path / "rest.mcap", "--json").out)
    there = sum(topic["samples"] for topic in verified["topics"])
    assert (verified["sound"], there + int(lost), int(lost) > 0) == (True, 6000, True)


def test_the_verdict_comes_also_where_the_ledger_is_damaged(call: Call, tmp_path: Path) -> None:
    path = damaged_at_the_end(tmp_path / "log.mcap", -20, 0xAA)
    path.write_bytes(path.read_bytes()[:-500])  # no index says that the ledger lies elsewhere
    answer = call("verify", path)
    assert (answer.code, answer.err) == (1, "")
    assert answer.out.splitlines()[-1].startswith(f"{path}: ")


def test_recovery_that_lacks_samples_exits_3_also_where_nothing_had_a_checksum(
    call: Call, tmp_path: Path
) -> None:
    path = write_foreign(tmp_path / "log.mcap")
    path.write_bytes(path.read_bytes().replace(ZSTANDARD, bytes(4), 1))
    answer = call("recover", path, "-o", tmp_path / "rest.mcap")
    assert answer.code == 3
    assert "100 samples were lost" in answer.out


def test_who_reads_a_damaged_log_is_told_what_to_do(call: Call, tmp_path: Path) -> None:
    path = damaged_at_the_end(tmp_path / "log.mcap", -20, 0xAA)
    answer = call("export", path, "--to", "csv")
    assert answer.code == 1
    assert "rattle verify says where, rattle recover saves the rest" in answer.err


def test_a_recovered_log_says_where_the_one_before_was_cut(call: Call, tmp_path: Path) -> None:
    """On the terminal as it is recovered, and whenever it is verified; with what the run was to come to."""
    path = write_ramp(tmp_path / "log.mcap", scenario=f"{SCENARIO}{ACQUISITION}")
    cut = path.read_bytes()[: path.stat().st_size * 3 // 7]
    path.write_bytes(cut)
    assert "s of the 7 s asked for" in call("verify", path).out.splitlines()[-1]
    recovered = tmp_path / "whole.mcap"
    call("recover", path, "-o", recovered)
    found = json.loads(call("verify", recovered, "--json").out)
    assert 0 < found["whole_bytes"] < found["size_bytes"] == len(cut)
    assert 0 < found["seconds"] < 3
    with LogReader(recovered) as log:
        assert software().items() <= log.metadata[RECOVERED].items()
    again = tmp_path / "again.mcap"
    for answer in (call("verify", recovered), call("recover", recovered, "-o", again), call("verify", again)):
        assert answer.code == 0
        verdict = answer.out.splitlines()[-1]
        assert f"{found['seconds']:.4g} s of the 7 s asked for" in verdict
        assert "sound as far as it goes" in verdict
        assert "it ends in the middle, as a crash leaves it" in verdict
        assert f"{found['whole_bytes'] / 1e6:.2f} of {len(cut) / 1e6:.2f} MB" in verdict


def test_the_verdict_is_the_last_line_and_counts(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.declare("measured", Channel("a", "N"))
        for number in (0, 2):
            log.add_block("measured", block(number), START_NS)
    verdict = f"{path}: 0.3 s, 200 samples, 100 more missing by its ledger: sound"
    assert call("verify", path).out.splitlines()[-1] == verdict


def test_it_says_its_version(call: Call) -> None:
    answer = call("--version")
    assert (answer.code, answer.out) == (0, f"rattle {version('rattle')}\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["verify"], "Missing argument"),
        (["dance"], "No such command"),
        (["verify", "--loud", "x.mcap"], "No such option"),
        (["predict", "gone.toml", "--out", "x.mcap"], "gone.toml"),
    ],
)
def test_wrong_use_exits_2_and_says_what_is_wrong(call: Call, arguments: list[str], words: str) -> None:
    answer = call(*arguments)
    assert answer.code == 2
    assert answer.err.startswith("rattle: ")
    assert words in answer.err


def test_a_missing_log_exits_1_with_one_line(call: Call, tmp_path: Path) -> None:
    answer = call("verify", tmp_path / "gone.mcap")
    assert answer.code == 1
    assert answer.err == f"rattle: {tmp_path / 'gone.mcap'}: No such file or directory\n"


def test_what_a_log_says_is_shown_and_never_obeyed(call: Call, tmp_path: Path) -> None:
    """Markup of the terminal's package, colours, a title, the beginning of the line, writing backwards."""
    said, shown = (
        "[/x] [red]\x1b[31m\x1b]0;t\x07\r\x9b2J\u202e",
        r"[/x] [red]\x1b[31m\x1b]0;t\x07\r\x9b2J\u202e",
    )
    with LogWriter(tmp_path / "log.mcap") as log:
        log.add_metadata("scenario", {"toml": f"name = {json.dumps(said)}"})
        log.declare("measured", Channel(said, said))
        values = np.ones(10, np.float32)
        log.add_gap(Gap(START_NS, said, 0, 5, said), START_NS)
        log.add_block("measured", SampleBlock(said, 5, START_NS, 1000.0, values), START_NS)
    for command in (["verify"], ["replay", "--speed", "0"]):
        answer = call(*command, tmp_path / "log.mcap")
        assert answer.code == 0
        assert shown in answer.out
        assert not set(answer.out + answer.err) & set("\x1b\x07\r\x9b\u202e")
    answer = call("export", tmp_path / "log.mcap", "--to", said)
    assert shown in answer.err


def test_a_scenario_in_a_log_is_as_long_as_a_file_may_be(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": f'name = "{"x" * (4 << 20)}"'})
        log.declare("measured", Channel("a", "N"))
        log.add_block("measured", block(0), START_NS)
    answer = call("overlay", path)
    assert answer.code == 2
    assert "at most 4 MiB" in answer.err
    assert call("replay", path, "--speed", "0").code == 0


def _made(command: str, folder: Path) -> tuple[object, ...]:
    """A command that makes the new log `made.mcap`, and what it needs."""
    scenario = folder / "s.toml"
    scenario.write_text(f"{SCENARIO}{ACQUISITION.replace('7 s', '0.1 s')}")
    if command == "predict":
        return command, scenario, "--out", folder / "made.mcap"
    log = write_log(folder / "run.mcap", 0.5, origins=["measured"], scenario=scenario.read_text())
    if command == "import":
        np.savez(folder / "a.npz", force=np.zeros(100), sample_rate=1000.0)
        told = ("--rename", "force=contact.force_upper", "--unit", "force=N")
        return command, folder / "a.npz", "--scenario", scenario, *told, "-o", folder / "made.mcap"
    return command, log, "-o", folder / "made.mcap"


@pytest.mark.parametrize("command", ["predict", "overlay", "recover", "import"])
def test_what_a_full_disk_cuts_in_the_end_is_not_left_behind(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    asked = _made(command, tmp_path)

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("daq.log.writer.os.fdatasync", full)
    answer = call(*asked)
    assert answer.code == FAILED
    assert "No space left" in answer.err
    assert not (tmp_path / "made.mcap").exists()


@pytest.mark.parametrize("command", ["predict", "overlay"])
def test_what_does_not_fit_on_the_disk_is_refused_before(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    asked = _made(command, tmp_path)
    monkeypatch.setattr("rig.files.pairing.shutil.disk_usage", lambda _: SimpleNamespace(free=100))
    answer = call(*asked)
    assert answer.code == WRONG_USE
    assert "free disk space" in answer.err
    assert not (tmp_path / "made.mcap").exists()


@pytest.mark.parametrize("command", ["predict", "overlay", "recover", "import"])
def test_a_log_that_is_there_stays(call: Call, tmp_path: Path, command: str) -> None:
    asked = _made(command, tmp_path)
    (tmp_path / "made.mcap").write_bytes(b"mine")
    assert call(*asked).code != 0
    assert (tmp_path / "made.mcap").read_bytes() == b"mine"

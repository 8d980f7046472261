import os
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from daq.block import SampleBlock
from daq.channel import Channel
from daq.log.writer import LogWriter
from daq.plugins import UNUSED
from rig.report.page import GROUP, SECTIONS, write_report
from rig.report.record import read_run
from tests.fake_packages import install
from tests.hostile import bounded
from tests.rig.synthetic_run import CHANNELS, START_NS, blocks, damaged, write_log

BEAM = {
    "Summary",
    "In time and over the cycle",
    "The whole run",
    "Peak forces",
    "Autospectra",
    "Events and gaps",
    "Scenario",
    "Provenance",
}
MARKUP = "<img src=x onerror=alert(1)><a href='http://example.org'>x</a>\"'&"


def page(log: Path) -> str:
    html = log.with_suffix(".html")
    write_report(read_run(log), html)
    return html.read_text(encoding="utf-8").replace(get_plotlyjs(), "")


class Tags(HTMLParser):
    """Names of all elements of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        if tag == "a":
            assert str(dict(attrs)["href"]).startswith("#")


def test_every_section_of_the_beam_is_there_in_its_order(tmp_path: Path) -> None:
    found = re.findall("<h2>(.*)</h2>", page(write_log(tmp_path / "run.mcap")))
    assert found == [section.heading for section in SECTIONS.values() if section.heading in BEAM]
    assert len(found) == len(BEAM)


def test_a_report_stays_small_enough_to_send(tmp_path: Path) -> None:
    channels = [*CHANNELS, *(Channel(f"extra_{index}", "m/s2") for index in range(11))]
    log = write_log(tmp_path / "run.mcap", seconds=2.0, channels=channels)
    write_report(read_run(log), tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size < 8_000_000


def test_markup_in_names_and_scenario_comes_out_inert(tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.mcap", 0.2, [Channel(MARKUP, MARKUP)], scenario=f"name = '''{MARKUP}'''")
    text = page(log)
    assert "<img" not in text
    assert "&lt;img src=x onerror=alert(1)&gt;" in text
    assert "img" not in Tags(text).names


@pytest.mark.parametrize(
    ("origins", "sentence"),
    [(("measured",), "The log holds no prediction."), (("predicted",), "a prediction only")],
)
def test_one_origin_alone_is_reported_as_such(
    tmp_path: Path, origins: tuple[str, ...], sentence: str
) -> None:
    assert sentence in page(write_log(tmp_path / "run.mcap", origins=origins))  # type: ignore[arg-type]


def test_a_run_without_contact_forces_says_so(tmp_path: Path) -> None:
    text = page(write_log(tmp_path / "run.mcap", channels=CHANNELS[:1]))
    assert "No contact forces in this run" in text
    assert "no pair of contact forces" in text


def test_a_run_without_an_impact_says_so(tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.mcap", seconds=0.004)  # the first contact comes at 5 ms
    assert "No impact in this run" in page(log)


@pytest.mark.parametrize("seconds", [0.0, 1e-4, 0.2])
@pytest.mark.parametrize("scenario", ["", "no toml [", "[drive]\nfrequency = 'three'", "drive = 1"])
def test_short_runs_and_odd_scenarios_give_a_report(tmp_path: Path, seconds: float, scenario: str) -> None:
    assert "<h2>Provenance</h2>" in page(write_log(tmp_path / "run.mcap", seconds, scenario=scenario))


def test_gaps_and_bad_samples_are_told(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        for channel in CHANNELS:
            log.declare("measured", channel)
        for index, block in enumerate(blocks(CHANNELS, "measured", 1.0)):
            if index == 11:
                continue
            log.add_block("measured", damaged(block) if index == 22 else block, block.time_ns)
    text = page(path)
    assert "5120 missing" in text
    assert "1 gap, 1 overloaded block" in text
    assert "Samples that are no numbers: contact.force_lower." in text


def test_a_log_that_a_crash_left_is_reported_up_to_its_last_chunk(tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.mcap", seconds=2.0)
    os.truncate(path, path.stat().st_size // 2)
    assert "The log was never finished" in page(path)


ADDED = """
from rig.pages.content import Section, Sentence

def count(run):
    return [Sentence(f"It has {len(run.channels)} channels & <b>no</b> wear.")]

def fail(run):
    raise ValueError("no such bearing")

WEAR, SILENT, FAILING = Section("Wear", count), Section("Nothing", lambda run: []), Section("Bearings", fail)
"""


def test_another_package_adds_sections_and_what_is_wrong_with_them_costs_no_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    points = {
        "wear": "rattle_wear:WEAR",
        "silent": "rattle_wear:SILENT",
        "bearings": "rattle_wear:FAILING",
        "orders": "rattle_wear:WEAR",
        "lost": "rattle_wear:LOST",
    }
    install(monkeypatch, tmp_path, "rattle-wear", GROUP, points, ADDED)
    text = page(write_log(tmp_path / "run.mcap"))
    found = re.findall("<h2>(.*)</h2>", text)
    own = [section.heading for section in SECTIONS.values() if section.heading in BEAM]
    at = own.index("Events and gaps")
    assert found == [*own[:at], "Bearings", "Wear", *own[at:]]
    assert "It has 5 channels &amp; &lt;b&gt;no&lt;/b&gt; wear." in text
    summary = text.split("<h2>")[1]
    whose = "of rattle-wear 1.2 is not used: "
    assert f"{GROUP}: orders {whose}that of rattle itself has the name" in summary
    assert f"{GROUP}: lost {whose}it does not load" in summary
    failed = f"{GROUP}: bearings failed (ValueError: no such bearing)"
    assert failed in text
    assert failed in UNUSED  # which the command tells
    assert any("lost of rattle-wear 1.2" in told for told in UNUSED)


def test_a_short_last_block_is_no_hole(tmp_path: Path) -> None:
    """As a stop leaves it, or a duration that is no whole number of blocks."""
    path, lengths = tmp_path / "run.mcap", (600_000, 600_000, 10)
    with LogWriter(path) as log:
        log.declare("measured", Channel("contact.force_upper", "N"))
        for number, length in enumerate(lengths):
            first, values = sum(lengths[:number]), np.ones(length, np.float32)
            each = SampleBlock("contact.force_upper", first, START_NS + first, 51_200.0, values)
            log.add_block("measured", each, START_NS)
    run = read_run(path)
    assert len(run.traces["measured", "contact.force_upper"].values) == sum(lengths)
    assert run.kept_s is None


def test_a_hole_that_no_run_has_takes_no_memory(tmp_path: Path) -> None:
    """The index of a sample says it comes after ten hours, and the file is of a few kilobytes."""
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        for origin, name in (("measured", "contact.force_upper"), ("derived", "crank.speed")):
            log.declare(origin, Channel(name, "N"))
            for first in (0, 1 << 31):
                each = SampleBlock(name, first, START_NS + first, 51_200.0, np.ones(10, np.float32))
                log.add_block(origin, each, START_NS)
    with bounded(64 << 20):
        run = read_run(path)
    assert len(run.traces["measured", "contact.force_upper"].values) == 10
    assert len(run.speeds["measured"].values) == 10
    assert run.kept_s == 10 / 51_200
    assert run.missing == (1 << 31) - 10

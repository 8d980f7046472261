"""A bench file that is edited keeps what its owner wrote around the settings."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from daq.errors import RattleError
from rig.files.bench import parse_bench
from rig.files.bench_edit import Change, change_bench, changed

BENCH = '''\
# the beam of room 4
[signal_generator]
emulated = true

[daq_card]   # in the rack
grpc = "127.0.0.1:1"

[[ daq_card.channels ]]
name = "contact.force_upper"   # at the window
physical = "cDAQ1Mod1/ai0"     # the red cable
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "25 mV/pC"
range = "50 N"

  [daq_card.channels.amplifier]
  corner = "0.5 Hz"   # as on its panel

# the other one
[[daq_card.channels]]
kind = "force_iepe"
name = 'contact.force_lower'
physical = "cDAQ1Mod1/ai1"
sensitivity = "100 mV/N"
range = "40 N"'''


def test_settings_change_in_their_place_and_nothing_else_does() -> None:
    edited = changed(
        BENCH,
        [
            Change("contact.force_upper", "physical", "cDAQ1Mod1/ai1"),
            Change("contact.force_lower", "physical", "cDAQ1Mod1/ai0"),
            Change("contact.force_upper", "inverted", True),
            Change("contact.force_lower", "inverted", True),
        ],
    )
    assert edited == BENCH.replace(
        'ai0"     # the red cable', 'ai1"     # the red cable'
    ).replace('ai1"\nsensitivity = "100', 'ai0"\nsensitivity = "100').replace(
        'range = "50 N"\n', 'range = "50 N"\ninverted = true\n'
    ).replace('range = "40 N"', 'range = "40 N"\ninverted = true\n')  # fmt: skip
    upper, lower = parse_bench(edited, "bench", Path(), "impact_beam").daq_card.channels
    assert upper.inverted
    assert lower.inverted
    assert (upper.physical, lower.physical) == ("cDAQ1Mod1/ai1", "cDAQ1Mod1/ai0")


def test_an_encoder_on_the_bus_has_a_table_of_its_own() -> None:
    text = "[encoder]\nnode = 7 # on the wall\n[encoder.identity]\nserial = 1\n"
    assert changed(text, [Change("", "mounting", "12.5 deg")]) == text.replace(
        "wall\n", 'wall\nmounting = "12.5 deg"\n'
    )


@pytest.mark.parametrize(
    "text",
    [
        'daq_card.channels = [{name = "contact.force_upper", physical = "a/ai0"}]\n',
        '[daq_card]\nchannels = [\n  {name = "contact.force_upper", physical = "a/ai0"},\n]\n',
        '[[daq_card.channels]]\n"name" = "contact.force_upper"\nphysical = """a/ai0"""\n',
    ],
)
def test_what_cannot_be_edited_is_said_and_stays(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(text)
    with pytest.raises(RattleError, match=r'write there: contact.force_upper: physical = "b/ai1"'):
        change_bench(path, [Change("contact.force_upper", "physical", "b/ai1")])
    assert path.read_text() == text
    assert list(tmp_path.iterdir()) == [path]


def test_the_file_is_written_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(BENCH)
    change_bench(path, [Change("contact.force_upper", "inverted", True)])
    assert path.read_text() == BENCH.replace('range = "50 N"\n', 'range = "50 N"\ninverted = true\n')
    with pytest.raises(RattleError, match=r"no table of beam\.acceleration"):
        change_bench(path, [Change("beam.acceleration", "inverted", True)])

    def failing(descriptor: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", failing)
    before = path.read_text()
    with pytest.raises(RattleError, match=f"^cannot write {path}: Input/output error$"):
        change_bench(path, [Change("contact.force_upper", "inverted", False)])
    assert path.read_text() == before
    assert list(tmp_path.iterdir()) == [path]

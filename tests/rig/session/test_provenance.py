"""What the log says a run depended on."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from rig.files.bench import embedded_bench, parse_bench
from rig.files.software import commit_of, software
from rig.rigs import RIGS
from rig.session.logbook import run_record
from tests.rig.session.shafts import SteppedClock

CHAIN = "chain.crank.marker"
MARKED = 'name = "crank.marker"\n'


def record(notes: dict[str, str], encoder: str | None = None, more: str = "") -> dict[str, str]:
    devices = SimpleNamespace(
        actuator=SimpleNamespace(identity="an inverter"),
        card=SimpleNamespace(address="127.0.0.1:1", sample_rate=25_600.0),
        encoder=None if encoder is None else SimpleNamespace(identity=encoder),
        loggers={},
    )
    text = RIGS["planar_slider_crank"].bench.replace(MARKED, MARKED + more)
    bench = parse_bench(text, "test", Path(), "planar_slider_crank")
    return run_record(bench, devices, notes, "run", SteppedClock())  # type: ignore[arg-type]


def test_chains_of_the_bench_count_for_the_digest_of_the_calibrations_and_other_notes_do_not() -> None:
    key = "calibration_sha256"
    plain = record({})[key]
    assert record({"emulated": "card"})[key] == plain
    late, later = (record({}, more=f'delay = "{count} samples"\n') for count in (39, 40))
    assert len({plain, late[key], later[key]}) == 3
    assert json.loads(late[CHAIN])["delay_s"] == pytest.approx(39 / 25_600.0)


def test_notes_and_the_encoders_identity_stand_in_the_record() -> None:
    found = record({"emulated": "card"}, encoder="rotary encoder, serial number 1")
    assert found["emulated"] == "card"
    assert found["encoder"] == "rotary encoder, serial number 1"
    assert "encoder" not in record({})


def test_version_and_commit_stand_in_the_record() -> None:
    found = record({})
    assert found["software"].startswith("rattle ")
    assert software().items() <= found.items()


def test_the_commit_is_that_of_the_working_tree_and_says_whether_it_was_changed(tmp_path: Path) -> None:
    assert commit_of(tmp_path) == ""

    def git(*asked: str) -> str:
        who = ("-c", "user.name=a", "-c", "user.email=a@b")
        command = [str(shutil.which("git")), "-C", str(tmp_path), *who, *asked]
        told = subprocess.run(command, capture_output=True, check=True)  # noqa: S603
        return told.stdout.decode().strip()

    git("init", "-q")
    assert commit_of(tmp_path) == ""  # no commit yet
    (tmp_path / "a").write_text("1")
    git("add", "a")
    git("commit", "-qm", "one")
    commit = git("rev-parse", "HEAD")
    assert commit_of(tmp_path) == commit
    (tmp_path / "untracked").write_text("1")
    assert commit_of(tmp_path) == commit
    (tmp_path / "a").write_text("2")
    assert commit_of(tmp_path) == f"{commit}, changed since"
    assert commit_of(tmp_path, besides=tmp_path / "a") == commit


def test_each_sensors_sensitivity_and_calibration_stand_in_the_record() -> None:
    found, bench = record({}), embedded_bench("planar_slider_crank")
    frame, encoder = (bench.daq_card.channels[k] for k in (0, 3))
    assert float(found[f"sensitivity.{frame.name}"]) == frame.volts_per_unit
    assert found[f"calibrated.{frame.name}"] == f"{frame.calibrated}, valid until {frame.valid_until}"
    assert encoder.pulses is not None
    assert f"sensitivity.{encoder.name}" not in found

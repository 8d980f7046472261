"""Where a run's files go and what the log says of its origin."""

from __future__ import annotations

import datetime
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from daq.block import NS_PER_S
from daq.clock import Clock
from daq.errors import RecorderFailed
from rig.files.bench import Bench
from rig.session.devices import Devices

_LONGEST_NAME = 60


@dataclass(frozen=True, slots=True)
class Run:
    """A run's identity and its log."""

    id: str
    log: Path


def new_run(folder: Path, name: str, clock: Clock) -> Run:
    """Name a run after its scenario and the time; makes `folder` if needed."""
    started = _now(clock)
    plain = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:_LONGEST_NAME] or "run"
    run_id = f"{plain}_{started:%Y%m%d-%H%M%S}-{started.microsecond // 1000:03d}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecorderFailed(f"cannot make {folder}: {error.strerror}") from error
    return Run(run_id, folder / f"{run_id}.mcap")


def run_record(
    bench: Bench, devices: Devices, notes: Mapping[str, str], run_id: str, clock: Clock
) -> dict[str, str]:
    """The log's `run` record: identity, time, software, digests of what the run depended on, and `notes`.

    Notes on chains of sensors (`chain.<channel>`) count for the digest of the calibrations.
    """
    calibration = [
        f"{c.name} {c.serial} {c.sensitivity} {c.gain} {c.calibrated} {c.valid_until}"
        for c in bench.daq_card.channels
    ]
    calibration += [f"{key} {notes[key]}" for key in sorted(notes) if key.startswith("chain.")]
    encoder = {} if devices.encoder is None else {"encoder": devices.encoder.identity}
    return {
        "id": run_id,
        "started": f"{_now(clock):%Y-%m-%dT%H:%M:%S.%fZ}",
        "software": f"rattle {version('rattle')}",
        "bench": bench.source,
        "bench_sha256": _digest(bench.text),
        "calibration_sha256": _digest("\n".join(calibration)),
        "actuator": devices.actuator.identity,
        "card": devices.card.address,
        **encoder,
        **notes,
    }


def _now(clock: Clock) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(clock.unix_ns() / NS_PER_S, datetime.UTC)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

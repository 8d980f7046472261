"""Writes what the twin alone predicts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from daq.block import sample_time_ns
from daq.log.writer import LogWriter
from rig.files.faults import read_text
from rig.files.model_file import ModelFile
from rig.files.pairing import BYTES_PER_SAMPLE, check_room
from rig.files.scenario import Scenario
from rig.files.software import software
from rig.twin.prediction import blocks_of, settling_s, skip
from rig.twin.scenario_twin import predicted_channels
from sim_twin.twin import AnyTwin


def write_prediction(
    scenario: Scenario,
    twin: AnyTwin,
    seed: int | None,
    path: Path,
    effects: Path | None = None,
    fitted: ModelFile | None = None,
    told: Callable[[float], None] = lambda _: None,
) -> AnyTwin:
    """Write /predicted/... of `scenario` to the new file `path`; returns the twin that was run.

    Without `seed`: nominal, noiseless, from rest with the full drive at t = 0, sample 0 after `settle`. With
    it: a healthy draw with noise and any phase of the drive, settled before sample 0. Timestamps start at the
    Unix epoch. `effects` is the file whose effects `twin` has, `fitted` what it was
    matched by, for the record. `told` hears how many seconds are written.
    """
    model, rate = twin.model, scenario.acquisition.sample_rate
    noise, phase, before = None, 0.0, scenario.acquisition.settle
    if seed is not None:
        rng = np.random.default_rng(seed)
        twin, noise = model.draw_healthy(twin, rng, rng), rng
        phase = float(rng.uniform(0, 2 * np.pi))
        before = settling_s(twin, before)
    stream = model.stream(twin, rate, noise)
    count, channels = round(scenario.acquisition.duration * rate), predicted_channels(twin)
    check_room(path, count * len(channels) * BYTES_PER_SAMPLE)
    # without whole turns: by sample 0 a crank's angle is below one revolution
    cycles = phase / (2 * np.pi) + twin.drive.cycle_hz * before
    stream.drive(twin.drive, phase - float(2 * np.pi * np.floor(cycles)))
    skip(stream, round(before * rate))
    with whole_log(path) as log:
        log.add_metadata("scenario", {"toml": scenario.text})
        drawn = {} if seed is None else {"seed": str(seed)}
        log.add_metadata("run", {"id": path.stem, "started": "1970-01-01T00:00:00Z", **software(), **drawn})
        log.add_metadata("twin", twin_record(effects, fitted))
        for channel in channels:
            log.declare("predicted", channel)
        for block in blocks_of(stream, 0, count, start_ns=0):
            log.add_block("predicted", block, sample_time_ns(0, block.end_sample, rate))
            told(block.end_sample / rate)
    return twin


TWIN, MODEL = "twin", "model"
"""A log's metadata record of its twin, and the key of the model that it was matched by."""


def twin_record(effects: Path | None, model: ModelFile | None = None) -> dict[str, str]:
    """What a log says of the twin that made its predictions: effects that it was given, its model."""
    matched = {} if model is None else {MODEL: model.text}
    return {"effects": "[]" if effects is None else read_text(effects), **matched}


@contextmanager
def whole_log(path: Path) -> Iterator[LogWriter]:
    """A new log: one that is not completed, by a failure or by a person, is not left behind as if it were."""
    log = LogWriter(path).open()  # which leaves one alone that is there
    try:
        with closing(log):
            yield log
    except BaseException:
        path.unlink(missing_ok=True)
        raise

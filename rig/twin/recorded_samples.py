"""Samples of a log as a surrogate learns from them."""

from __future__ import annotations

import math

import numpy as np

from daq.errors import LogError
from daq.log.reader import LogReader
from rig.files.scenario import Scenario
from rig.twin.logged import followed_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, ANGLE
from sim_twin.rigs.planar_slider_crank.model import MATERIALS
from sim_twin.surrogates.samples import COLUMNS, Samples

RIG = "planar_slider_crank"
CHANNELS = ACCELERATIONS


def samples_of(log: LogReader, every: int = 1) -> tuple[Samples, float]:
    """Every so many of its samples with the crank's angle known, and their rate; before a stop of the run.

    Raises LogError where it is no run of the planar slider-crank, or lacks a channel.
    """
    scenario = followed_scenario(log)
    if scenario.rig != RIG:
        raise LogError(f"{log.path}: a run of the {scenario.rig}; surrogates are of the {RIG} alone")
    lacking = [name for name in (*CHANNELS, ANGLE) if name not in log.channels("measured")]
    if lacking:
        raise LogError(f"{log.path}: {', '.join(lacking)} not measured; a surrogate needs it")
    table = log.table("measured", (*CHANNELS, ANGLE), end_s=log.until_stop_s)
    rates = {each.sample_rate for each in table.values()}
    if len(rates) > 1:
        raise LogError(f"{log.path}: channels of different rates")
    rate = rates.pop()
    first = max(each.first_sample for each in table.values())
    end = min(each.end_sample for each in table.values())
    rows = {
        name: np.asarray(each.values[first - each.first_sample : end - each.first_sample : every], np.float64)
        for name, each in table.items()
    }
    for name, row in rows.items():
        if not np.isfinite(row).any():
            raise LogError(f"{log.path}: {name} has no value that is finite")
    times = (first + every * np.arange(len(rows[ANGLE]))) / rate
    known = np.all([np.isfinite(row) for row in rows.values()], axis=0)
    inputs = asked(scenario, times[known], rows[ANGLE][known])
    outputs = np.array([rows[name][known] for name in CHANNELS]).T
    turns = np.floor(rows[ANGLE][known] / math.tau).astype(np.int64)
    return Samples(inputs, outputs, np.zeros(len(turns), np.int64), turns), rate / every


def asked(scenario: Scenario, times_s: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """What a surrogate is asked for a scenario at times and crank angles (rad), shape (n, 6)."""
    rig = twin_of(scenario).rig
    material = str(scenario.model.get("material", "steel"))
    set_to = {
        "speed": scenario.drive.speed * 60 / math.tau,
        "clearance_1": 1e3 * rig.clearance_1,
        "clearance_2": 1e3 * rig.clearance_2,
        "density": MATERIALS[material].density,
    }
    columns = {
        "time": times_s,
        "angle": angles,
        **{name: np.full(len(angles), value) for name, value in set_to.items()},
    }
    return np.column_stack([columns[name] for name in COLUMNS])

"""Whether a run lies within what healthy rigs do, which is simulated once for a scenario and kept."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from shlex import quote
from typing import Final

import numpy as np

from daq.disk import write_whole
from daq.errors import RattleError
from daq.log.reader import LogReader
from rig.diagnosis.kept import digest_of, kept_arrays, setting_told, version_of
from rig.diagnosis.recordings import AloneRun, recorded_alone, work_of
from rig.ensembles import Simulated, cores, worker_processes
from rig.files.cache import cache_folder
from rig.files.model_file import parse_model
from rig.pages.words import listed
from rig.report.record import RunRecord, Verdict
from rig.session.progress import Screen
from rig.twin.logged import campaign_with_model
from sim_twin.diagnosis.fingerprint import Cell
from sim_twin.diagnosis.gap import GapMeasure
from sim_twin.diagnosis.healthy_band import HealthyBand, Place, healthy_band
from sim_twin.diagnosis.subject import Draw

HEALTHY_RIGS: Final = "RATTLE_HEALTHY_RIGS"
"""Of the environment: how many are simulated for a band; none and no verdict at 0."""
_RIGS, _FEWEST = 48, 0.5
_SIMULATED_S = 600.0
_LOOKED_AT_S = 20.0
"""Of a run, from its beginning: a verdict must be there at once, and thirty cycles are good."""
_NAMED = 3
_KEPT: Final = {"twin", "floor", "unit", "typical", "spread", "limits", "rigs"}


def judged(run: RunRecord, screen: Screen) -> RunRecord:
    """The run with the verdict on it."""
    return replace(run, verdict=verdict_on(run.path, screen))


def verdict_on(log: Path, screen: Screen) -> Verdict:
    """Judge the run of a log by its scenario's healthy band, which is simulated first where none is kept."""
    try:
        rigs = int(os.environ.get(HEALTHY_RIGS, _RIGS))
    except ValueError:
        rigs = _RIGS
    if not rigs:
        return Verdict(None, (f"Not judged: {HEALTHY_RIGS} is 0.",))
    try:
        run = recorded_alone(log, _LOOKED_AT_S)
        with LogReader(log) as reader:
            twin = reader.metadata.get("twin", {})
            model, repaired = twin.get("model", ""), twin.get("effects", "[]") != "[]"
        if model:
            fitted = parse_model(model, f"model in {log}", run.scenario.rig)
            campaign = campaign_with_model(run.campaign, fitted, [run.scenario], lambda _: None)
            run = replace(run, campaign=campaign)
        band = band_of(run, model, rigs, screen)
    except RattleError as error:
        return Verdict(None, (f"Not judged: {error}.",))
    except KeyboardInterrupt:
        return Verdict(None, ("Not judged: interrupted while healthy rigs were simulated.",))
    if band is None:
        return Verdict(None, ("Not judged: too few healthy rigs of this scenario could be simulated.",))
    next_step = _next_step(log, bool(model), repaired)
    return _told(run, band.places(run.measured), band.rigs, next_step, always=repaired)


def _next_step(log: Path, matched: bool, repaired: bool = False) -> str:
    """A command that judges by the model that the verdict went by; of an overlay, with its effects."""
    model = " --model MODEL.toml" if matched else ""
    by = ", by the model that the run had" if matched else ""
    if repaired:
        gap = f"rattle gap {quote(str(log))} --effects EFFECTS.json{model}"
        return f"Judged without the effects of this overlay; how far they close the gap: {gap}{by}"
    return f"What causes it: rattle diagnose {quote(str(log))}{model} --out answer{by}"


def _told(run: AloneRun, places: list[Place], rigs: int, next_step: str, always: bool) -> Verdict:
    """The verdict in words; the next step of one that is not well, or `always`."""
    whole, *channels = places
    beyond = [place for place in channels if place.beyond]
    known = (
        f"Gap {whole.gap:.2f}: healthy rigs have about 1, rarely more than {whole.farthest:.2f}, "
        f"by {rigs} that were simulated."
    )
    remarks, further = [f"Mind: {remark}." for remark in run.remarks], [next_step] if always else []
    if not beyond and not whole.beyond:
        nearest = max(channels, key=lambda place: place.gap / place.farthest)
        most = f"Nearest to its limit is {nearest.channel}, {_size(nearest)}."
        within = "Within what healthy rigs do"
        if run.left_out:
            within += f", but nobody knows of {listed(run.left_out)}"
        return Verdict(None if run.left_out else True, (f"{within}.", f"{known} {most}", *remarks, *further))
    named = [f"{place.channel}, {_size(place)}, {_why(place)}" for place in (beyond or channels)[:_NAMED]]
    more = len(beyond) - len(named)
    where = f"Most in {'; in '.join(named)}" + (f"; and in {more} more." if more > 0 else ".")
    return Verdict(False, ("Not what healthy rigs do.", f"{known} {where}", *remarks, next_step))


def _size(place: Place) -> str:
    return f"gap {place.gap:.2f} (healthy up to {place.farthest:.2f})"


def _why(place: Place) -> str:
    """What of a channel is off, in words: where it is farthest, or that all of a kind is so."""
    level = place.level
    if place.gap_beyond or level is None or not level.beyond:
        return _spot(place.worst)
    than = "higher" if level.off > 0 else "lower"
    return f"its {level.what} {than} throughout, {abs(level.off):.1f} deviations of healthy rigs"


def _spot(cell: Cell) -> str:
    """Where in a channel a cell lies, in words."""
    if cell.band is not None:
        return f"above all its {cell.what} at {cell.band[0]:.0f} to {cell.band[1]:.0f} Hz"
    if cell.phase is not None:
        return f"above all its {cell.what} from {cell.phase[0]:.2f} to {cell.phase[1]:.2f} of the cycle"
    return f"above all its {cell.what}"


def band_of(run: AloneRun, model: str, rigs: int, screen: Screen) -> HealthyBand | None:
    """The band of the run's scenario that is kept, or simulated now; None where too few rigs could be."""
    file = cache_folder() / "healthy" / f"{_key(run, model, rigs)}.npz"
    layout = run.campaign.layout
    numbers = kept_arrays(file)
    if numbers is not None and numbers.keys() >= _KEPT and len(numbers["twin"]) == layout.size:
        measure = GapMeasure(layout, numbers["twin"], numbers["floor"], float(numbers["unit"]))
        ends = numbers["typical"], numbers["spread"], numbers["limits"]
        return HealthyBand(measure, *ends, int(numbers["rigs"]))
    draws = [Draw((), seed, blocks=run.blocks) for seed in range(rigs)]
    what = "simulating healthy rigs, once for this scenario"
    work = work_of("simulate", run.campaign, [draw.blocks for draw in draws])
    with screen.bar(what, len(draws), "rigs", work) as bar, worker_processes(cores()) as workers:
        simulated = Simulated(run.campaign, workers.executor, time.monotonic() + _SIMULATED_S, bar)
        shown = simulated(draws)
    healthy = [each[0] for each in shown if each and each[0] is not None]
    if len(healthy) < max(_FEWEST * rigs, 3):
        return None
    band = healthy_band(healthy, layout)
    measure = band.measure
    if simulated.cut_short:
        return band
    content = BytesIO()
    np.savez(
        content,
        twin=measure.twin,
        floor=measure.floor,
        unit=measure.unit,
        typical=band.typical,
        spread=band.spread,
        limits=band.limits,
        rigs=band.rigs,
    )
    with suppress(OSError):  # without a place to keep it, it is simulated again
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, content.getvalue())
    return band


def _key(run: AloneRun, model: str, rigs: int) -> str:
    """A digest of all that the band follows from."""
    (setting,) = run.campaign.runs
    told = (version_of(setting), *setting_told(setting), model, rigs, run.blocks)
    return digest_of(*told).hex()

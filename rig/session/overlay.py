"""Adds a prediction to a recorded run, in a new file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from daq.block import sample_time_ns
from daq.channel import Channel
from daq.errors import LogError
from daq.log.codec import decode_block
from daq.log.front import CUT
from daq.log.reader import SURROGATE, LogReader, Origin
from daq.log.records import Event, Impact
from daq.log.recover import origin_of_copy
from daq.log.writer import LogWriter
from rig.derived.derivation import Derivation, derived_channels
from rig.derived.settings import RECORD, from_record
from rig.files.model_file import load_model
from rig.files.pairing import BYTES_PER_SAMPLE, check_room
from rig.files.scenario import Scenario
from rig.files.software import software
from rig.rigs import RIGS
from rig.session.pace import Work
from rig.session.progress import MOTION_S, Screen
from rig.stream import Block, Metadata, Record
from rig.twin.chains import mounting_of
from rig.twin.logged import align_to, followed_scenario, logged_twin, with_model
from rig.twin.prediction import AlignedTwin
from rig.twin.prediction_file import twin_record, whole_log
from rig.twin.scenario_twin import predicted_channels, with_effects
from sim_twin.twin import AnyTwin

if TYPE_CHECKING:
    from sim_twin.surrogates.surrogate import Surrogate


def overlay_run(
    run: Path,
    target: Path,
    effects: Path | None = None,
    model: Path | None = None,
    warn: Callable[[str], None] = lambda _: None,
    surrogate: Path | None = None,
    screen: Screen | None = None,
) -> None:
    """Copy `run` to the new log `target` with /predicted/... of every measured channel in it.

    What follows from the samples of both, /derived/... and /impact, comes with them.

    One of a log that a crash cut says so, as `rattle recover` does; of a damaged one there is none: LogError.
    The twin takes phase and mean frequency from the measured drive. `effects`: a file with what it also gets;
    the twin without them then comes too, as /nominal/... `model`: one that every twin is matched by, of which
    `warn` hears what does not hold for this run. `surrogate`: one that says what it learnt, as
    /predicted/surrogate/... `screen` shows how long it takes.
    """
    with ExitStack() as stack:
        log = stack.enter_context(LogReader(run))
        comes_from = _origin(log)
        scenario = followed_scenario(log)
        measured = log.channels("measured")
        if not measured:
            raise LogError(f"{run}: nothing measured in it")
        twin = logged_twin(log, scenario)
        fitted = None if model is None else load_model(model, scenario.rig, scenario.specimen)
        if fitted is not None:
            twin = with_model(twin, fitted, scenario, warn)
        learnt = None
        if surrogate is not None:
            from rig.files.surrogate_file import load_surrogate  # with scikit-learn

            learnt = load_surrogate(surrogate, scenario.rig, measured)
        twins: dict[Origin, AnyTwin] = {"predicted": twin}
        if effects is not None:
            twins = {"predicted": with_effects(twin, effects), "nominal": twin}
        record_s = log.end_s("measured", next(iter(measured)))  # which may have ended before it was asked to
        samples = len(twins) * len(measured) * record_s * scenario.acquisition.sample_rate
        check_room(target, run.stat().st_size + samples * BYTES_PER_SAMPLE)
        told = stack.enter_context(_shown(screen, scenario, len(twins) * record_s, learnt is not None))
        with whole_log(target) as copy:
            derived = _derivation(log, copy, scenario, twins)
            _copy(log, copy, comes_from, derived)
            record = twin_record(effects, fitted) | software()
            if "nominal" in twins:
                cycle = align_to(log, twins["nominal"])  # the drive's, for folding all three
                record |= {
                    "predicted": "with these effects",
                    "nominal": "without these effects",
                    "cycle_hz": f"{cycle.frequency:.12g}",
                    "cycle_phase_rad": f"{cycle.phase:.12g}",
                    "from_rest": "false" if cycle.onset is None else "true",
                }
            copy.add_metadata("twin", record)
            for number, (origin, each) in enumerate(twins.items()):

                def so_far(seconds: float, before_s: float = number * record_s) -> None:
                    told(before_s + seconds)

                _predict(log, copy, scenario, origin, each, derived, so_far)
            derived.finish()
            if surrogate is not None and learnt is not None:
                _speak(log, copy, surrogate, learnt, twin, warn)


def _shown(
    screen: Screen | None, scenario: Scenario, predicted_s: float, learnt: bool
) -> AbstractContextManager[Callable[[float], None]]:
    if screen is None:
        return nullcontext(lambda _: None)
    work = Work(f"overlay {scenario.rig}{' by a surrogate' if learnt else ''}", predicted_s)
    return screen.bar("predicting", predicted_s, MOTION_S, work)


def _speak(
    log: LogReader,
    copy: LogWriter,
    file: Path,
    learnt: Surrogate,
    twin: AnyTwin,
    warn: Callable[[str], None],
) -> None:
    """Add what a surrogate predicts, and that a run lies outside of what it learnt, or is what it learnt."""
    from rig.twin.recorded_samples import beside, digest_of

    blocks, outside = beside(log, learnt)
    told = [
        ("outside", f"the surrogate is asked beyond what it learnt: {text}", text)
        for text in outside.values()
    ]
    if digest_of(log.path) in learnt.learnt_from.values():
        text = "it learnt from this run: what it says beside it is no prediction"
        told.append(("learnt", f"the surrogate: {text}", text))
    for channel in predicted_channels(twin):
        if channel.name in learnt.channels:
            copy.declare(SURROGATE, channel)
    for index, block in enumerate(blocks):
        if index == 0:
            for code, words, text in told:
                warn(words)
                copy.add_event(Event(block.time_ns, "warning", "surrogate", f"surrogate.{code}", text))
        copy.add_block(SURROGATE, block, sample_time_ns(block.time_ns, len(block), block.sample_rate))
    record = {"network": learnt.kind, "over": learnt.over, "logs": json.dumps(dict(learnt.learnt_from))}
    copy.add_metadata("surrogate", record | {"file": f"{file.name} {digest_of(file)}"})


def _derivation(
    log: LogReader, copy: LogWriter, scenario: Scenario, twins: Mapping[Origin, AnyTwin]
) -> Derivation:
    """What follows from samples in `copy`, by what the run settled of the measured; declares its channels."""
    measured = log.channels("measured")
    channels: dict[Origin, list[Channel]] = {"measured": list(measured.values())}
    channels |= {origin: _predicted_of(twin, measured) for origin, twin in twins.items()}
    for channel in derived_channels(channels, scenario):
        copy.declare("derived", channel)
    known = {
        origin: settings
        for origin, settings in from_record(log.metadata.get(RECORD, {})).items()
        if origin == "measured"
    }
    names = {origin: [channel.name for channel in each] for origin, each in channels.items()}

    def write(record: Record) -> None:
        match record:
            case Block(origin, samples):  # in the log as if the host had it when it ends
                end_ns = sample_time_ns(samples.time_ns, len(samples), samples.sample_rate)
                copy.add_block(origin, samples, end_ns)
            case Impact():
                copy.add_impact(record, record.time_ns)
            case Metadata(name, values):
                copy.add_metadata(name, values)

    mounting = mounting_of(log.metadata.get("run", {}), RIGS[scenario.rig].channels)
    return Derivation(write, names, scenario, known, mounting, log.allowance().spend)


def _predicted_of(twin: AnyTwin, measured: Mapping[str, Channel]) -> list[Channel]:
    return [channel for channel in predicted_channels(twin) if channel.name in measured]


def _origin(log: LogReader) -> dict[str, dict[str, str]]:
    """What its copy says of a log that a crash cut, or nobody could check; LogError for a damaged one."""
    origin = origin_of_copy(log)
    if log.damage not in ("", CUT):
        raise LogError(f"{log.path} is damaged ({log.damage}): rattle recover first")
    return origin


def _copy(
    log: LogReader, copy: LogWriter, comes_from: Mapping[str, dict[str, str]], derived: Derivation
) -> None:
    """Everything but an earlier prediction and what was derived, message by message as it was."""
    for name, record in {**log.metadata, **comes_from}.items():
        if name not in ("twin", "derived", "surrogate"):
            copy.add_metadata(name, record)
    for channel in log.channels("measured").values():
        copy.declare("measured", channel)
    for gap in log.gaps():
        if gap.origin in ("", "measured"):
            copy.add_gap(gap, gap.time_ns)
    for message in log.messages({f"/measured/{name}" for name in log.channels("measured")}):
        block = decode_block(message.topic.removeprefix("/measured/"), message.data)
        copy.add_encoded_block("measured", block, message.data, message.log_ns, record_gap=False)
        derived(Block("measured", block))
    for event in log.events():
        if event.source != "surrogate":
            copy.add_event(event)
    for clock in log.clocks():
        copy.add_clock(clock)


def _predict(
    log: LogReader,
    copy: LogWriter,
    scenario: Scenario,
    origin: Origin,
    twin: AnyTwin,
    derived: Derivation,
    told: Callable[[float], None],
) -> None:
    measured = log.channels("measured")
    wanted = _predicted_of(twin, measured)
    for channel in wanted:
        copy.declare(origin, channel)
    reference = log.series("measured", next(iter(measured)), end_s=log.until_stop_s)
    rate = reference.sample_rate
    start_ns = sample_time_ns(reference.time_ns, -reference.first_sample, rate)
    alignment = align_to(log, twin)
    aligned = AlignedTwin(twin, alignment, rate, scenario.acquisition.settle)
    names = {channel.name for channel in wanted}
    for block in aligned.blocks(reference.end_sample, start_ns):
        if block.channel in names:
            copy.add_block(origin, block, sample_time_ns(block.time_ns, len(block), rate))
            derived(Block(origin, block))
        told(block.end_sample / rate)

"""The verdict on a run: within what healthy rigs do, or where it is not."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from io import StringIO
from pathlib import Path

import pytest

from daq.block import Flag, SampleBlock
from daq.log import codec
from daq.log.codec import decode_block
from rig.diagnosis import health
from rig.diagnosis.health import HEALTHY_RIGS, _next_step, band_of, verdict_on
from rig.diagnosis.kept import sources_of
from rig.diagnosis.recordings import recorded_alone
from rig.ensembles import Simulated, Workers
from rig.session.progress import Screen, Terminal
from sim_twin.diagnosis.fingerprint import Cell
from sim_twin.diagnosis.healthy_band import Place
from sim_twin.diagnosis.subject import Draw, Observed
from tests.rig.diagnosis.measured_log import BEAM, BLOCK, flagged, recording, write
from tests.rig.synthetic_run import SCENARIO, write_log

SAMPLES = Path(__file__).parents[3].parent / "shared" / "samples"
RUN = SCENARIO + '[acquisition]\nsample_rate = "51.2 kHz"\nduration = "5 s"\n'


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Eight healthy rigs in this process, and where their band is kept."""

    @contextmanager
    def here(count: int) -> Iterator[Workers]:
        with ThreadPoolExecutor(1) as executor:
            yield Workers(executor, 1)

    monkeypatch.setattr(health, "worker_processes", here)
    monkeypatch.setenv(HEALTHY_RIGS, "8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "rattle" / "healthy"


def screen() -> Screen:
    return Screen(Terminal(file=StringIO()))


def test_a_run_of_pulses_is_not_what_healthy_beams_do_and_the_band_is_kept(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = write_log(tmp_path / "run.mcap", 4.5, origins=["measured"], scenario=RUN)
    found = verdict_on(log, screen())
    assert found.well is False
    first, where, *_, next_step = found.sentences
    assert first == "Not what healthy rigs do."
    assert "contact.force" in where
    assert next_step == f"What causes it: rattle diagnose {log} --out answer"
    assert len(list(kept.iterdir())) == 1

    def none(*_: object) -> None:
        raise AssertionError("simulated again")

    monkeypatch.setattr(health, "Simulated", none)
    assert verdict_on(log, screen()) == found


def test_the_next_step_is_a_command_that_goes_by_the_models_twin() -> None:
    log = Path("my runs") / "run.mcap"
    with_effects = _next_step(log, matched=False, repaired=True)
    gap = f"rattle gap '{log}' --effects EFFECTS.json"
    assert with_effects == f"Judged without the effects of this overlay; how far they close the gap: {gap}"
    by_model = _next_step(log, matched=True, repaired=True)
    assert by_model.endswith(f"{gap} --model MODEL.toml, by the model that the run had")
    assert _next_step(log, matched=False) == f"What causes it: rattle diagnose '{log}' --out answer"
    assert f"diagnose '{log}' --model MODEL.toml --out answer" in _next_step(log, matched=True)


@pytest.mark.long
@pytest.mark.parametrize(
    "damaged", [lambda _: b"", lambda whole: whole[:100], lambda whole: bytes(len(whole))]
)
def test_a_band_that_cannot_be_read_is_made_anew(
    damaged: Callable[[bytes], bytes], kept: Path, tmp_path: Path
) -> None:
    log = write_log(tmp_path / "run.mcap", 4.5, origins=["measured"], scenario=RUN)
    found = verdict_on(log, screen())
    (file,) = kept.iterdir()
    file.write_bytes(damaged(file.read_bytes()))
    assert verdict_on(log, screen()) == found
    assert file.stat().st_size > 1000


def test_a_band_that_time_cut_short_is_not_kept(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Late(Simulated):
        def __call__(self, draws: Sequence[Draw]) -> list[Observed]:
            self.cut_short = True
            return super().__call__(draws)

    monkeypatch.setattr(health, "Simulated", Late)
    log = write_log(tmp_path / "run.mcap", 4.5, origins=["measured"], scenario=RUN)
    assert verdict_on(log, screen()).well is False
    assert not kept.exists()


def test_healthy_rigs_are_looked_at_for_as_long_as_a_whole_run(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    class Asked(Simulated):
        def __call__(self, draws: Sequence[Draw]) -> list[Observed]:
            asked.extend(draw.blocks for draw in draws)
            return [(None,) for _ in draws]

    monkeypatch.setattr(health, "Simulated", Asked)
    # cycles of 50 ms, 36 a block: 97 of them in 5 s, the last 3 left out; a run that was cut has two blocks
    for seconds, recorded_s, blocks in ((5, 4.5, 2), (10, 9.5, 5), (60, 4.5, 2)):
        scenario = RUN.replace('duration = "5 s"', f'duration = "{seconds} s"')
        run = recorded_alone(
            write_log(tmp_path / f"{seconds}.mcap", recorded_s, origins=["measured"], scenario=scenario), 20.0
        )
        band_of(run, "", 8, screen())
        assert asked == [blocks] * 8
        asked.clear()


def test_of_the_noise_of_a_filtered_drive_as_much_is_left_as_of_any_other(tmp_path: Path) -> None:
    """Of a drive without a filter every second sample is taken, whose noise is as strong as that of all."""
    chain = {"chain.drive.force": json.dumps({"filter": {"corner_hz": 1718.0, "order": 6}})}
    left = [
        recorded_alone(
            write_log(tmp_path / f"{number}.mcap", 2.0, origins=["measured"], scenario=RUN, bench=bench), 20.0
        )
        .campaign.runs[0]
        .quiet
        for number, bench in enumerate(({}, chain))
    ]
    assert [each["drive.force"] for each in left] == [1.0, left[1]["yoke.force"]]
    assert left[1]["yoke.force"] == pytest.approx(0.7, abs=0.01)


def test_a_band_hangs_on_the_code_of_a_rig_from_another_package(tmp_path: Path) -> None:
    def digest(file: Path) -> str:
        sources_of.cache_clear()
        return sources_of(str(file))

    (tmp_path / "pendulum").mkdir()
    rig, physics, lone = (tmp_path / name for name in ("pendulum/rig.py", "pendulum/physics.py", "lone.py"))
    for file in (tmp_path / "pendulum" / "__init__.py", rig, physics, lone):
        file.write_text("")
    before, alone = digest(rig), digest(lone)
    physics.write_text("GRAVITY = 9.81")
    assert digest(rig) != before
    assert digest(lone) == alone


class Wide:
    """A band that every run lies within."""

    rigs = 8

    def places(self, _: object) -> list[Place]:
        return [Place(name, 1.0, 1.5, False, Cell(0, name, "rms")) for name in ("", "drive.force")]


def test_a_verdict_says_what_it_did_not_look_at(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def overloaded(block: SampleBlock) -> SampleBlock:
        lost = block.channel == "yoke.force" and block.first_sample == 0
        return flagged(block, Flag.OVERLOAD) if lost else block

    monkeypatch.setattr(health, "band_of", lambda *_: Wide())
    monkeypatch.setattr(health, "_LOOKED_AT_S", 1.2)
    log = write(tmp_path / "run.mcap", recording(BEAM), BEAM, ["base.acceleration"], overloaded)
    found = verdict_on(log, screen())
    assert found.well is True
    said = " ".join(found.sentences[2:])
    assert "first 1.2 s of 1.5 s" in said
    assert "yoke.force: 8.3% overloaded" in said
    assert "no base.acceleration" in said


def test_a_verdict_reads_once_what_it_looks_at_and_nothing_behind_it(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: Counter[tuple[str, int]] = Counter()

    def decoded(name: str, data: bytes) -> SampleBlock:
        block = decode_block(name, data)
        read[name, block.first_sample] += 1
        return block

    monkeypatch.setattr(health, "band_of", lambda *_: Wide())
    monkeypatch.setattr(health, "_LOOKED_AT_S", 1.0)
    log = write(tmp_path / "run.mcap", recording(BEAM), BEAM)
    monkeypatch.setattr(codec, "decode_block", decoded)
    assert verdict_on(log, screen()).well is True
    assert sum(first >= BLOCK * 11 for _, first in read) == 1  # the last one, for how long the run was
    first = min(read)
    assert all(times == 1 for block, times in read.items() if block != first), read


def test_no_run_is_well_of_which_a_recorded_channel_is_lost(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def overloaded(block: SampleBlock) -> SampleBlock:
        return flagged(block, Flag.OVERLOAD) if block.channel == "base.acceleration" else block

    monkeypatch.setattr(health, "band_of", lambda *_: Wide())
    found = verdict_on(write(tmp_path / "run.mcap", recording(BEAM), BEAM, (), overloaded), screen())
    assert found.well is None
    assert found.sentences[0] == "Within what healthy rigs do, but nobody knows of base.acceleration."
    assert "100% of it overloaded" in found.sentences[2]


@pytest.mark.parametrize(
    ("seconds", "scenario", "why"),
    [
        (0.3, RUN, "5 sound cycles; a verdict needs 10"),
        (1.0, "", "no scenario in it"),
        (1.4, RUN.replace("duration", 'settle = "0 s"\nduration'), "once the motion has set in"),
    ],
)
def test_what_cannot_be_judged_is_told_with_the_reason(
    kept: Path, tmp_path: Path, seconds: float, scenario: str, why: str
) -> None:
    found = verdict_on(
        write_log(tmp_path / "run.mcap", seconds, origins=["measured"], scenario=scenario), screen()
    )
    assert found.well is None
    assert found.sentences[0].startswith("Not judged: ")
    assert why in found.sentences[0]
    assert not kept.exists()


def test_who_wants_none_gets_none(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(HEALTHY_RIGS, "0")
    log = write_log(tmp_path / "run.mcap", 1.0, scenario=RUN)
    assert verdict_on(log, screen()).sentences == (f"Not judged: {HEALTHY_RIGS} is 0.",)


@pytest.mark.long
@pytest.mark.skipif(not SAMPLES.is_dir(), reason="no recordings of other programs beside here")
@pytest.mark.parametrize(
    ("name", "well"),
    [
        ("beam_healthy", True),
        ("beam_base_flexibility", False),
        ("crank_healthy", True),
        ("crank_joint_friction", False),
    ],
)
def test_recordings_of_another_program_are_judged_right(
    name: str, well: bool, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(HEALTHY_RIGS, "48")
    assert verdict_on(SAMPLES / f"{name}.mcap", screen()).well is well

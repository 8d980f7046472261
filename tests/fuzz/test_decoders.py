"""No decoder raises anything but rattle's own errors, or takes more than it may, whatever comes."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings

from benchmarks.fuzz import head
from tests.fuzz.strategies import inputs
from tests.fuzz.targets import CORPUS, IMPORTED, TARGETS, Spent, Target, kept
from tests.hostile import MOST_BYTES

_quick = settings(
    max_examples=200,
    derandomize=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.filterwarnings("ignore::UserWarning:nptdms")
def test_what_is_almost_sound_does_no_harm(name: str) -> None:
    spent = Spent(name)

    @_quick
    @given(data=inputs(name))
    def harmless(data: bytes) -> None:
        spent.run(data)

    harmless()


@pytest.mark.parametrize("name", TARGETS)
def test_what_was_kept_does_no_harm(name: str) -> None:
    """Among them all that ever did."""
    spent = Spent(name)
    for path in kept(name):
        spent.run(path.read_bytes())


def test_an_input_that_takes_too_much_is_found_also_behind_a_heavy_test(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def take(data: bytes) -> None:
        bytearray(b"x") * len(data)

    monkeypatch.setitem(TARGETS, "messages", Target(take))
    del (heavy := [bytearray(b"x") * (2 * MOST_BYTES)])[:]
    spent = Spent("messages")
    assert not heavy
    spent.run(bytes(1 << 20))
    with pytest.raises(AssertionError, match="MiB"):
        spent.run(bytes(MOST_BYTES + (1 << 24)))


def test_the_page_says_what_was_tried_too_little() -> None:
    def lines(runs: int, failures: int = 0) -> dict[str, str]:
        return {name: f"    {name} {runs} 9 9 9 0.1 {failures} 2026-11-26" for name in TARGETS}

    assert head(lines(1_000_000)).startswith("## Odd inputs: held\n")
    assert head(lines(1_000_000, 1)).startswith("## Odd inputs: NOT HELD\n")
    few = lines(1_000_000) | {name: line for name, line in lines(250_000).items() if name in IMPORTED}
    assert head(few).startswith("## Odd inputs: held\n")  # together
    few["log"] = lines(7)["log"]
    del few["can"]
    assert head(few).startswith("## Odd inputs: held so far\n")
    assert "Fewer than a million so far: log 7, can 0.\n" in head(few)


def test_what_fails_at_once_is_found_again_by_each_call(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a kept input that does harm the next call tells as the last one did."""

    def harm(data: bytes) -> None:
        raise ZeroDivisionError

    monkeypatch.setitem(TARGETS, "messages", Target(harm))
    spent = Spent("messages")
    with pytest.raises(ZeroDivisionError):
        spent.run(kept("messages")[0].read_bytes())


def test_the_corpora_stay_small() -> None:
    files = [path for path in CORPUS.rglob("*") if path.is_file()]
    assert {path.parent.name for path in files} == set(TARGETS)
    assert sum(path.stat().st_size for path in files) < 1 << 20

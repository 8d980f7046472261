"""No decoder raises anything but rattle's own errors, or takes more than it may, whatever comes."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings

from tests.fuzz.strategies import inputs
from tests.fuzz.targets import CORPUS, TARGETS, Spent, Target, kept
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


def test_the_corpora_stay_small() -> None:
    files = [path for path in CORPUS.rglob("*") if path.is_file()]
    assert {path.parent.name for path in files} == set(TARGETS)
    assert sum(path.stat().st_size for path in files) < 1 << 20

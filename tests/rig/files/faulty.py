"""What a test says of a faulty file: the problem at a key, and that nothing else is wrong."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from daq.errors import ConfigurationError, Problem


def problems_of(parse: Callable[[], object]) -> dict[str, Problem]:
    """Problems that `parse` raises, by key."""
    with pytest.raises(ConfigurationError, match=":\n") as caught:
        parse()
    return {problem.key: problem for problem in caught.value.problems}


def only_problem(parse: Callable[[], object], key: str) -> Problem:
    """The one problem that `parse` raises, which has to be at `key`."""
    problems = problems_of(parse)
    assert list(problems) == [key]
    return problems[key]

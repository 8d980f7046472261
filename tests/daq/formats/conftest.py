from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.formats.samples import Scratch


@pytest.fixture
def scratch(tmp_path: Path) -> Iterator[Scratch]:
    with Scratch(tmp_path) as opened:
        yield opened

"""Three measured sets as rigs of one's own: small twins that the diagnosis has never heard of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

MEASURED = Path(__file__).parents[2].parent / "shared" / "real-data"
"""The measured sets lie beside the project, not in it."""
_HERE = Path(__file__).parent
_ALIKE = 0.3

needs_measured_sets = pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no {MEASURED}")


def sets() -> Iterator[tuple[str, Path, Path]]:
    """Name, subject and file of each set."""
    yield "silverbox", _HERE / "silverbox.py", MEASURED / "silverbox" / "silverbox.npz"
    damper = MEASURED / "friction_damper_backlash" / "dataset-2.npz"
    yield "friction damper", _HERE / "friction_damper.py", damper
    for path in sorted((MEASURED / "ball_drops").glob("*.csv")):
        name = path.stem.removeprefix("ball_drops_").replace("_", " ").lower()
        yield name, _HERE / "ball_drop.py", path


@dataclass(frozen=True, slots=True)
class Verdict:
    """The most probable set of missing effects, and what may be the largest of them.

    `alike` begins with the likeliest, has "none" for nothing, and holds all that cannot be told from it.
    """

    selected: tuple[str, ...]
    alike: tuple[str, ...]


def verdict_of(diagnosis: Mapping[str, Any]) -> Verdict:
    """What a diagnosis.json says.

    Alike is what is at least 0.3 times as probable as the likeliest, and what the diagnosis cannot tell from
    it.
    """
    shares = {each: diagnosis["verdict_probability"][each] for each in ("none", "unknown")}
    shares |= {each["name"]: each["probability"] for each in diagnosis["effects"]}
    order = sorted(shares, key=lambda name: -shares[name])
    likely = [name for name in order if shares[name] >= _ALIKE * shares[order[0]]]
    of_first = [each["indistinguishable_from"] for each in diagnosis["effects"] if each["name"] == order[0]]
    alike = tuple(dict.fromkeys([*likely, *(name for names in of_first for name in names)]))
    return Verdict(tuple(diagnosis["selected"]), alike)

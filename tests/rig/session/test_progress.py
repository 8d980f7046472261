"""What a person sees where there is no terminal."""

from __future__ import annotations

from io import StringIO

from rich.console import Console

from rig.session.progress import Screen


def said(total: float, unit: str, steps: int) -> list[str]:
    out = StringIO()
    with Screen(Console(file=out)).bar("simulating", total, unit) as bar:
        for done in range(steps + 1):
            bar(done * total / steps)
    return out.getvalue().splitlines()


def test_a_count_is_told_by_quarters_and_seconds_are_not() -> None:
    quarters = [f"simulating {share} %" for share in (25, 50, 75)]
    assert said(3000, "rigs", 7) == ["simulating (3000 rigs) ...", *quarters]
    assert said(3000, "rigs", 1) == ["simulating (3000 rigs) ...", "simulating 75 %"]
    assert said(0, "rigs", 1)[0] == "simulating (0 rigs) ..."
    assert said(60, "s", 7) == ["simulating (60 s) ..."]

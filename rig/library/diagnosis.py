"""What a diagnosis found, for Python."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import RattleError
from rig.diagnosis.diagnose_runs import BUDGET_S, diagnose_runs
from rig.diagnosis.own_rig import OwnRequest, diagnose_own
from rig.files.file_kind import refuse_other_than_log
from rig.files.out_folder import check_out
from rig.library.log import Folder, Log, needed, table_of
from rig.library.run import unguarded_main
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go

_File = str | PathLike[str]


class Diagnosis:
    """What is missing in the twin; `document` is all of it, as diagnosis.json has it."""

    def __init__(
        self, document: dict[str, Any], report: Path, selected: list[dict[str, Any]], kept: object
    ) -> None:
        self.document, self._kept = document, kept
        self.report = report
        """The page that shows why."""
        self.effects = selected
        """What was selected, with its best values: `rattle.predict(scenario, diagnosis.effects)`."""

    @property
    def verdict(self) -> str:
        """none: the twin explains the runs; effect: something of the catalogue; unknown: something else."""
        return str(self.document["verdict"])

    @property
    def probability(self) -> dict[str, float]:
        """Of each verdict."""
        return dict(self.document["verdict_probability"])

    @property
    def gap(self) -> dict[str, Any]:
        """How far off the twin is, `before` and `after` the effects; 1 is as far as a healthy rig."""
        return dict(self.document["gap"])

    def to_pandas(self) -> pd.DataFrame:
        """A row for each effect of the catalogue, most probable first."""
        frame: pd.DataFrame = needed("pandas").DataFrame(self.document["effects"])
        return frame.set_index("name")

    def contrasts(self) -> pd.DataFrame:
        """The figures in which the runner-up predicts otherwise: measured, by what was selected, by it."""
        frame: pd.DataFrame = needed("pandas").DataFrame(self.document["contrasts"])
        return frame

    def plot_cycle(self) -> go.Figure:
        """A typical cycle of the channels that are furthest off: measured, and of the twins."""
        from plotly.subplots import make_subplots

        cycles = self.document["typical_cycle"]
        titles = [f"{each['channel']}, {each['unit']}" for each in cycles]
        figure = make_subplots(len(cycles), 1, shared_xaxes=True, subplot_titles=titles)
        for row, each in enumerate(cycles):
            for whose in ("measured", "nominal", "repaired"):
                if whose in each:
                    line = {"name": whose, "x": each[whose]["phase"], "y": each[whose]["values"]}
                    figure.add_scatter(**line, row=row + 1, col=1)
        return figure.update_layout(template="plotly_white")

    def plot(self) -> go.Figure:
        """The gap of each channel; 1 is a healthy rig's."""
        import plotly.graph_objects as go

        channels = {name: gap for name, gap in self.gap["by_channel"].items() if gap is not None}
        figure = go.Figure(go.Bar(x=list(channels.values()), y=list(channels), orientation="h"))
        figure.add_vline(1.0, line_dash="dash", annotation_text="healthy")
        figure.update_layout(xaxis_title="gap", xaxis_type="log", template="plotly_white")
        return figure

    def __repr__(self) -> str:
        names = " and ".join(self.document["selected"]) or self.verdict
        return f"<Diagnosis: {names}, gap {_number(self.gap['before'])} -> {_number(self.gap['after'])}>"

    def _repr_html_(self) -> str:
        shares = ("probability", "present")
        shown = [each for each in self.document["effects"] if each["present"] >= 0.005]
        rows = [
            [each["name"], *(f"{each[share]:.1%}" for share in shares), _number(each["gap_after"])]
            for each in shown
        ]
        rows += [[name, f"{self.probability[name]:.1%}", "", ""] for name in ("none", "unknown")]
        headings = ["cause", "probability", "in the rig", "gap with it in"]
        return f"<p>{html.escape(repr(self))}</p>" + table_of(headings, rows)


def diagnosed(
    logs: _File | Log | Sequence[_File | Log],
    out: _File | None,
    model: _File | None,
    seed: int,
    budget: float | None,
    quiet: bool,
    subject: _File | None,
) -> Diagnosis:
    """See `rattle.diagnose`."""
    each = [logs] if isinstance(logs, str | PathLike | Log) else list(logs)
    if not each:
        raise RattleError("a diagnosis needs a log at least")
    runs = [log.path if isinstance(log, Log) else Path(log) for log in each]
    kept = Folder()
    folder = kept.path if out is None else Path(out)
    check_out(folder)
    fitted = None if model is None else Path(model)
    screen = Screen(Terminal(quiet=quiet))
    with unguarded_main():
        if subject is not None:
            _, files = diagnose_own(OwnRequest(str(subject), runs, seed, budget_s=budget), folder, screen)
        else:
            for run in runs:
                refuse_other_than_log(run)
            _, files = diagnose_runs(
                runs, fitted, folder, seed, BUDGET_S if budget is None else budget, screen
            )
    document, selected = (
        json.loads(files[name].read_text(encoding="utf-8")) for name in ("diagnosis", "effects")
    )
    return Diagnosis(document, files["report"], selected, kept)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"

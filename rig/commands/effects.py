"""`rattle effects`: what can be missing in the twin of a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from rig.commands.arguments import Json, ScenarioFile, print_json
from rig.session.progress import Screen

if TYPE_CHECKING:
    from sim_twin.effects.effect import Effect
    from sim_twin.twin import AnyTwin


def effects(scenario_file: ScenarioFile, machine: Json = False) -> None:
    from rig.files.scenario import load_scenario
    from rig.twin.scenario_twin import twin_of

    twin = twin_of(load_scenario(scenario_file))
    if machine:
        print_json([_as_json(effect, twin) for effect in twin.model.effects.values()])
        return
    Screen(Console()).console.print(_table(twin))


def _as_json(effect: Effect, twin: AnyTwin) -> dict[str, object]:
    return {
        "name": effect.name,
        "location": effect.location,
        "parameters": {name: values.allowed for name, values in effect.asked.items()},
        "refused": effect.refusal(twin) or None,
    }


def _table(twin: AnyTwin) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in ("effect", "where", "parameter", "may be"):
        table.add_column(column, no_wrap=column != "may be", overflow="fold")
    for effect in twin.model.effects.values():
        reason = effect.refusal(twin)
        rows = {"": f"not here: {reason}"} if reason else _allowed(effect)
        names = [(effect.name, effect.location)] + [("", "")] * len(rows)
        for (name, where), (parameter, values) in zip(names, rows.items(), strict=False):
            table.add_row(name, where, parameter, values)
    return table


def _allowed(effect: Effect) -> dict[str, str]:
    """Of each parameter what it may be, words one below the other."""
    return {name: "\n".join(each.words) or each.allowed for name, each in effect.asked.items()}

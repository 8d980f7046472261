"""`rattle effects`: what can be missing in the twin of a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from rig.commands.arguments import Json, ScenarioFile, print_json
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.files.effects_file import Catalogue, ParameterRange
    from sim_twin.effects.effect import Effect
    from sim_twin.twin import AnyTwin


def effects(scenario_file: ScenarioFile, machine: Json = False) -> None:
    from rig.files.scenario import load_scenario
    from rig.twin.scenario_twin import catalogue_of, twin_of
    from sim_twin.rigs.catalogue import model_of

    twin = twin_of(load_scenario(scenario_file))
    model = model_of(twin)
    allowed = catalogue_of(model)
    if machine:
        print_json([_as_json(effect, twin, allowed) for effect in model.effects.values()])
        return
    Screen(Console()).console.print(_table(twin, allowed))


def _as_json(effect: Effect, twin: AnyTwin, allowed: Catalogue) -> dict[str, object]:
    return {
        "name": effect.name,
        "location": effect.location,
        "parameters": {name: values.allowed for name, values in allowed[effect.name].items()},
        "refused": effect.refusal(twin) or None,
    }


def _table(twin: AnyTwin, allowed: Catalogue) -> Table:
    from sim_twin.rigs.catalogue import model_of

    table = Table(box=None, pad_edge=False)
    for column in ("effect", "where", "parameter", "may be"):
        table.add_column(column, no_wrap=column != "may be", overflow="fold")
    for effect in model_of(twin).effects.values():
        reason = effect.refusal(twin)
        rows = {"": f"not here: {reason}"} if reason else _allowed(allowed[effect.name])
        names = [(effect.name, effect.location)] + [("", "")] * len(rows)
        for (name, where), (parameter, values) in zip(names, rows.items(), strict=False):
            table.add_row(name, where, parameter, values)
    return table


def _allowed(ranges: Mapping[str, ParameterRange]) -> dict[str, str]:
    """Of each parameter what it may be, words one below the other."""
    return {name: "\n".join(values.words) or values.allowed for name, values in ranges.items()}

"""`rattle predict`: the twin alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from rig.commands.arguments import EffectsFile, Json, Model, ScenarioFile, print_json
from rig.session.progress import Screen


def predict(
    scenario_file: ScenarioFile,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.mcap", help="The log to write.")],
    effects: EffectsFile = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="A healthy rig with noise instead of the nominal.")
    ] = None,
    model: Model = None,
    as_json: Json = False,
) -> None:
    from rig.files.model_file import load_model
    from rig.files.scenario import load_scenario
    from rig.twin.matched_twin import with_model
    from rig.twin.prediction_file import write_prediction
    from rig.twin.scenario_twin import twin_of, with_effects

    scenario = load_scenario(scenario_file)
    screen, wanted = Screen(Console(stderr=as_json)), scenario.acquisition
    twin = twin_of(scenario)
    fitted = None if model is None else load_model(model, scenario.rig)
    if fitted is not None:
        twin = with_model(twin, fitted, screen.warn)
    if effects is not None:
        twin = with_effects(twin, effects)
    with screen.busy("simulating"):
        drawn = write_prediction(scenario, twin, seed, out, effects, fitted)
        values = drawn.model.solver_values(drawn, wanted.settle, wanted.duration) if as_json else None
    if values is not None:
        print_json(values)
    screen.say(f"log        {out}")

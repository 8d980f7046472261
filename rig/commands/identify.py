"""`rattle identify`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from rig.commands.arguments import RunFiles, is_log
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from rig.diagnosis.identify import Identification


def identify(
    runs: RunFiles,
    free: Annotated[
        list[str],
        typer.Option(
            "--free",
            metavar="KEYS",
            help="Keys of the scenario's model to be found, with commas; KEY=LOW..HIGH where it may lie.",
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="MODEL.toml", help="The model to write.")],
    responses: Annotated[
        list[Path] | None,
        typer.Option(
            "--frf",
            metavar="RUN.mcap",
            help="A run looked at by its frequency responses alone, which need strike only now and then; "
            "several: --frf A.mcap --frf B.mcap.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same model.")] = 0,
    budget: Annotated[float, typer.Option("--budget", min=1, help="Seconds to simulate, at most.")] = 1200,
) -> None:
    from daq.disk import write_whole
    from rig.diagnosis import identify as work
    from rig.diagnosis.one_rig import Refused
    from rig.files.out_folder import require_new
    from rig.files.scenario import parse_scenario

    following = out.with_name(f"{out.stem}_next.toml")
    for path in (out, following):
        require_new(path, "identified")
    keys: dict[str, str] = {}
    for text in ",".join(free).split(","):
        key, _, between = (part.strip() for part in text.partition("="))
        if key in keys:
            raise typer.BadParameter(f"--free {key} comes twice; name it once")
        if key:
            keys[key] = between
    others = [is_log(path) for path in responses or []]
    screen = Screen(Terminal())
    data, wides, campaign = work.read_for(runs, others, keys, screen)
    folder = out.with_name(f".{out.name}.rigs")
    try:
        found = work.identify(data, wides, campaign, folder, seed, budget, screen)
    except KeyboardInterrupt:
        screen.say(f"what was simulated is kept in {folder}; the same command goes on there")
        raise
    except Refused:
        work.discard(folder)
        raise
    names = [path.name for path in data.paths]
    scenarios = list(dict.fromkeys(parse_scenario(text).name for text in data.scenarios))
    text = work.model_text_of(found, campaign.rig, names, scenarios, data.specimen)
    _show(found, campaign.rig, screen)
    write_whole(out, text.encode())
    if found.next_run is not None:
        write_whole(following, found.next_run.encode())
        screen.say(f"next run   {following}, which would tell most of what is not told")
    work.discard(folder)
    screen.say(f"model      {out}")


def _show(found: Identification, rig: str, screen: Screen) -> None:
    from rig.diagnosis.identify import AT_END, STILL_MOVED, TOGETHER, rows
    from rig.pages.words import listed

    table = Table(box=None, pad_edge=False)
    for heading in ("key", "found", "95 % interval", "was", ""):
        table.add_column(heading, no_wrap=True)
    for row in rows(found, rig):
        table.add_row(*row)
    screen.console.print(table)
    if any(found.known.open()):
        screen.warn("not told: known hardly better than before these runs; it only goes with the others")
    for several in found.known.together():
        screen.warn(TOGETHER.format(listed(several)))
    for name in found.known.at_ends():
        screen.warn(AT_END.format(name))
    if not found.converged:
        screen.warn(f"{STILL_MOVED}: their intervals are wider by that; add runs, or free fewer")
    screen.say(f"gap        {found.gap:.2f} with these values in the twin   (1 = as far as a healthy rig)")
    if len(found.gaps) > 1:
        for name, gap in found.gaps:
            screen.say(f"           {gap:.2f} of {name} by itself")

"""`harness study gains`: what the choice of a triangulator gains, over several runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from harness.commands.options import Several, several
from harness.errors import NothingMeasured

if TYPE_CHECKING:
    import pandas as pd

BASES = ("ear-clipping", "delaunay", "optimal:half-perimeter", "optimal:calibrated")
"""Default bases of the ratios: what programs use today, and the best that the harness knows."""

MOST_SAID = 12
"""How many views in which another was faster are named; gains.csv has them all."""


def gains(
    runs: Annotated[list[Path], typer.Argument(help="Run folders.")],
    out: Annotated[Path, typer.Option(help="Folder for gains.csv and plots.")],
    bases: Annotated[
        Several,
        typer.Option(parser=several(), metavar="NAME,...", help="Triangulators to compare with."),
    ] = Several(BASES),
) -> None:
    """Compare each triangulator's time with the bases', in all views; say which one was faster."""
    import pandas as pd

    from harness.figures import groups
    from harness.stored import atomic
    from harness.stored.folder import read_run
    from harness.study import gains as study
    from harness.triangulating.recipes import parse_all

    wanted = [str(recipe) for recipe in parse_all(bases)]
    read = [read_run(path) for path in runs]
    table = study.gain_table([run.records for run in groups.by_processor(read)], wanted)
    if table.empty:
        raise NothingMeasured("no two triangulators were timed together on the same polygons")
    orders = [p for n in wanted if len(p := study.by_order(table, n).assign(base=n))]
    with atomic.folder(out, added=True) as made:
        files = study.plot(table, made / "plots")
        table.to_csv(made / "gains.csv", index=False, float_format="%.5g")
        if orders:
            pd.concat(orders).to_csv(made / "orders.csv", index=False, float_format="%.4g")
    if mixed := groups.several_processors(read):
        typer.echo(f"several processors, whose times stay apart: {groups.processor_words(mixed)}")
    if orders:
        _say_orders(orders[0])
    for name in wanted:
        _say_how_it_did(study.best(table, name), name)
    typer.echo(f"{len(table)} ratios in {out}/gains.csv, {len(files)} plots")


def _say_how_it_did(views: pd.DataFrame, name: str) -> None:
    """Say in how many views another triangulator was shown to be faster than `name`."""
    if views.empty:
        return
    beaten = views[views["faster"] != ""]
    several = len(views[["rasteriser", "device"]].drop_duplicates()) > 1
    kept = len(views) - len(beaten)
    typer.echo(f"{name}: no other was shown to be faster in {kept} of {len(views)} views")
    for row in beaten.head(MOST_SAID).to_dict("records"):
        view = f"{row['scene']} {row['resolution']} px"
        view += f", {row['rasteriser']} on {row['device']}" if several else ""
        usual_of = (("rotation", "turned", 0), ("work", "work", 0), ("samples", "samples", 1))
        for key, word, usual in usual_of:
            if row[key] != usual:
                view += f", {word} {row[key]:g}"
        view += f", {row['order']} order" if row["order"] != "native" else ""
        typer.echo(f"  {view}: {row['faster']} faster")
    if len(beaten) > MOST_SAID:
        typer.echo(f"  and {len(beaten) - MOST_SAID} more views")


def _say_orders(found: pd.DataFrame) -> None:
    """Print the times in ratio to the first base's, in own orders and both in a common one."""
    from harness.rasterisers.base import ORDERS
    from harness.style import plain_table

    orders = [name for name in found.columns if name in ORDERS]
    for (scene, _, device, resolution), part in found.groupby(
        ["scene", "rasteriser", "device", "resolution"], sort=False
    ):
        base = part["base"].iloc[0]
        title = f"{scene} {resolution} px, {device}: time vs {base}"
        headings = (">own order", *(f">both in {name}" for name in orders))
        table = plain_table(title, "triangulator", *headings)
        for row in part.to_dict("records"):
            shown = (row[name] for name in ("own", *orders))
            cells = ["" if value != value else f"{value:.3f}" for value in shown]
            table.add_row(row["triangulator"], *cells)
        Console().print(table)

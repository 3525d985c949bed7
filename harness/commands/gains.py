"""`harness gains`: what the choice of a triangulator gains, over several runs."""

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

    from harness.figures import processors
    from harness.stored.folder import read_run
    from harness.study import gains as study
    from harness.triangulating.recipes import parse_all

    wanted = [str(recipe) for recipe in parse_all(bases)]
    read = [read_run(path) for path in runs]
    table = study.gain_table([run.records for run in processors.apart(read)], wanted)
    if table.empty:
        raise NothingMeasured("no two triangulators were timed together on the same polygons")
    out.mkdir(parents=True, exist_ok=True)
    files = study.plot(table, out / "plots")
    table.to_csv(out / "gains.csv", index=False, float_format="%.5g")
    console = Console()
    if mixed := processors.several(read):
        console.print(
            f"several processors, whose times stay apart: {processors.words(mixed)}",
            markup=False,
            soft_wrap=True,
        )
    told_apart = [study.by_order(table, name).assign(base=name) for name in wanted]
    if found := [part for part in told_apart if len(part)]:
        pd.concat(found).to_csv(out / "orders.csv", index=False, float_format="%.4g")
        _say_orders(found[0], console)
    for name in wanted:
        _say_how_it_did(study.best(table, name), name, console)
    console.print(
        f"{len(table)} ratios in {out}/gains.csv, {len(files)} plots", markup=False, soft_wrap=True
    )


def _say_how_it_did(views: pd.DataFrame, name: str, console: Console) -> None:
    """Say in how many views another triangulator was shown to be faster than `name`."""
    if views.empty:
        return
    beaten = views[views["faster"] != ""]
    several = len(views[["rasteriser", "device"]].drop_duplicates()) > 1
    console.print(
        f"{name}: no other was shown to be faster in {len(views) - len(beaten)} of "
        f"{len(views)} views",
        markup=False,
        soft_wrap=True,
    )
    for row in beaten.head(MOST_SAID).to_dict("records"):
        view = f"{row['scene']} {row['resolution']} px"
        view += f", {row['rasteriser']} on {row['device']}" if several else ""
        for key, word, usual in (
            ("rotation", "turned", 0),
            ("work", "work", 0),
            ("samples", "samples", 1),
        ):
            if row[key] != usual:
                view += f", {word} {row[key]:g}"
        view += f", {row['order']} order" if row["order"] != "native" else ""
        console.print(f"  {view}: {row['faster']} faster", markup=False, soft_wrap=True)
    if len(beaten) > MOST_SAID:
        console.print(f"  and {len(beaten) - MOST_SAID} more views", markup=False)


def _say_orders(found: pd.DataFrame, console: Console) -> None:
    """Print the times in ratio to the first base's, in own orders and both in a common one."""
    from harness.pictures.style import plain_table
    from harness.rasterisers.submission_order import ORDERS

    orders = [name for name in found.columns if name in ORDERS]
    for (scene, _, device, resolution), part in found.groupby(
        ["scene", "rasteriser", "device", "resolution"], sort=False
    ):
        base = part["base"].iloc[0]
        table = plain_table(f"{scene} {resolution} px, {device}: time vs {base}")
        table.add_column("triangulator")
        for heading in ("own order", *(f"both in {name}" for name in orders)):
            table.add_column(heading, justify="right")
        for row in part.to_dict("records"):
            shown = [row["own"], *(row[name] for name in orders)]
            cells = ["" if value != value else f"{value:.3f}" for value in shown]
            table.add_row(row["triangulator"], *cells)
        console.print(table)

"""Options that several commands have, with one meaning and one help."""

from __future__ import annotations

from typing import Annotated

import typer

Force = Annotated[
    bool, typer.Option("--force", help="Resume even if the plan, scene, code or machine differs.")
]
Seed = Annotated[int, typer.Option(help="Seed for everything random.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
PolygonNumber = Annotated[int, typer.Option(min=0, help="Number of the polygon in the scene.")]
Work = Annotated[str, typer.Option(help="Iterations of arithmetic per fragment; comma-separated.")]

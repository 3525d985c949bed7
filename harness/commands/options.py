"""Options that several commands have, with one meaning and one help."""

from __future__ import annotations

from typing import Annotated

import typer

Force = Annotated[
    bool, typer.Option("--force", help="Resume even if plan, scene, code or machine differ.")
]
Seed = Annotated[int, typer.Option(help="Seed of all that is random.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")]
PolygonNumber = Annotated[int, typer.Option(min=0, help="Number of the polygon in the scene.")]
Work = Annotated[str, typer.Option(help="Iterations of arithmetic a fragment; comma-separated.")]

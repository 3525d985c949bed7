"""Options that several commands have, with one meaning and one help, and how they are read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.errors import UsageError

CALIBRATIONS = Path("results") / "calibration"
"""Where `calibrate` writes, and optimal:calibrated looks, unless told otherwise."""

Force = Annotated[
    bool, typer.Option("--force", help="Resume even if the plan, scene, code or machine differs.")
]
Seed = Annotated[int, typer.Option(help="Seed for everything random.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Every case as it ends, and what went wrong where.")
]
Base = Annotated[
    str,
    typer.Option(
        help="Triangulator that the others are compared with; by default ear-clipping if it was "
        "measured, else the first."
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Write JSON to standard output, for other programs.")
]
PolygonNumber = Annotated[int, typer.Option(min=0, help="Number of the polygon in the scene.")]
Rasterisers = Annotated[
    str,
    typer.Option(
        help="Comma-separated; by default OpenGL's, or webgpu where EGL is missing. "
        "See: harness list rasterisers.",
    ),
]
Work = Annotated[str, typer.Option(help="Iterations of arithmetic per fragment; comma-separated.")]


def split_names(text: str) -> tuple[str, ...]:
    """Split a comma-separated option."""
    return tuple(part for part in (piece.strip() for piece in text.split(",")) if part)


def named_rasterisers(text: str, *beside: str) -> tuple[str, ...]:
    """Read --rasterisers; where it is empty, choose what works here.

    beside : of OpenGL, too, those that are drawn on besides opengl
    """
    if names := split_names(text):
        return names
    from harness.rasterisers import usual

    first = usual()
    return (first, *beside) if first == "opengl" else (first,)


def numbers(text: str, option: str, kind: type[int] | type[float]) -> list[float]:
    """Read a comma-separated option of numbers; raises UsageError naming `option`."""
    try:
        return [kind(part) for part in split_names(text)]
    except ValueError:
        raise UsageError(f"{option} {text}: give numbers, separated by commas") from None

"""Which models gain from other diagonals? (docs/studies/models.md)

    PYTHONPATH=. python scripts/studies/models.py [--out FILE] [--each 40]

Writes a row for each kind of model and size on the screen: models, the median share of the area in
flat faces of two triangles or more, and the quartiles of what helper lanes and shaded quads become,
after over before, in views from 24 sides.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from shapely import Polygon

from harness.models.in_place import retriangulate
from scenes import load

SIZES = (64, 256, 1024)
THICK = {"cad": 0.1, "glyphs": 0.2, "helsinki": 0.5}
"""Thickness of what is extruded, of the larger side."""

COLUMNS = (
    *("kind", "pixels", "models", "changed", "flat_share"),
    *(f"{what}_{of}" for what in ("lanes", "quads") for of in ("low", "median", "high")),
)


def extruded(scene: str, count: int) -> Iterator[trimesh.Trimesh]:
    """Yield the first polygons of a scene as models."""
    polygons = [each for each in load(scene).polygons if isinstance(each, Polygon)]
    for polygon in polygons[:count]:
        left, low, right, high = polygon.bounds
        height = THICK[scene] * max(right - left, high - low)
        yield trimesh.creation.extrude_polygon(polygon, height, engine="earcut")


def smooth(name: str) -> trimesh.Trimesh:
    """Return a shape that is round, or rough."""
    if name == "terrain":
        grid = np.stack(np.meshgrid(np.arange(64.0), np.arange(64.0)), axis=-1).reshape(-1, 2)
        heights = np.random.default_rng(0).normal(size=len(grid))
        corner = np.array([n for n in range(64 * 63) if n % 64 < 63])
        one = np.stack([corner, corner + 1, corner + 65], axis=1)
        other = np.stack([corner, corner + 65, corner + 64], axis=1)
        return trimesh.Trimesh(np.column_stack([grid, heights]), np.vstack([one, other]))
    return {
        "icosphere": lambda: trimesh.creation.icosphere(4),
        "uv sphere": trimesh.creation.uv_sphere,
        "torus": lambda: trimesh.creation.torus(3.0, 1.0),
    }[name]()


def row(kind: str, models: list[trimesh.Trimesh], folder: Path) -> list[dict[str, object]]:
    """Measure models of a kind; a row for each size."""
    ratios: dict[tuple[str, int], list[float]] = {}
    flat, changed = [], 0
    for model in models:
        file = folder / "model.glb"
        model.export(file)
        done = retriangulate(file, None, sizes=SIZES)
        flat.append(done.flat_area / done.area)
        changed += bool(done.changed)
        seen = {each.pixels: each for each in done.seen}
        for pixels in SIZES:
            found = seen.get(pixels)
            pair = (
                (found.lanes_after / found.lanes_before, found.quads_after / found.quads_before)
                if found
                else (1.0, 1.0)
            )
            ratios.setdefault(("lanes", pixels), []).append(pair[0])
            ratios.setdefault(("quads", pixels), []).append(pair[1])
    return [
        {
            "kind": kind,
            "pixels": pixels,
            "models": len(models),
            "changed": changed,
            "flat_share": f"{np.median(flat):.3f}",
            **{
                f"{what}_{of}": f"{np.quantile(ratios[what, pixels], at):.4f}"
                for what in ("lanes", "quads")
                for of, at in (("low", 0.25), ("median", 0.5), ("high", 0.75))
            },
        }
        for pixels in SIZES
    ]


def write_table(
    out: Path | None, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]
) -> None:
    """Write rows as CSV to a file, or to the terminal."""
    with out.open("w", newline="") if out else sys.stdout as file:
        table = csv.DictWriter(file, columns, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def main() -> None:
    """Measure all kinds and write the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path)
    options.add_argument("--each", type=int, default=40)
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as place:
        rows = []
        for kind in THICK:
            rows += row(kind, list(extruded(kind, chosen.each)), Path(place))
        for kind in ("icosphere", "uv sphere", "torus", "terrain"):
            rows += row(kind, [smooth(kind)], Path(place))
    write_table(chosen.out, COLUMNS, rows)


if __name__ == "__main__":
    main()

"""What other diagonals save behind a depth test. (docs/studies/models.md)

    PYTHONPATH=. python scripts/studies/models_hidden.py [--out FILE] [--each 20] [--houses 100]

Writes a row for each kind of model, depth test and size: models, the quartiles over them of what
helper lanes and shaded quads become, after over before, in views from 24 sides, and the largest
share of depth tests that are ties.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from harness.frame import frame_of, view_of
from harness.models.in_place import retriangulate
from harness.models.seen import DEPTHS, read
from harness.rasterisers import Options
from harness.rasterisers.reference import Reference
from harness.triangulating.seen import original
from scenes import load
from scripts.studies.models import THICK, extruded, write_table

SIZES = (256, 1024)
COLUMNS = (
    *("kind", "depth", "pixels", "models"),
    *(f"{what}_{of}" for what in ("lanes", "quads") for of in ("low", "median", "high")),
    "ties",
)
Counts = dict[str, int]


def block(houses: int) -> Iterator[trimesh.Trimesh]:
    """Yield the first footprints of Helsinki as one model, each where it stands."""
    parts = []
    for polygon in load("helsinki").polygons[:houses]:
        left, low, right, high = polygon.bounds
        height = THICK["helsinki"] * max(right - left, high - low)
        parts.append(trimesh.creation.extrude_polygon(polygon, height, engine="earcut"))
    yield trimesh.util.concatenate(parts)


def counted(path: Path, pixels: int, depth: str) -> Counts:
    """Return sums over all views of a model's own triangles."""
    scene = read(str(path), pixels=pixels, depth=depth)
    frame = frame_of(scene, view_of(scene))
    found = Reference().count(frame, frame.join(original(frame).parts), Options())
    return {name: int(values.sum()) for name, values in found.items()}


def main() -> None:
    """Measure all kinds and write the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path)
    options.add_argument("--each", type=int, default=20)
    options.add_argument("--houses", type=int, default=100)
    chosen = options.parse_args()
    kinds = {"cad": lambda: extruded("cad", chosen.each), "block": lambda: block(chosen.houses)}
    rows = []
    with tempfile.TemporaryDirectory() as place:
        before, after = Path(place) / "before.glb", Path(place) / "after.glb"
        for kind, models in kinds.items():
            found: dict[tuple[str, int], list[tuple[Counts, Counts]]] = {}
            for model in models():
                model.export(before)
                retriangulate(before, after)
                for depth in DEPTHS:
                    for pixels in SIZES:
                        both = counted(before, pixels, depth), counted(after, pixels, depth)
                        found.setdefault((depth, pixels), []).append(both)
            for (depth, pixels), pairs in found.items():
                ties = max(
                    each.get("depth_ties", 0) / each["fragments"] for pair in pairs for each in pair
                )
                ratios = [
                    [new[name] / old[name] for old, new in pairs]
                    for name in ("helper_lanes", "quads")
                ]
                quantiles = [
                    f"{np.quantile(each, at):.4f}" for each in ratios for at in (0.25, 0.5, 0.75)
                ]
                values = (kind, depth, pixels, len(pairs), *quantiles, f"{ties:.6f}")
                rows.append(dict(zip(COLUMNS, values, strict=True)))
    write_table(chosen.out, COLUMNS, rows)


if __name__ == "__main__":
    main()

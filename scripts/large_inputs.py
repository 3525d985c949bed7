"""Times the reading of inputs that are large in one way.

    PYTHONPATH=. .venv/bin/python scripts/large_inputs.py --out FILE

Each was once quadratic: 100,000 holes, 4,000 edges that cross each other at random, an SVG path of
400,000 vertices, a ring of a million. Times are of the processor, of reading with `scenes.load`,
which checks and repairs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import shapely

import scenes


def hundred_thousand_holes(folder: Path) -> Path:
    """Write a square with a square hole in each cell of a grid."""
    side = 317
    x, y = (axis.ravel()[:100_000] * 10.0 for axis in np.mgrid[:side, :side])
    holes = shapely.box(x + 2, y + 2, x + 8, y + 8)
    rings = shapely.get_exterior_ring(holes)
    shell = shapely.get_exterior_ring(shapely.box(0, 0, side * 10.0, side * 10.0))
    return _wkb(folder / "holes.wkb", shapely.Polygon(shell, list(rings)))


def four_thousand_crossings(folder: Path) -> Path:
    """Write a ring through 4,000 points at random: its edges cross millions of times."""
    points = np.random.default_rng(0).uniform(0, 1000, (4_000, 2))
    return _wkb(folder / "crossings.wkb", shapely.Polygon(points))


def svg_path(folder: Path) -> Path:
    """Write a path of 400,000 vertices, a wavy circle."""
    points = _wavy(400_000)
    text = "L".join(f"{x:.4f},{y:.4f}" for x, y in points)
    file = folder / "path.svg"
    file.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-2 -2 4 4"><path d="M{text}Z"/></svg>'
    )
    return file


def ring_of_a_million(folder: Path) -> Path:
    """Write a valid ring of a million vertices, a wavy circle."""
    return _wkb(folder / "ring.wkb", shapely.Polygon(_wavy(1_000_000)))


def _wavy(count: int) -> np.ndarray:
    angle = np.arange(count) * (2 * np.pi / count)
    radius = 1000.0 * (1 + 0.1 * np.sin(40 * angle))
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))


def _wkb(file: Path, polygon: shapely.Polygon) -> Path:
    file.write_bytes(shapely.to_wkb(polygon))
    return file


INPUTS: dict[str, Callable[[Path], Path]] = {
    "100,000 holes": hundred_thousand_holes,
    "4,000 random points, crossing": four_thousand_crossings,
    "SVG path of 400,000 vertices": svg_path,
    "ring of 1,000,000 vertices": ring_of_a_million,
}


def rows() -> Iterator[str]:
    """Yield a row of the table for each input."""
    with tempfile.TemporaryDirectory() as folder:
        for name, make in INPUTS.items():
            file = make(Path(folder))
            start = time.process_time()
            try:
                read = f"{len(scenes.load(str(file)).polygons):,}"
            except scenes.SceneError as error:
                read = str(error).removeprefix(f"{file} ")[:60]
            yield f"| {name} | {read} | {time.process_time() - start:.1f} s |"


def main() -> None:
    """Read the command line, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    lines = ["| input | polygons read | processor time |", "|---|---|---:|"]
    print("\n".join(lines))
    for row in rows():
        lines.append(row)
        print(row, flush=True)
    if chosen.out:
        chosen.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()

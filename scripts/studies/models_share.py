"""How much of a model has to be flat, for other diagonals to pay? (docs/studies/models.md)

    PYTHONPATH=. python scripts/studies/models_share.py [--out FILE] [--each 20]

Writes the columns of `scripts/studies/models.py` for sheet metal parts in the middle of a sphere, a
row for each share of the area that is flat, which is the kind, and each size on the screen.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from scripts.studies.models import COLUMNS, extruded, row, write_table

SHARES = (1.0, 0.5, 0.2, 0.1, 0.05, 0.01)


def in_sphere(part: trimesh.Trimesh, share: float) -> trimesh.Trimesh:
    """Return a part with a sphere round its middle, so large that the part has a share of the area.

    The sphere's triangles, 20,480, are flat in no two.
    """
    if share == 1.0:
        return part
    sphere = trimesh.creation.icosphere(5)
    sphere.apply_scale(np.sqrt(part.area * (1.0 / share - 1.0) / sphere.area))
    sphere.apply_translation(part.bounds.mean(axis=0))
    return trimesh.util.concatenate([part, sphere])


def main() -> None:
    """Measure all shares and write the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path)
    options.add_argument("--each", type=int, default=20)
    chosen = options.parse_args()
    parts = list(extruded("cad", chosen.each))
    with tempfile.TemporaryDirectory() as place:
        rows = [
            each
            for share in SHARES
            for each in row(f"{share:g}", [in_sphere(part, share) for part in parts], Path(place))
        ]
    write_table(chosen.out, COLUMNS, rows)


if __name__ == "__main__":
    main()

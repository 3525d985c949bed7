"""What E says of many views, and where foreshortening breaks it. (docs/theory.md)

    PYTHONPATH=. python scripts/studies/model_views.py [--out FILE] [--each 20]

Writes a row for each size on the screen: helper lanes that other diagonals save in a view, as they
are counted, and in ratio to it what is expected of lengths in space (E), of half-perimeters of
projected triangles (H) and of their expected quads (Q). Sums over sheet metal parts in 24 views.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from harness.frame import Frame, frame_of, view_of
from harness.models.in_place import opened, retriangulate
from harness.models.seen import read
from harness.models.views import DISTANCE, VIEWS, ball_of
from harness.rasterisers.reference import predict
from harness.triangulating.seen import original
from scripts.studies.models import extruded, write_table

SIZES = (16, 64, 256, 1024)
COLUMNS = ("pixels", "models", "saved", "by_e", "by_h", "by_q")


def seen(path: Path, pixels: int) -> np.ndarray:
    """Return helper lanes that are counted, and expected by H and by Q, of all views together."""
    scene = read(str(path), pixels=pixels)
    frame: Frame = frame_of(scene, view_of(scene))
    found = original(frame)
    lanes = predict(frame.points, frame.join(found.parts))["helper_lanes"].sum()
    totals = found.predicted.totals
    lanes_by_q = 4 * totals["expected_quads"] - totals["area"]
    return np.array([lanes, totals["half_perimeter"], lanes_by_q])


def scale(path: Path, pixels: int) -> float:
    """Return px on the screen of a unit in the middle of a model, across the line of sight."""
    parts = [part for group in opened(path)[1] for part in group]
    ball = ball_of([part.mesh.positions[part.mesh.triangles].reshape(-1, 3) for part in parts])
    assert ball is not None
    return pixels * np.sqrt(DISTANCE**2 - 1) / (2 * ball.radius * DISTANCE)


def main() -> None:
    """Measure all sizes and write the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path)
    options.add_argument("--each", type=int, default=20)
    chosen = options.parse_args()
    sums = {pixels: np.zeros(4) for pixels in SIZES}
    with tempfile.TemporaryDirectory() as place:
        before, after = Path(place) / "before.glb", Path(place) / "after.glb"
        for model in extruded("cad", chosen.each):
            model.export(before)
            done = retriangulate(before, after)
            for pixels in SIZES:
                lanes, by_h, by_q = seen(before, pixels) - seen(after, pixels)
                # half of 2 sides, half of the turns: each face is seen in half of the views
                by_e = VIEWS * scale(before, pixels) * (done.before - done.after) / 4
                sums[pixels] += lanes, by_e, by_h, by_q
    rows = []
    for pixels, (lanes, *expected) in sums.items():
        ratios = [f"{each / lanes:.4f}" for each in expected]
        saved = f"{lanes / VIEWS / chosen.each:.1f}"
        rows.append(dict(zip(COLUMNS, (pixels, chosen.each, saved, *ratios), strict=True)))
    write_table(chosen.out, COLUMNS, rows)


if __name__ == "__main__":
    main()

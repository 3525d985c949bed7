"""Polygons with their triangles before and after flips, for the tests that lie beside each port.

    PYTHONPATH=. python -m tests.ports.vectors

writes ports/vectors.txt anew. Four lines a polygon: coordinates, triangles of ear clipping, and two
lines for each test: its name with the number of flips, and the triangles that come out.
"""

import numpy as np

from tests.paths import ROOT
from tests.ports.languages import Cases, in_python
from tests.ports.polygons import random_polygons
from triangulators.criteria import FLIP_TESTS

FILE = ROOT / "ports" / "vectors.txt"
SMALL = 30  # vertices of a polygon at most


def text() -> str:
    """Return the file's text: 40 random polygons, and triangles that lie on each other."""
    polygons = [each for each in random_polygons(3, 400) if 4 <= len(each[0]) <= SMALL][:40]
    cases = _with_heap(Cases.of(polygons))
    results = {by: in_python(cases, by) for by in FLIP_TESTS}
    lines = []
    for index in range(len(cases.bounds) - 1):
        points, corners = cases.polygon(index)
        begin, end = cases.bounds[index : index + 2, 1]
        lines += [" ".join(map(repr, points.ravel().tolist())), _row(corners)]
        for by, (after, counts) in results.items():
            lines += [f"{by} {counts[index]}", _row(after[begin:end])]
    return "\n".join(lines) + "\n"


def _with_heap(cases: Cases) -> Cases:
    """Add points of a square with the same triangles again and again, in both directions."""
    rng = np.random.default_rng(1)
    points = np.array([(0.0, 0.0), (4.0, 0.0), (5.0, 3.0), (0.0, 2.0)])
    corners = rng.integers(0, 4, 3 * 40).astype(np.int32)
    last = cases.bounds[-1] + (len(points), len(corners))
    return Cases(
        np.concatenate((cases.points, points)),
        np.concatenate((cases.corners, corners)),
        np.vstack((cases.bounds, last)).astype(np.int32),
    )


def _row(numbers: np.ndarray) -> str:
    return " ".join(map(str, numbers.tolist()))


if __name__ == "__main__":
    FILE.write_text(text())

"""Polygons with their triangles before and after flips, for the tests of the ports.

    PYTHONPATH=. python -m tests.ports.vectors

writes ports/vectors.txt again. Each polygon has a line of coordinates, a line with the triangles of
ear clipping, and two lines for each test: name and number of flips, and the resulting triangles in
a walk. "quads@3.7" has a scale of 3.7; the last test, "reorder", is a walk without flips.
"""

import numpy as np

from tests.paths import ROOT
from tests.ports.languages import SCALED, Cases, flip_in_python
from tests.ports.polygons import random_polygons
from triangulators.criteria import FLIP_TESTS

FILE = ROOT / "ports" / "vectors.txt"
MAX_VERTICES = 30


def render() -> str:
    """Return the text of the file: 40 random polygons, and overlapping triangles."""
    small = [rings for rings in random_polygons(3, 400) if 4 <= len(rings[0]) <= MAX_VERTICES]
    cases = _add_random_triangles(Cases.of(small[:40]))
    results = {by: flip_in_python(cases, by) for by in (*FLIP_TESTS, SCALED[-1], "reorder")}
    lines = []
    for index in range(len(cases.bounds) - 1):
        points, corners = cases.polygon(index)
        begin, end = cases.bounds[index : index + 2, 1]
        lines += [" ".join(map(repr, points.ravel().tolist())), _join(corners)]
        for by, (after, counts) in results.items():
            lines += [f"{by} {counts[index]}", _join(after[begin:end])]
    return "\n".join(lines) + "\n"


def _add_random_triangles(cases: Cases) -> Cases:
    """Add random, overlapping triangles of four points in both orientations."""
    rng = np.random.default_rng(1)
    points = np.array([(0.0, 0.0), (4.0, 0.0), (5.0, 3.0), (0.0, 2.0)])
    corners = rng.integers(0, 4, 3 * 40).astype(np.int32)
    last = cases.bounds[-1] + (len(points), len(corners))
    return Cases(
        np.concatenate((cases.points, points)),
        np.concatenate((cases.corners, corners)),
        np.vstack((cases.bounds, last)).astype(np.int32),
    )


def _join(numbers: np.ndarray) -> str:
    return " ".join(map(str, numbers.tolist()))


if __name__ == "__main__":
    FILE.write_text(render())

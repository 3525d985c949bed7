"""What L1 flips end in, by where they begin: ear clipping's triangles, or Delaunay's.

    PYTHONPATH=. python scripts/studies/flip_starts.py --scenes city,helsinki,glyphs,counties

Polygons are drawn alone at 512 px. Prints a line of CSV for each scene and start: polygons; the
triangles changed, per diagonal; before and after flips the share of diagonals whose flip would be
shorter but is blocked, as its quadrilateral is not strictly convex; the L1 length of the diagonals
before and after, in ratio to the optimum's (geometric means over polygons); and on how many
polygons this start ends shorter than the other.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from harness.frame import View, make_frame
from scenes import load
from triangulators import flip, triangulate_many, vertices
from triangulators.geometry.half_edges import link
from triangulators.geometry.predicates import turns

STARTS = ("ear-clipping", "delaunay")


def diagonals(
    points: NDArray[np.float64], triangles: NDArray[np.int32]
) -> tuple[float, float, int]:
    """Return the L1 length of the diagonals, the share that is blocked, and how many there are."""
    corner = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1)
    twin = link(corner)
    here = np.flatnonzero(twin > np.arange(len(twin)))  # each once
    there = twin[here]
    # The diagonal a-b, and c-d, which a flip puts in its place.
    a, b = corner[here], corner[here // 3 * 3 + (here + 1) % 3]
    c, d = (corner[edge // 3 * 3 + (edge + 2) % 3] for edge in (here, there))
    now = np.abs(points[a] - points[b]).sum(axis=1)
    shorter = np.abs(points[c] - points[d]).sum(axis=1) < now
    corners = (np.column_stack(each) for each in ((d, b, c), (c, a, d)))
    at_b, at_a = (turns(points, each) > 0.0 for each in corners)
    blocked = float((shorter & ~(at_b & at_a)).mean()) if len(here) else 0.0
    return float(now.sum()), blocked, len(here)


def main() -> None:
    """Flip and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default="city,helsinki,glyphs,counties")
    print("scene,start,polygons,changed,blocked_before,blocked_after,before,after,shorter")
    for scene in parser.parse_args().scenes.split(","):
        alone = [make_frame([each], View(512)).polygons for each in load(scene).polygons]
        polygons = [each[0] for each in alone if len(each)]
        points = [vertices(each) for each in polygons]
        best = triangulate_many(polygons, "optimal:half-perimeter")
        least = np.array([diagonals(p, t)[0] for p, t in zip(points, best, strict=True)])
        after = {}
        rows = {}
        for start in STARTS:
            begun = triangulate_many(polygons, start)
            ended = [flip(p, t, "l1") for p, t in zip(points, begun, strict=True)]
            first = [diagonals(p, t) for p, t in zip(points, begun, strict=True)]
            last = [diagonals(p, t) for p, t in zip(points, ended, strict=True)]
            moved = [
                len(t) - len(set(map(frozenset, t.tolist())) & set(map(frozenset, u.tolist())))
                for t, u in zip(begun, ended, strict=True)
            ]
            rows[start] = (first, last, moved)
            after[start] = np.array([length for length, _, _ in last])
        some = least > 0
        for start, other in (STARTS, STARTS[::-1]):
            first, last, moved = rows[start]
            count = sum(number for _, _, number in first)
            cells = [f"{sum(moved) / count:.3f}"]
            cells += [f"{sum(b * n for _, b, n in part) / count:.3f}" for part in (first, last)]
            for part in (first, last):
                ratios = np.array([length for length, _, _ in part])[some] / least[some]
                cells.append(f"{np.exp(np.log(ratios).mean()):.4f}")
            cells.append(str(int((after[start] < after[other]).sum())))
            print(f"{scene},{start},{len(polygons)},{','.join(cells)}", flush=True)


if __name__ == "__main__":
    main()

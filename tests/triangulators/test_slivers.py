"""Slivers by the definition of earcut's benchmark, as in the table of docs/flips.md."""

import mapbox_earcut
import numpy as np
import pytest

from harness.frame import View, make_frame
from scenes import load
from tests.paths import ROOT
from tests.ports.polygons import flatten_rings
from tests.triangulators.cases import read_rings
from triangulators import flip, triangulate_many, vertices
from triangulators.criteria import find
from triangulators.geometry.flips import flip_as_earcut
from triangulators.geometry.half_edges import link_half_edges

NAMES = (
    *("ear-clipping", "earcut-refine", "flips:delaunay", "flips:beauty"),
    *("flips:l1", "flips:euclidean", "optimal:half-perimeter"),
)


def measure(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return quality (1 if equilateral, 0 if degenerate) and perimeter of each triangle."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    squares = [((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))]
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    quality = 2.0 * np.sqrt(3.0) * np.abs(ux * vy - uy * vx) / np.maximum(sum(squares), 1e-300)
    return quality, sum(map(np.sqrt, squares))


def rows_of(title: str, many: dict[str, list[tuple[np.ndarray, np.ndarray]]]) -> list[str]:
    rows, usual = [], None
    for name, triangles in many.items():
        quality, lengths = (np.concatenate(part) for part in zip(*triangles, strict=True))
        usual = usual or lengths.sum()  # of ear clipping, the first
        figures = f"{(quality < 0.1).sum():,} | {quality.mean():.3f} | {lengths.sum() / usual:.3f}"
        rows.append(f"| {title} | `{name}` | {figures} |")
    return rows


def in_flips(lines: list[str]) -> None:
    text = " ".join((ROOT / "docs" / "flips.md").read_text(encoding="utf-8").split())
    missing = [line for line in lines if line not in text]
    assert not missing, "\n".join(lines)


@pytest.mark.parametrize("scene", ["city", "glyphs"])
def test_slivers_of_scenes(scene):
    polygons = make_frame(load(scene).polygons, View(1024)).polygons
    many = {}
    for name in NAMES:
        batch = triangulate_many(polygons, name)
        many[name] = [measure(vertices(p), t) for p, t in zip(polygons, batch, strict=True)]
    in_flips(rows_of({"glyphs": "letters"}.get(scene, scene), many))


def test_slivers_of_earcuts_fixtures():
    """Index arrays of earcut, also for invalid polygons."""
    many: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for _, rings in read_rings("earcut_fixtures.json"):
        points, ends = flatten_rings(rings)
        raw = mapbox_earcut.triangulate_float64(points, ends).astype(np.int32)
        refined = raw.copy()
        flip_as_earcut(points, refined, link_half_edges(refined))
        by_name = {"ear-clipping": raw.reshape(-1, 3), "earcut-refine": refined.reshape(-1, 3)}
        for name in NAMES[2:6]:
            by_name[name] = flip(points, raw, name.partition(":")[2])
        for name, triangles in by_name.items():
            if len(triangles):
                many.setdefault(name, []).append(measure(points, triangles))
    in_flips(rows_of("earcut's fixtures", many))


@pytest.mark.parametrize("scene", ["city", "glyphs"])
def test_flips_by_beauty_end_in_delaunay(scene):
    """Both have the same sum of beauty, the largest possible if ear clipping dropped no vertex."""
    polygons = make_frame(load(scene).polygons, View(1024)).polygons[:150]
    sums = {}
    for name in ("flips:beauty", "flips:delaunay", "optimal:beauty"):
        batch = triangulate_many(polygons, name)
        pairs = zip(polygons, batch, strict=True)
        sums[name] = np.array([find("beauty").total(vertices(p), t) for p, t in pairs])
    assert sums["flips:delaunay"] == pytest.approx(sums["flips:beauty"], rel=1e-9)
    assert (np.abs(sums["optimal:beauty"] / sums["flips:beauty"] - 1.0) < 1e-9).mean() > 0.95

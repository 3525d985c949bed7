"""Is A equal to B? The optimum by every way to ask for it, and flips in three languages."""

import os
from pathlib import Path

import numpy as np
import pytest
import shapely

from harness.frame import View, make_frame
from scenes import load
from tests.conftest import exit_code, write_geojson
from tests.paths import ROOT
from tests.ports import languages
from tests.ports.languages import Cases, in_python, read
from tests.ports.polygons import Rings, earcut_rings, is_as_before, random_polygons
from tests.triangulators.cases import convex, shared_rings, smooth, star, touching_polygons
from tests.triangulators.test_many import polygons as with_holes
from triangulators import triangulate, triangulate_many, vertices
from triangulators.criteria import FLIP_TESTS, find
from triangulators.dropin import triangulate_float64
from triangulators.optimum.full_table import by_full_table
from triangulators.verify import verify

CRITERIA = ("half-perimeter", "overdraw")
CLOSE = 1e-9  # relative: sums of the same triangles in another order differ by less
SCENES = (
    *("city", "helsinki", "counties", "counties:level=state", "glyphs", "cad", "paper"),
    *("stress", "meshes"),
)


def exported(polygons: list[shapely.Polygon], name: str, folder: Path) -> dict[int, np.ndarray]:
    """Return the triangles that the command line writes, by the number of their polygon."""
    source, target = write_geojson(folder / "in.geojson", polygons), folder / "out.npz"
    arguments = ("triangulate", str(source), "-o", str(target), "--triangulator", name, "--quiet")
    assert exit_code(*arguments) == 0
    with np.load(target) as arrays:
        corners, starts = arrays["vertex_starts"], arrays["triangle_starts"]
        found = {}
        for row, number in enumerate(arrays["attribute_id"].tolist()):
            own = arrays["triangles"][starts[row] : starts[row + 1]] - corners[row]
            found[number] = own.astype(np.int32)
    target.unlink()
    return found


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("kind", ["holes", "touching"])
def test_the_optimum_is_one_by_every_way(kind, seed, times, tell, tmp_path):
    count = max(40, times(2000 if kind == "holes" else 200))
    scale = (1.0, 0.1, 1 / 3)[seed % 3]
    made = with_holes(scale, count, seed) if kind == "holes" else touching_polygons(seed, count)
    # Files are read so, and vertices are numbered in that order.
    polygons = list(shapely.orient_polygons(np.array(list(made))))
    for criterion in CRITERIA:
        name, total = f"optimal:{criterion}", find(criterion).total
        many, files = triangulate_many(polygons, name), exported(polygons, name, tmp_path)
        assert not many.failed
        for number, polygon in enumerate(polygons):
            points, single = vertices(polygon), triangulate(polygon, name)
            ways = {"single": single, "batch": many[number], "file": files[number]}
            if criterion == "half-perimeter":
                flat = triangulate_float64(*earcut_rings(polygon), method="optimal:half-perimeter")
                ways["drop-in"] = flat.reshape(-1, 3).astype(np.int32)
            least = total(points, single)
            for way, triangles in ways.items():
                assert verify(polygon, triangles).conforming, (way, polygon.wkt)
                cost = total(points, triangles)
                assert abs(cost - least) <= CLOSE * abs(least), (way, polygon.wkt)
    tell({f"polygons, {kind}": len(polygons)})


@pytest.mark.parametrize("make", [star, smooth, convex])
@pytest.mark.parametrize("n", [500, 1000, 2000, 4000, 6000])
def test_large_rings_are_as_the_table_over_all_pairs(n, make):
    polygon = shapely.Polygon(np.round(vertices(make(n)) * 256) / 256)
    if not polygon.is_valid:
        return
    ring = np.ascontiguousarray(vertices(shapely.orient_polygons(polygon)))
    for criterion, weights in zip(CRITERIA, ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), strict=True):
        total = find(criterion).total
        table = np.empty((len(ring) - 2, 3), dtype=np.int32)
        by_full_table(ring, np.array(weights), table)
        whole = total(ring, table)
        triangles = triangulate(polygon, f"optimal:{criterion}", limit=10_000)
        assert abs(total(vertices(polygon), triangles) - whole) <= CLOSE * abs(whole)


def rings_of_scene(name: str) -> list[Rings]:
    """Return a scene's polygons: as they are, snapped to pixels, and in a tile's whole numbers."""
    polygons = load(name).polygons
    pixels = [earcut_rings(each) for each in make_frame(polygons, View(1024)).polygons]
    tile = [
        (np.rint((xy - xy.min(axis=0)) * (4096.0 / max(np.ptp(xy, axis=0).max(), 1.0))), ends)
        for xy, ends in pixels
    ]
    return [*map(earcut_rings, polygons), *pixels, *tile]


def rings_of_file(name: str) -> list[Rings]:
    """Return other people's polygons, valid or not."""
    if not (ROOT.parent / "shared" / "data" / name).exists():
        pytest.skip("these data are not here")
    found = (rings for _, rings in shared_rings(name))
    return [
        (np.concatenate([ring.reshape(-1, 2) for ring in rings]), np.cumsum([*map(len, rings)]))
        for rings in found
    ]


@pytest.mark.parametrize(
    "source", [*SCENES, "earcut_fixtures.json", "poly2tri_testbed.json", *range(10)]
)
def test_flips_are_equal_in_three_languages(source, times, tell, tmp_path):
    if not languages.compilers() or languages.node() is None or languages.earcut() is None:
        pytest.skip("needs Node.js, a C++ compiler and npm's earcut")
    if isinstance(source, int):
        polygons = list(random_polygons(source, times(10_000)))
    else:
        polygons = (rings_of_file if source.endswith(".json") else rings_of_scene)(source)
    cases = Cases.of(polygons)
    cases.write(tmp_path)
    languages.in_cpp(tmp_path, languages.compile_flips(tmp_path, languages.compilers()[0], "-O2"))
    languages.in_javascript(tmp_path)
    for by in (*FLIP_TESTS, "earcut-refine"):
        corners, flips = in_python(cases, by)
        assert is_as_before(cases, corners), by
        for language in ("javascript", "cpp") if by in FLIP_TESTS else ("javascript",):
            assert np.array_equal(corners, read(tmp_path, language, by)[0]), (language, by)
        tell({"polygons": len(polygons), "flips": int(flips.sum())})


def test_refine_is_that_of_earcut_hpp(times, tell, tmp_path):
    """Of mapbox_earcut 2.1.0, which brings it in its source package alone."""
    header = os.environ.get("EARCUT_HPP", "")
    if not (Path(header) / "mapbox" / "earcut.hpp").is_file() or not languages.compilers():
        pytest.skip(
            "needs a C++ compiler and earcut.hpp: run pip download --no-deps --no-binary :all: "
            "mapbox_earcut==2.1.0, unpack it, and set EARCUT_HPP to its folder include"
        )
    polygons = list(random_polygons(0, times(10_000)))
    for source in (*SCENES, "earcut_fixtures.json", "poly2tri_testbed.json"):
        polygons += (rings_of_file if source.endswith(".json") else rings_of_scene)(source)
    cases = Cases.of(polygons)
    cases.write(tmp_path)
    flags = ("-O2", "-isystem", header)
    languages.in_cpp(tmp_path, languages.compile_flips(tmp_path, languages.compilers()[0], *flags))
    theirs = np.fromfile(tmp_path / "cpp-earcut-refine.i32", dtype=np.int32)
    ours, flips = in_python(cases, "earcut-refine")
    assert np.array_equal(ours, theirs)
    # Ours by the circle has a narrower margin for ties.
    port = read(tmp_path, "cpp", "delaunay")[0]
    ends = zip(cases.bounds[:-1, 1], cases.bounds[1:, 1], strict=True)
    differ = sum(not np.array_equal(port[begin:end], theirs[begin:end]) for begin, end in ends)
    tell({"polygons": len(polygons), "flips": int(flips.sum()), "By::delaunay differs": differ})

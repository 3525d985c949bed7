"""Simulated designs against the CPU reference: every count, whatever is turned."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
import shapely
import shapely.affinity
from platformdirs import user_cache_path

from harness.frame import View, frame_of
from harness.rasterisers import Device, Options, get
from harness.rasterisers.simulated import building
from harness.rasterisers.simulated.attila import BINDING, Attila
from harness.rasterisers.simulated.skybox import Skybox
from harness.settings import StudySize
from harness.study.subjects import choose_polygons
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse, parse_all
from scenes import Scene, load
from scripts.studies import whole_gpu
from tests.paths import ROOT
from tests.simulated.conftest import KINDS, triangles_of
from tests.simulated.test_skybox import DRAWN, EXACT, assert_exact, with_parameters
from tests.triangulators.cases import shared

BESIDE = {Skybox: "skybox-rtl", Attila: "attila-sim"}
BUILDS = [
    f"skybox:output_quads={quads},tile={tile},block={block}"
    for quads, tile, block in product(
        *(Skybox.choices[name] for name in ("output_quads", "tile", "block"))
    )
]
SCENES = ("city", "helsinki", "glyphs", "cad", "paper", "stress", "meshes:limit=200")
FIXTURES = ("earcut_fixtures.json", "poly2tri_testbed.json")
SIZES = {64: 100, 256: 10, 1024: 1}
"""Side in pixels -> triangles of each kind in a draw of Skybox's."""

TOGETHER = {64: 100, 256: 50, 1024: 10}
"""Side in pixels -> triangles in a draw of ATTILA's: some thousand quads each."""


@pytest.fixture
def opened(monkeypatch):
    """Return what opens a design as the user has built it, not the suite: that takes minutes."""
    kept = user_cache_path("raster-harness", appauthor=False)
    monkeypatch.setattr(building, "cache_file", lambda name: kept / name)

    def open_design(name):
        design = Skybox if name.startswith("skybox") else Attila
        beside = ROOT.parent / "shared" / "data" / BESIDE[design]
        if beside.is_dir():
            monkeypatch.setenv(design.sources.variable, str(beside))
        if problem := design.sources.problem():
            pytest.skip(f"{name}: {problem}")
        return get("simulated")(Device(name, software=True))

    return open_design


def totals(counted):
    return {name: int(counted[name].sum()) for name in EXACT}


def cut(frame):
    """Return ear clipping's triangles of all polygons that it can cut."""
    return frame.join(triangulate_polygons(parse("ear-clipping"), frame.polygons, None).parts)


def scene_of(source):
    """Return a scene, or one of other people's polygons, each as large as the others."""
    if source not in FIXTURES:
        return load(source)
    whole = []
    for number, (_, polygon) in enumerate(shared(source)):
        if polygon.is_valid and not polygon.is_empty:
            left, bottom, right, top = polygon.bounds
            moved = shapely.affinity.translate(polygon, -left, -bottom)
            grown = 1.0 / max(right - left, top - bottom)
            sized = shapely.affinity.scale(moved, grown, grown, origin=(0, 0))
            whole.append(shapely.affinity.translate(sized, number % 10 * 1.1, number // 10 * 1.1))
    assert whole
    return Scene(source, whole, "units")


@pytest.mark.parametrize("build", BUILDS)
def test_counts_of_every_kind_of_triangle_are_the_references_in_skybox(opened, times, tell, build):
    number = 0
    for seed in range(times(20)):
        device = with_parameters(build, DRAWN[seed % len(DRAWN)])
        for size, each in SIZES.items():
            frame, triangles = triangles_of(size, each, seed)
            drawn = opened(device).count(frame, triangles, Options())
            assert_exact(drawn, frame, triangles, device)
            number += len(triangles)
    tell({"triangles": number})


@pytest.mark.parametrize("size", [64, 256, 1024])
@pytest.mark.parametrize("source", [*SCENES, *FIXTURES])
def test_counts_of_every_scene_are_the_references_in_skybox(opened, tell, source, size):
    frame = frame_of(scene_of(source), View(size))
    triangles = cut(frame)
    drawn = opened("skybox").count(frame, triangles, Options())
    expected = get("reference")().count(frame, triangles, Options())
    for name in EXACT:
        np.testing.assert_array_equal(drawn[name], expected[name], name)
    tell({"triangles": len(triangles)})


@pytest.mark.parametrize("size", TOGETHER)
@pytest.mark.parametrize("kind", KINDS)
def test_counts_of_every_kind_of_triangle_are_the_references_in_attila(
    opened, times, tell, kind, size
):
    number = 0
    for seed in range(times(-(-10_000 // (TOGETHER[size] * len(TOGETHER))))):
        frame, triangles = triangles_of(size, TOGETHER[size], seed, (kind,))
        bound = list(BINDING)[seed % len(BINDING)]
        counted = opened(f"attila:bound={bound}").count(frame, triangles, Options())
        expected = get("reference")().count(frame, triangles, Options())
        assert totals(counted) == totals(expected)
        number += len(triangles)
    tell({"triangles": number})


@pytest.mark.parametrize("source", [*SCENES, *FIXTURES])
def test_counts_of_every_scene_are_the_references_in_attila(opened, tell, source):
    frame = frame_of(scene_of(source), View(256))
    triangles = cut(frame)
    device = opened("attila")
    counted = device.count(frame, triangles, Options())
    expected = get("reference")().count(frame, triangles, Options())
    assert totals(counted) == totals(expected)
    again = device.count(frame, triangles, Options())
    assert {name: int(np.sum(value)) for name, value in counted.items()} == {
        name: int(np.sum(value)) for name, value in again.items()
    }
    tell({"triangles": len(triangles)})


def test_counts_of_the_study_of_attila_are_the_references(tell):
    """Without ATTILA: what the committed draws say they covered."""
    found = pd.read_csv(ROOT / "results" / "reference" / "attila" / "draws.csv")
    rows = found.set_index(["scene", "polygon", "triangulator"]).sort_index()
    for scene in whole_gpu.SCENES:
        for number, alone in choose_polygons(load(scene), StudySize(polygons=12)):
            frame = frame_of(alone, View(whole_gpu.PIXELS))
            for recipe in parse_all(whole_gpu.TRIANGULATORS):
                parts = triangulate_polygons(recipe, frame.polygons, None).parts
                triangles = frame.join(parts)
                counted = totals(get("reference")().count(frame, triangles, Options()))
                drawn = rows.loc[(scene, number, str(recipe))]
                assert (drawn["triangles"] == len(triangles)).all()
                assert (drawn[list(counted)] == list(counted.values())).all(axis=None)
                tell({"draws": len(drawn), "triangles": len(triangles) * len(drawn)})

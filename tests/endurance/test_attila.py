"""ATTILA against the CPU reference: every draw's counts, whatever its configuration."""

from __future__ import annotations

import pytest
from platformdirs import user_cache_path

from harness.frame import View, frame_of
from harness.rasterisers import Device, Options, get
from harness.rasterisers.simulated import building
from harness.rasterisers.simulated.attila import program
from harness.rasterisers.simulated.attila.attila import BINDING
from scenes import load
from tests.paths import ROOT
from tests.simulated.conftest import KINDS, triangles_of
from triangulators import triangulate

BESIDE = ROOT.parent / "shared" / "data" / "attila-sim"
EXACT = ("fragments", "quads", "helper_lanes", "partial_quads")
TOGETHER = {64: 100, 256: 50, 1024: 10}
"""Side in pixels -> triangles of a draw: some thousand quads each."""


@pytest.fixture
def drawn(monkeypatch):
    """Return what draws with a configuration of ATTILA and gives its counters as numbers."""
    kept = user_cache_path("raster-harness", appauthor=False)  # not the suite's: it takes minutes
    monkeypatch.setattr(building, "cache_file", lambda name: kept / name)
    if BESIDE.is_dir():
        monkeypatch.setenv(program.SOURCES.variable, str(BESIDE))
    if problem := program.problem():
        pytest.skip(f"attila: {problem}")

    def draw(bound, frame, triangles):
        device = Device(f"attila:bound={bound}", software=True)
        counted = get("simulated")(device).count(frame, triangles, Options())
        return {name: int(value) for name, value in counted.items()}

    return draw


def totals(frame, triangles):
    counted = get("reference")().count(frame, triangles, Options())
    return {name: int(counted[name].sum()) for name in EXACT}


@pytest.mark.parametrize("size", TOGETHER)
@pytest.mark.parametrize("kind", KINDS)
def test_counts_of_every_kind_of_triangle_are_the_references(drawn, times, tell, kind, size):
    number = 0
    for seed in range(times(-(-10_000 // (TOGETHER[size] * len(TOGETHER) * len(KINDS))))):
        frame, triangles = triangles_of(size, TOGETHER[size], seed, (kind,))
        counted = drawn(list(BINDING)[seed % len(BINDING)], frame, triangles)
        assert {name: counted[name] for name in EXACT} == totals(frame, triangles)
        number += len(triangles)
    tell({"triangles": number})


@pytest.mark.parametrize("scene", ["city:buildings=40", "glyphs", "cad", "stress", "sample"])
def test_counts_of_every_scene_are_the_references(drawn, scene):
    frame = frame_of(load(scene), View(256))
    parts = [triangulate(polygon, "ear-clipping") for polygon in frame.polygons]
    triangles = frame.join(parts)
    counted = drawn("shipped", frame, triangles)
    assert {name: counted[name] for name in EXACT} == totals(frame, triangles)
    assert counted == drawn("shipped", frame, triangles)

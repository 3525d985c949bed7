"""Every scene, framed and triangulated by all that there is, passes the verifier."""

from functools import cache

import numpy as np
import pytest

from harness.frame import Frame, View, make_frame
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse
from scenes import load
from triangulators import names

SCENES = (
    "city:buildings=15",
    "glyphs:text=Rg%8©ß",
    "cad:parts=5,segments=12",
    "paper",
    "stress:vertices=24",
    "meshes:limit=40",
)


@cache
def frame_of(scene: str) -> Frame:
    return make_frame(load(scene).polygons, View(resolution=512))


@pytest.mark.parametrize("name", names(available_only=True))
@pytest.mark.parametrize("scene", SCENES)
def test_scene_by_triangulator(scene, name, monkeypatch):
    # `listed` keeps sets of triangulations: minutes for its most; the benchmarks let it do these.
    monkeypatch.setattr("triangulators.methods.exhaustive.MOST_PAPER", 500)
    frame = frame_of(scene)
    result = triangulate_polygons(parse(name), frame.polygons)
    assert result.failed == []
    done = [part for part in result.parts if part is not None]
    # what is not there has a stated reason
    assert len(done) + len(result.skipped) == len(frame.polygons)
    assert all(np.issubdtype(part.dtype, np.int32) for part in done)

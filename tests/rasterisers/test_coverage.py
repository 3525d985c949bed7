"""Coverage: equal for every conforming triangulation, wrong in places with a T-junction."""

import numpy as np
import pytest
from shapely import Polygon

from harness.frame import View, make_frame
from harness.rasterisers import Options
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons
from scenes import load
from tests.rasterisers.conftest import find_errors

# A long roof with vertex 1 in the middle of its side 0-2.
ROOF = Polygon([(0, 0), (40, 3), (80, 6), (78, 30), (3, 25)])
WITH_T_JUNCTION = np.array([[0, 2, 3], [0, 3, 4]], np.int32)
CONFORMING = [
    np.array([[1, 2, 3], [1, 3, 4], [1, 4, 0]], np.int32),
    np.array([[0, 1, 3], [1, 2, 3], [0, 3, 4]], np.int32),
]
ANGLES = range(0, 180, 10)


def fragments(rasteriser, frame, triangles) -> int:
    return int(rasteriser.draw_and_count(frame, triangles, Options())["fragments"].sum())


def test_t_junction_causes_a_coverage_error_under_rotation(llvmpipe, reference):
    """Snapping moves vertex 1 off the side that should hold it: a gap or an overlap opens."""
    errors = []
    for angle in ANGLES:
        frame = make_frame([ROOF], View(1024, angle))
        conforming = fragments(llvmpipe, frame, CONFORMING[0])
        assert fragments(llvmpipe, frame, CONFORMING[1]) == conforming
        error = fragments(llvmpipe, frame, WITH_T_JUNCTION) - conforming
        exact = [fragments(reference, frame, t) for t in (WITH_T_JUNCTION, CONFORMING[0])]
        assert error == exact[0] - exact[1]
        errors.append(error)
    assert sum(error != 0 for error in errors) >= 3
    # A sliver of at most 1/256 px by the length of the side.
    assert max(abs(error) for error in errors) <= 1024 / 128


TRIANGULATORS = ("fan", "ear-clipping", "delaunay", "optimal:overdraw", "optimal:half-perimeter")


@pytest.mark.parametrize("scene", ["city", "helsinki"])
@pytest.mark.parametrize("resolution", [256, 1024])
def test_real_polygons_cover_the_same_pixels(llvmpipe, reference, scene, resolution):
    frame = make_frame(load(scene).polygons, View(resolution))
    expected = np.full(len(frame.polygons), -1)
    for name in TRIANGULATORS:
        result = triangulate_polygons(parse(name), frame.polygons)
        assert result.failed == []
        triangles = frame.join_triangles(result.parts)
        counted = llvmpipe.draw_and_count(frame, triangles, Options())
        fragments = counted["fragments"]
        assert find_errors(reference, counted, frame, triangles) == []
        parts = zip(result.parts, result.t_junctions, strict=True)
        conforming = np.array([part is not None and not t for part, t in parts])
        if name != "fan":
            assert conforming.sum() > 0.98 * len(frame.polygons)
        comparable = conforming & (expected >= 0)
        assert (fragments[comparable] == expected[comparable]).all(), name
        expected = np.where(conforming & (expected < 0), fragments, expected)
    assert (expected >= 0).all()
    assert expected.sum() > 0.05 * resolution**2

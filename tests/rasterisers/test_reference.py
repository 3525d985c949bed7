"""The CPU rasterisers agree with second implementations: per pixel, and by clipped polygons."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box

from harness.errors import UsageError
from harness.frame import UNBOUNDED
from harness.rasterisers import Options, find_device, get, spans
from harness.rasterisers.reference import (
    choose_polygon_colours,
    count_per_triangle,
    count_tiles,
)
from tests.rasterisers import pictures
from tests.rasterisers.conftest import loose_triangles, random_triangles
from tests.rasterisers.pictures import SIZE, find_covered, require_exact_counts
from triangulators import criteria

corner = st.tuples(*[st.integers(0, SIZE * 256)] * 2)
half_pixel = st.tuples(*[st.integers(0, SIZE * 2).map(lambda v: v * 128)] * 2)


@settings(deadline=None)  # the first call compiles
@given(st.lists(corner | half_pixel, min_size=3, max_size=3))
def test_every_count_equals_a_pixel_by_pixel_evaluation(corners):
    require_exact_counts(corners)


small = st.tuples(*[st.integers(0, 4 * 256)] * 2)


@settings(deadline=None, max_examples=15)
@given(st.lists(small, min_size=3, max_size=3))
def test_expected_quads_are_the_mean_over_all_positions_in_a_quad(corners):
    """The closed form of the criterion equals the mean count over all 512 x 512 positions."""
    points = np.array(corners, np.int32)
    expected = criteria.predict(points / 256, np.array([[0, 1, 2]], np.int32))["expected_quads"]
    places = np.stack(np.meshgrid(np.arange(512), np.arange(512)), axis=-1).reshape(-1, 1, 2)
    moved = (points + places).reshape(-1, 2).astype(np.int32)
    counts = count_per_triangle(moved, np.arange(len(moved), dtype=np.int32).reshape(-1, 3))
    # Only pixel centres on an edge, which the fill rule assigns to one side, cause a difference.
    assert counts["quads"].mean() == pytest.approx(expected, abs=0.01)


def test_image_has_one_pixel_a_fragment_and_the_polygons_colour(reference):
    frame, triangles = loose_triangles([[256, 256], [2560, 512], [768, 2048]], SIZE)
    picture = pictures.read_image(reference, frame, triangles, Options())
    assert picture.shape == (SIZE, SIZE, 4)
    mask = find_covered(frame.points)[::-1]
    colour = choose_polygon_colours(np.zeros(1, np.int32)).view(np.uint8)
    assert (picture[mask] == colour).all()
    assert not picture[~mask].any()


def test_every_repeat_is_drawn(reference, monkeypatch):
    frame, triangles = random_triangles(seed=4, size=64, number=20, grid=1)
    drawn = []
    with reference.prepare(frame, triangles, Options()) as drawing:
        monkeypatch.setattr(spans, "fill_picture", lambda _, rows, *more: drawn.append(rows))
        drawing.sample(10)
    assert len(drawn) == 10
    assert all(np.array_equal(item, triangles) for item in drawn)


def test_multisampling_is_refused_in_one_line(reference):
    frame, triangles = random_triangles(seed=4, size=64, number=2, grid=1)
    with pytest.raises(UsageError, match="one sample per pixel"):
        reference.draw_and_count(frame, triangles, Options(samples=4))


@pytest.mark.parametrize(
    ("triangles", "message"),
    [
        (np.zeros((2, 4), np.int32), r"\(m, 3\)"),
        (np.zeros((2, 3)), r"integer"),
        (np.array([[0, 1, 3]]), r"out of range \(0 to 2\)"),
        (np.array([[0, 1, -1]]), r"out of range \(0 to 2\)"),
    ],
)
def test_invalid_triangle_arrays_are_refused(reference, triangles, message):
    frame, _ = loose_triangles([[256, 256], [2560, 512], [768, 2048]], SIZE)
    with pytest.raises(ValueError, match=message):
        reference.draw_and_count(frame, triangles, Options())


on_edges = st.integers(0, 4).map(lambda v: v * 16)
of_tiles = st.tuples(*[st.integers(0, 64)] * 2) | st.tuples(on_edges, on_edges)


@settings(deadline=None)  # the first call compiles
@given(st.lists(of_tiles, min_size=3, max_size=3))
def test_tiles_are_those_whose_interior_meets_the_triangle(corners):
    """Tiles of 16 units in a field of 64; the exact count is checked by clipping."""
    points = np.array(corners, np.int32)
    by_box, exact = count_tiles(points, np.array([[0, 1, 2]], np.int32), 16, UNBOUNDED)[0]
    triangle = Polygon(corners)
    if triangle.area == 0:
        assert (by_box, exact) == (0, 0)
        return
    tiles = [box(x, y, x + 16, y + 16) for x in range(0, 64, 16) for y in range(0, 64, 16)]
    # Coordinates are small integers: a real overlap has more area than clipping's rounding.
    assert exact == sum(shapely.intersection(tile, triangle).area > 1e-9 for tile in tiles)
    bounds = box(*triangle.bounds)
    assert by_box == sum(shapely.intersection(tile, bounds).area > 1e-9 for tile in tiles)


@pytest.mark.parametrize("side", [2, 4, 8, 16, 32])
def test_mean_number_of_squares_follows_half_perimeter_and_area(side):
    """Monte Carlo over positions: 1 + H / s + S / s^2, to 3.5 standard errors (docs/theory.md)."""
    rng = np.random.default_rng(7)
    for _ in range(8):
        shape = rng.integers(-60 * 256, 60 * 256, (3, 2))
        (ax, ay), (bx, by) = shape[1] - shape[0], shape[2] - shape[0]
        moves = rng.integers(128 * 256, 256 * 256, (4000, 1, 2))
        points = (shape + moves).reshape(-1, 2).astype(np.int32)
        triangles = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        squares = count_tiles(points, triangles, side * 256, UNBOUNDED)[:, 1]
        area = abs(int(ax * by - ay * bx)) / 2 / 256**2
        half_perimeter = np.ptp(shape, axis=0).sum() / 256
        mean = 1 + half_perimeter / side + area / side**2
        error = squares.std() / np.sqrt(len(squares))
        assert abs(squares.mean() - mean) < 3.5 * error + 1e-9


def test_binning_cannot_be_timed():
    frame, triangles = random_triangles(seed=2, size=64, number=2, grid=1)
    binning = get("binning")(find_device("binning"))
    assert not binning.timed
    with pytest.raises(UsageError, match="only counts"):
        binning.prepare(frame, triangles, Options())

"""Each kind of draws isolates a term of the law, with the counters of the reference."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.frame import UNBOUNDED
from harness.grid import SUBPIXEL
from harness.profile import design, placing, stage_draws
from harness.profile.cost_terms import TERMS, count_draw, make_design_rows
from harness.profile.design import ASPECTS
from harness.profile.placing import DIRECTIONS, SIDE, Draw
from harness.rasterisers import spans
from harness.rasterisers.base import Options
from harness.rasterisers.reference import Reference, count_tiles_per_triangle

CountedDraws = list[tuple[Draw, dict[str, int]]]


@pytest.fixture(scope="module")
def counted() -> CountedDraws:
    return [(draw, count_draw(draw)) for draw in design.make_draws()]


def select_kind(counted: CountedDraws, kind: str) -> CountedDraws:
    return [pair for pair in counted if pair[0].kind == kind]


def group_kind(counted: CountedDraws, kind: str) -> dict[str, list[dict[str, int]]]:
    """Return the counters of the draws of a kind, by group."""
    groups: dict[str, list[dict[str, int]]] = {}
    for draw, counts in select_kind(counted, kind):
        groups.setdefault(draw.group, []).append(counts)
    return groups


def test_draws_are_in_the_viewport_and_cover_no_pixel_twice(counted):
    names = [draw.name for draw, _ in counted]
    assert len(set(zip((draw.kind for draw, _ in counted), names, strict=True))) == len(names)
    for draw, _ in counted:
        assert draw.frame.points.min() >= SUBPIXEL, draw.name
        assert draw.frame.points.max() <= (SIDE - 1) * SUBPIXEL, draw.name
    for draw, _ in counted[::9]:
        if draw.kind != "twice":
            covered, helpers = np.zeros((2, SIDE, SIDE), np.int64)
            lanes = covered, helpers
            spans.count_lanes_per_pixel(draw.frame.points, draw.triangles, *lanes, UNBOUNDED)
            assert covered.max() <= 1, draw.name


def test_counters_equal_the_reference(counted):
    reference = Reference()
    for draw, counts in counted[::17]:
        expected = reference.draw_and_count(draw.frame, draw.triangles, Options())
        for name, values in expected.items():
            assert counts[name] == values.sum(), name
        assert counts["covering"] <= counts["set_up"] <= counts["triangles"] == len(draw.triangles)


def test_thin_triangles_have_equal_areas_and_the_aspects_of_their_names(counted):
    for draw, counts in select_kind(counted, "aspect"):
        base, height = design.compute_triangle_sides(draw.area, draw.aspect)
        assert base / height == pytest.approx(draw.aspect, rel=0.01)
        assert base * height == pytest.approx(2 * draw.area * SUBPIXEL**2, rel=0.005)
        a, b, c = np.moveaxis(draw.frame.points[draw.triangles].astype(np.int64), 1, 0)
        (x1, y1), (x2, y2) = (b - a).T, (c - a).T
        doubled = np.abs(x1 * y2 - y1 * x2)
        # A corner is rounded by half a step, across a base as long as this.
        assert np.abs(doubled - base * height).max() <= 2 * base + 2
        assert doubled.mean() == pytest.approx(base * height, rel=0.005)
        assert counts["triangles"] == design.AREAS[draw.area]
    rows = [draw for draw, _ in select_kind(counted, "aspect")]
    assert len(rows) == len(design.AREAS) * len(ASPECTS) * len(DIRECTIONS)


def test_equal_helper_lanes_have_unequal_numbers_of_triangles(counted):
    counts = [row for _, row in select_kind(counted, "lanes")]
    for equal in ("helper_lanes", "half_perimeter"):
        assert max(row[equal] for row in counts) < 1.05 * min(row[equal] for row in counts)
    assert all(first["triangles"] == 2 * second["triangles"] for first, second in pairwise(counts))


def test_equal_triangles_have_unequal_helper_lanes_and_blocks(counted):
    counts = [row for _, row in select_kind(counted, "places")]
    for equal in ("triangles", "fragments", "half_perimeter", "bbox_tests", "vertices", "set_up"):
        assert len({row[equal] for row in counts}) == 1, equal
    pairs = [(row["helper_lanes"], row["blocks"]) for row in counts]
    assert len(set(pairs)) == len(pairs)
    lanes, blocks = (sorted(column) for column in zip(*pairs, strict=True))
    assert lanes[-1] > 1.3 * lanes[0]
    assert blocks[-1] > 2 * blocks[0]


def test_cuts_of_a_ring_differ_only_in_diagonals(counted):
    for group, counts in group_kind(counted, "cuts").items():
        assert len(counts) == len(placing.RING_TRIANGULATIONS)
        for equal in ("triangles", "fragments", "vertices"):
            assert len({row[equal] for row in counts}) == 1, (group, equal)
        assert len({row["half_perimeter"] for row in counts}) == len(counts)


def test_vertices_work_tiles_and_second_filling_are_isolated(counted):
    of_order = {"vertices", "vertex_batches", "transformed_vertices"}
    for kind, changed in (
        ("vertices", of_order),
        ("work", {"work"}),
        ("orders", {"vertex_batches", "transformed_vertices"}),
        ("tiles", {"tile_pairs", "further_tiles"}),
    ):
        for counts in group_kind(counted, kind).values():
            different = {name for name in counts[0] if len({row[name] for row in counts}) > 1}
            assert different == changed
    single, double = (counts for _, counts in select_kind(counted, "twice")[:2])
    ratios = {name: double[name] / single[name] for name in single if single[name]}
    assert ratios.pop("vertices") == 1
    assert set(ratios.values()) == {2}


def test_orders_of_a_mesh_transform_the_vertices_that_their_names_say(counted):
    triangles = {}
    for draw, counts in select_kind(counted, "orders"):
        per_triangle = counts["transformed_vertices"] / counts["triangles"]
        assert per_triangle == pytest.approx(float(draw.name.split()[0]), abs=0.01)
        rows = np.sort(draw.triangles, axis=1)
        triangles.setdefault(draw.group, []).append(sorted(map(tuple, rows)))
    assert len(triangles) == len(stage_draws.MESH_SIDES)
    for orders in triangles.values():
        assert all(rows == orders[0] for rows in orders)


def test_the_share_of_triangles_on_samples_is_exact(counted):
    for step in (1, 16):  # also on the coarsest grid
        for draw, counts in select_kind(counted, "samples"):
            snapped = counts if step == 1 else count_draw(design.snap_draw(draw, step))
            assert snapped["covering"] == int(draw.name[0]) * counts["triangles"] // 4
            assert snapped["fragments"] == snapped["covering"]
    for group in ("samples isolated", "samples patches"):
        vertices = {c["transformed_vertices"] for draw, c in counted if draw.group == group}
        assert len(vertices) == 1


def test_every_triangle_crosses_the_border_of_its_tiles(counted):
    tiles = {8: (1, 1, 1), 16: (2, 1, 1), 32: (2, 2, 1), 64: (2, 2, 2)}
    for index, (draw, _) in enumerate(select_kind(counted, "tiles")):
        expected = list(tiles.values())[index % len(tiles)]
        touched = count_tiles_per_triangle(draw.frame.points, draw.triangles)
        for side, count in zip((16, 32, 64), expected, strict=True):
            assert (touched[f"tiles_{side}_exact"] == count).all(), draw.name


def test_each_population_of_a_mixed_draw_keeps_another_stage_busy(counted):
    """Costs are those of an H200, in ns."""
    stages = {
        "vertices": {"vertex_batches": 19.9},
        "covering": {"covering": 1.96, "helper_lanes": 0.184},
        "quads": {"quads": 0.264, "helper_lanes": 0.051},
    }
    times = {}
    for draw, counts in select_kind(counted, "mixed"):
        busy = {
            stage: sum(cost * counts[name] for name, cost in costs.items())
            for stage, costs in stages.items()
        }
        if draw.name.endswith(" alone"):
            name = draw.name.split()[0]
            assert max(busy, key=lambda stage: busy[stage]) == name
            assert sorted(busy.values())[-2] < 0.3 * busy[name]
            times[name] = busy[name]
            continue
        pair = [name for name in stages if name in draw.name]
        assert max(busy.values()) < 0.65 * sum(times[name] for name in pair)
    assert max(times.values()) < 1.15 * min(times.values())
    names = {draw.name: draw for draw, _ in select_kind(counted, "mixed")}
    one, other = (names[f"vertices{text}"] for text in (", then quads", " and quads, interleaved"))
    assert not np.array_equal(one.triangles, other.triangles)
    assert sorted(map(tuple, one.triangles)) == sorted(map(tuple, other.triangles))


def test_terms_of_the_design_are_not_collinear(counted):
    """No term is nearly a linear combination of others, with rows scaled to equal times."""
    rows = make_design_rows([counts for draw, counts in counted if draw.kind != "twice"])
    rows = rows / (rows @ (1.0 / rows.max(axis=0)))[:, None]
    for number, name in enumerate(TERMS):
        other_terms = np.delete(rows, number, axis=1)
        column = rows[:, number]
        combination = other_terms @ np.linalg.lstsq(other_terms, column, rcond=None)[0]
        assert np.linalg.norm(column - combination) > 0.02 * np.linalg.norm(column), name


@settings(max_examples=25, deadline=None)
@given(st.integers(500, 30000), st.integers(500, 30000), st.sampled_from(DIRECTIONS))
def test_boxes_fit_the_viewport_and_do_not_touch(width, height, direction):
    corners = placing.fit_boxes(width, height, direction, 50)
    assert len(corners) <= 50
    if len(corners):
        ends = placing.rotate(corners, direction)
        assert np.abs(ends).max() <= SIDE * SUBPIXEL // 2 - placing.MARGIN
        distances = np.abs(corners[:, None] - corners)
        separate = (distances >= np.array([width, height]) + placing.GAP).any(axis=2)
        assert (separate | np.eye(len(corners), dtype=bool)).all()

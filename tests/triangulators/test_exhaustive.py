import csv

import numpy as np
import pytest

from harness.study.pareto import make_triangulation_table
from tests.paths import find_shared_data
from tests.triangulators.cases import (
    PAPER,
    all_triangulations,
    convex,
    random_simple,
    star,
    with_hole,
)
from triangulators import SkippedError, triangulate
from triangulators.criteria import predict
from triangulators.initial import make_cycle
from triangulators.methods.exhaustive import (
    Recursion,
    count_triangulations,
    count_triangulations_of_cycle,
    enumerate_triangulations,
)
from triangulators.polygon import boundary
from triangulators.verify import verify


def test_the_papers_polygon_has_29_conforming_triangulations():
    listed = enumerate_triangulations(PAPER)
    assert len(listed) == count_triangulations(PAPER) == 29
    assert all(verify(PAPER, triangles).conforming for triangles in listed)
    table = make_triangulation_table(PAPER, "conforming")
    assert min(table["overdraw"]) == 56.0
    assert len(set(table["diagonals"])) == 29
    assert all(text.count("-") == 6 for text in table["diagonals"])


def test_paper_mode_reproduces_table_1():
    rows = csv.DictReader(find_shared_data("paper_table1.csv").read_text().splitlines())
    printed = [(float(row["area"]), float(row["difference_deg"])) for row in rows]
    table = make_triangulation_table(PAPER, "paper")
    pairs = list(zip(table["overdraw"], table["shape"], strict=True))
    assert len(pairs) == 47
    assert table["conforming"].sum() == 29
    assert len(printed) == 15
    for (area, difference), row in zip(printed, pairs[:5] + pairs[-10:], strict=True):
        assert row[0] == pytest.approx(area, abs=1e-9)
        assert row[1] == pytest.approx(difference, abs=1e-9)


def test_dropped_vertices_leave_t_junctions_but_cover():
    for triangles in enumerate_triangulations(PAPER, "paper"):
        verification = verify(PAPER, triangles)
        assert verification.ok
        assert verification.conforming == (len(triangles) == 7)
        assert verification.conforming or {vertex for vertex, _ in verification.t_junctions} == {8}


def test_lists_are_complete_and_without_duplicates():
    rng = np.random.default_rng(11)
    for _ in range(60):
        polygon = random_simple(rng, int(rng.integers(3, 10)))
        expected = as_sets(all_triangulations(polygon))
        listed = enumerate_triangulations(polygon)
        assert as_sets(triangles.tolist() for triangles in listed) == expected
        assert len(listed) == len(expected) == count_triangulations(polygon)
        outline = boundary(polygon)
        recursion = Recursion(outline.points, drop_straight=False)
        assert as_sets(recursion.list_triangulations(outline.edges[:, 0].tolist())) == expected


def as_sets(triangulations):
    return {frozenset(map(frozenset, triangles)) for triangles in triangulations}


def test_convex_polygons_have_catalans_number():
    counts = [count_triangulations(convex(n)) for n in (3, 4, 5, 10, 40)]
    assert counts == [1, 2, 5, 1430, 176733862787006701400]


@pytest.mark.parametrize("polygon", [convex(40), star(200)])
def test_too_many_triangulations_are_skipped_with_alternative(polygon):
    with pytest.raises(SkippedError, match="more than 1000000 triangulations; use 'optimal'"):
        triangulate(polygon, "exhaustive")
    with pytest.raises(SkippedError, match="more than 1000000 triangulations; use 'optimal'"):
        enumerate_triangulations(polygon)


def test_count_stops_at_limit():
    for polygon in (PAPER, convex(12), star(24)):
        ring = make_cycle(boundary(polygon), "count")
        full_count = count_triangulations_of_cycle(ring)
        assert count_triangulations_of_cycle(ring, full_count) == full_count
        assert full_count // 2 < count_triangulations_of_cycle(ring, full_count // 2) <= full_count


def test_holes_are_skipped():
    with pytest.raises(SkippedError, match="holes"):
        triangulate(with_hole(np.random.default_rng(0), 8, 3), "exhaustive")


def test_listed_sorts_paper_triangulations_by_overdraw():
    table = make_triangulation_table(PAPER, "paper")
    points = boundary(PAPER).points
    listed = [triangulate(PAPER, "listed", k=k) for k in range(47)]
    assert len({tuple(sorted(map(tuple, triangles.tolist()))) for triangles in listed}) == 47
    costs = [predict(points, triangles)["overdraw"] for triangles in listed]
    assert costs == pytest.approx(sorted(table["overdraw"]))
    assert costs[0] == 53.0
    assert not verify(PAPER, listed[0]).conforming
    assert sum(verify(PAPER, triangles).conforming for triangles in listed) == 29
    with pytest.raises(SkippedError, match="k=47 is out of range"):
        triangulate(PAPER, "listed", k=47)
    with pytest.raises(SkippedError, match="more than 20000"):
        triangulate(convex(20), "listed")

"""A user's triangulator runs in a separate process in every command."""

import os

import numpy as np
import pytest
from shapely import Polygon, box

import triangulators
from harness.errors import UsageError
from harness.triangulating import triangulate
from harness.worker import TaskError, get_shared_worker
from tests.conftest import BLOCK, write_geojson
from triangulators.polygon_arrays import PolygonArray

SIZES = (1.0, 2.0, 30.0, 3.0, 4.0, 40.0, 5.0)
CRASHING = [2, 5]


def squares() -> list[Polygon]:
    return [box(10 * index, 0, 10 * index + size, size) for index, size in enumerate(SIZES)]


@pytest.mark.parametrize(
    "make_polygons",
    [squares, lambda: PolygonArray.from_shapely(squares())],
    ids=["polygons", "arrays"],
)
def test_only_crashing_polygons_fail(make_polygons):
    result = triangulate.triangulate_many(make_polygons(), "tests.broken:crash_at_large")
    right = triangulators.triangulate_many(squares(), "ear-clipping")
    assert sorted(result.failed) == CRASHING
    assert all("crashed: SIGSEGV" in reason for reason in result.failed.values())
    for number, triangles in enumerate(result):
        expected = [] if number in CRASHING else np.sort(right[number]).tolist()
        assert np.sort(triangles).tolist() == expected


def test_after_many_crashes_a_part_fails_as_a_unit(monkeypatch):
    monkeypatch.setattr(triangulate, "MAX_CRASHES", 1)
    tried = []
    worker = get_shared_worker("triangulator tests.broken:crash_at_large")
    call = worker.call

    def counted(function, *arguments, **more):
        if arguments:
            tried.append(len(arguments[0]))
        return call(function, *arguments, **more)

    monkeypatch.setattr(worker, "call", counted)
    large = [box(0, 0, 20, 20)] * 8
    result = triangulate.triangulate_many([*large, box(0, 0, 1, 1)], "tests.broken:crash_at_large")
    assert sorted(result.failed) == list(range(9))
    assert tried == [9, 4, 2, 1, 1, 2, 5]
    assert "after 1 crashes, a crashing polygon's neighbours fail as well" in result.failed[8]
    assert "neighbours" not in result.failed[0]


def test_an_empty_batch():
    result = triangulate.triangulate_many([], "tests.broken:triangulate_clockwise")
    assert (len(result), result.triangles.shape, result.failed) == (0, (0, 3), {})


@pytest.mark.parametrize(
    ("statement", "error", "reason"),
    [
        ("os._exit(0)", TaskError, "crashed: exit code 0"),
        ("import no_such_package", UsageError, "no_such_package"),
        ("cut = 3", UsageError, "not a function"),
    ],
)
def test_import_errors_are_reported(tmp_path, monkeypatch, statement, error, reason):
    name = f"importing_{len(statement)}"
    (tmp_path / f"{name}.py").write_text(f"import os\n{statement}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(error, match=reason):
        triangulate.triangulate_many(squares(), f"{name}:cut")


def test_a_missing_module_is_refused():
    message = "no module 'mien'; the module must be in the current folder"
    with pytest.raises(UsageError, match=message):
        triangulate.triangulate_many(squares(), "mien:cut")


def test_triangulate_names_crashing_polygons_and_writes_the_others(harness, tmp_path):
    write_geojson(tmp_path / "squares.geojson", squares())
    command = ("triangulate", "squares.geojson", "--triangulator", "tests.broken:crash_at_large")
    code, out, err = harness(*command, "-o", "out.geojson")
    assert code == 5, err
    assert "5 polygons" in out
    assert err.count("crashed: SIGSEGV") == 1  # counted by reason
    assert "failed 2" in err


@pytest.mark.parametrize("in_worker", [False, True], ids=["isolated", "in a worker"])
def test_invalid_triangulations_fail(in_worker, monkeypatch):
    if in_worker:
        monkeypatch.setattr(triangulate.multiprocessing, "parent_process", os.getppid)
        monkeypatch.setattr("harness.worker.get_shared_worker", None)  # not called
    shapes = [box(0, 0, 2, 1), BLOCK[0]]
    result = triangulate.triangulate_many(shapes, "tests.broken:return_two_triangles")
    assert list(result.failed) == [1]
    assert "gap or overlap" in result.failed[1]
    assert [len(piece) for piece in result] == [2, 0]


def test_built_in_triangulations_are_verified(monkeypatch):
    square, real = box(0, 0, 2, 1), triangulators.triangulate_many
    assert triangulate.triangulate_many([square, BLOCK[0]], "ear-clipping").failed == {}

    def overlapping(*arguments, **options):
        result = real(*arguments, **options)
        result.triangles[2:4] = result.triangles[2]  # the first two of the second polygon
        return result

    monkeypatch.setattr(triangulate.triangulators, "triangulate_many", overlapping)
    result = triangulate.triangulate_many([square, BLOCK[0], square], "ear-clipping")
    assert list(result.failed) == [1]
    assert [len(piece) for piece in result] == [2, 0, 2]
    assert len(result.compiled) == 3

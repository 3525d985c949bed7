"""A user's triangulator runs in a process of its own, whichever command it is named to."""

import os

import numpy as np
import pytest
from shapely import Polygon, box

import triangulators
from harness.errors import UsageError
from harness.triangulating import isolated
from harness.workers.worker import TaskError, shared_worker
from tests.conftest import write_geojson
from triangulators.polygon_arrays import PolygonArray

SIZES = (1.0, 2.0, 30.0, 3.0, 4.0, 40.0, 5.0)
CRASHING = [2, 5]


def squares() -> list[Polygon]:
    return [box(10 * place, 0, 10 * place + size, size) for place, size in enumerate(SIZES)]


@pytest.mark.parametrize(
    "given", [squares, lambda: PolygonArray.from_shapely(squares())], ids=["polygons", "arrays"]
)
def test_a_crash_costs_its_own_polygon(given):
    found = isolated.triangulate_many(given(), "tests.broken:crash_at_large")
    right = triangulators.triangulate_many(squares(), "ear-clipping")
    assert sorted(found.failed) == CRASHING
    assert all("crashed: SIGSEGV" in reason for reason in found.failed.values())
    for number, triangles in enumerate(found):
        wanted = [] if number in CRASHING else np.sort(right[number]).tolist()
        assert np.sort(triangles).tolist() == wanted


def test_after_many_crashes_a_part_fails_as_a_whole(monkeypatch):
    monkeypatch.setattr(isolated, "MAX_CRASHES", 1)
    tried = []
    worker = shared_worker("triangulator tests.broken:crash_at_large")
    call = worker.call

    def counted(function, *arguments, **more):
        if arguments:
            tried.append(len(arguments[0]))
        return call(function, *arguments, **more)

    monkeypatch.setattr(worker, "call", counted)
    large = [box(0, 0, 20, 20)] * 8
    found = isolated.triangulate_many([*large, box(0, 0, 1, 1)], "tests.broken:crash_at_large")
    assert sorted(found.failed) == list(range(9))
    assert tried == [9, 4, 2, 1, 1, 2, 5]
    assert "after 1 crashes, polygons near another fail with it" in found.failed[8]
    assert "near another" not in found.failed[0]


def test_a_batch_of_nothing():
    found = isolated.triangulate_many([], "tests.broken:triangulate_clockwise")
    assert (len(found), found.triangles.shape, found.failed) == (0, (0, 3), {})


@pytest.mark.parametrize(
    ("statement", "error", "reason"),
    [
        ("os._exit(0)", TaskError, "crashed: exit code 0"),
        ("import no_such_package", UsageError, "no_such_package"),
        ("cut = 3", UsageError, "not a function"),
    ],
)
def test_what_cannot_be_imported(tmp_path, monkeypatch, statement, error, reason):
    name = f"importing_{len(statement)}"
    (tmp_path / f"{name}.py").write_text(f"import os\n{statement}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(error, match=reason):
        isolated.triangulate_many(squares(), f"{name}:cut")


def test_a_module_that_is_not_there():
    with pytest.raises(UsageError, match="no module 'mien'; a module lies in the folder you are"):
        isolated.triangulate_many(squares(), "mien:cut")


def test_triangulate_names_the_polygons_that_crash_and_writes_the_others(harness, tmp_path):
    write_geojson(tmp_path / "squares.geojson", squares())
    made = ("triangulate", "squares.geojson", "--triangulator", "tests.broken:crash_at_large")
    code, out, err = harness(*made, "-o", "out.geojson")
    assert code == 5, err
    assert "5 polygons" in out
    assert err.count("crashed: SIGSEGV") == 1  # counted by reason
    assert "failed 2" in err


@pytest.mark.parametrize("within", [False, True], ids=["isolated", "in a worker"])
def test_what_is_no_triangulation_is_failed(within, monkeypatch):
    if within:
        monkeypatch.setattr(isolated.multiprocessing, "parent_process", os.getppid)
        monkeypatch.setattr("harness.workers.worker.shared_worker", None)  # not called
    shapes = [box(0, 0, 2, 1), l_shape()]
    found = isolated.triangulate_many(shapes, "tests.broken:return_two_triangles")
    assert list(found.failed) == [1]
    assert "gap or overlap" in found.failed[1]
    assert [len(piece) for piece in found] == [2, 0]


def test_what_a_built_in_triangulator_gives_is_verified(monkeypatch):
    square, real = box(0, 0, 2, 1), triangulators.triangulate_many
    assert isolated.triangulate_many([square, l_shape()], "ear-clipping").failed == {}

    def overlapping(*given, **more):
        done = real(*given, **more)
        done.triangles[2:4] = done.triangles[2]  # the first two of the second polygon
        return done

    monkeypatch.setattr(isolated.triangulators, "triangulate_many", overlapping)
    done = isolated.triangulate_many([square, l_shape(), square], "ear-clipping")
    assert list(done.failed) == [1]
    assert [len(piece) for piece in done] == [2, 0, 2]
    assert len(done.compiled) == 3


def l_shape() -> Polygon:
    return Polygon([(0, 0), (6, 0), (6, 2), (2, 2), (2, 4), (0, 4)])

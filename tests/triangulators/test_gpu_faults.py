"""Device failures: one warning, and the results of the CPU."""

import multiprocessing
from itertools import chain, repeat
from pathlib import Path
from unittest.mock import Mock, PropertyMock

import numpy as np
import pytest
import shapely

from tests.conftest import assert_refused, require_ok, write_geojson
from tests.triangulators.cases import star, with_hole
from triangulators import triangulate_many, vertices
from triangulators.gpu import engine
from triangulators.gpu.engine import Compute, DeviceError, Storage, open_context

# Rings of each size with a program of its own, narrow and wide, and some for the CPU.
POLYGONS = [star(n, seed=n) for n in (5, 20, 40, 64, 3, 12)]
POLYGONS += [shapely.box(0, 0, 3, 2), shapely.box(0, 0, 2**20, 1 / 256), star(200)]
POLYGONS += [with_hole(np.random.default_rng(2), 10, 4)]


@pytest.fixture(scope="module")
def expected():
    return triangulate_many(POLYGONS, device="cpu")


@pytest.fixture(autouse=True)
def _fresh():
    """Close all devices before and after each test."""
    engine.close_all()
    yield
    engine.close_all()


def expect_one_warning(expected, caplog, *words):
    """Triangulate on a broken device; assert equal results and one warning with these words."""
    batch = triangulate_many(POLYGONS, device="llvmpipe")
    assert batch.failed == {}
    assert np.array_equal(batch.triangles, expected.triangles)
    assert np.array_equal(batch.triangle_offsets, expected.triangle_offsets)
    (line,) = [record.message for record in caplog.records]
    assert line.startswith("llvmpipe")
    assert "\n" not in line
    for word in ("CPU", *words):
        assert word in line
    return line


def fail_after(monkeypatch, owner, name, calls, error):
    """Make a method raise after some calls; return the list of its calls."""
    method, recorded = getattr(owner, name), []

    def broken(*arguments, **named):
        recorded.append(name)
        if len(recorded) > calls:
            raise error
        return method(*arguments, **named)

    monkeypatch.setattr(owner, name, broken)
    return recorded


@pytest.mark.parametrize(
    "error",
    [
        DeviceError("there is no llvmpipe with compute shaders here"),
        OSError("libEGL.so.1: cannot open shared object file"),
        Exception("eglCreateContext failed\n(0x3003)"),
        MemoryError(),
    ],
)
def test_driver_fails_to_open(monkeypatch, expected, caplog, error):
    fail_after(monkeypatch, engine, "open_context", 0, error)
    expect_one_warning(expected, caplog, str(error).split("\n")[0] or "MemoryError")


@pytest.mark.parametrize("calls", [0, 1, 3])
def test_shader_fails_to_compile(monkeypatch, expected, caplog, calls):
    error = Exception("GLSL Compiler failed\n\ncompute_shader\n0:1(1): syntax error")
    fail_after(monkeypatch, Compute, "get_program", calls, error)
    expect_one_warning(expected, caplog, "GLSL Compiler failed compute_shader 0:1(1): syntax")


@pytest.mark.parametrize("calls", range(4))
def test_dispatch_fails_early_or_late(monkeypatch, expected, caplog, calls):
    recorded = fail_after(monkeypatch, Compute, "dispatch", calls, RuntimeError("device lost"))
    expect_one_warning(expected, caplog, "device lost")
    assert len(recorded) == calls + 1


def test_results_before_failure_are_retained(monkeypatch, expected, caplog):
    done = []
    attempt = engine.solve_on_device

    def kept(name, batch, *how):
        attempt(name, batch, *how)
        done.extend(batch.done.tolist())

    monkeypatch.setattr(engine, "solve_on_device", kept)
    monkeypatch.setattr(engine, "find_chunk_bounds", lambda offsets: [0, 2, 4, len(offsets) - 1])
    fail_after(monkeypatch, Storage, "read_into", 1, RuntimeError("gone"))
    expect_one_warning(expected, caplog, "gone")
    assert done == [True] * 2 + [False] * (len(POLYGONS) - 2)


@pytest.mark.parametrize("after", range(5))
@pytest.mark.parametrize("error", ["GL_OUT_OF_MEMORY", "GL_CONTEXT_LOST"])
def test_opengl_errors_are_detected(monkeypatch, expected, caplog, error, after):
    def opened(name):
        compute = open_context(name)
        compute.ctx = Mock(wraps=compute.ctx)
        errors = chain(["GL_NO_ERROR"] * after, repeat(error))
        type(compute.ctx).error = PropertyMock(side_effect=errors)
        return compute

    monkeypatch.setattr(engine, "open_context", opened)
    expect_one_warning(expected, caplog, error)


def test_buffer_allocation_fails(monkeypatch, expected, caplog):
    reserve = Storage.reserve

    def refused(self, count):
        if count >= 1 << 10:
            raise DeviceError(f"OpenGL error GL_OUT_OF_MEMORY while taking {count:,} bytes")
        reserve(self, count)

    monkeypatch.setattr(Storage, "reserve", refused)
    expect_one_warning(expected, caplog, "GL_OUT_OF_MEMORY")


SPOILED = {
    "zeros": lambda words: 0 * words,
    "noise": lambda words: np.random.default_rng(7).integers(0, 2**32, len(words), np.uint32),
    "unfinished": lambda words: np.r_[words[: len(words) // 8], 0 * words[len(words) // 8 :]],
    "swapped": lambda words: np.r_[words[[0, 2, 1]], words[3:]],
    "dearer": lambda words: np.r_[words[:1] + 1, words[1:]],
}


@pytest.mark.parametrize("kind", SPOILED)
def test_corrupted_results_are_rejected(monkeypatch, expected, caplog, kind):
    read_into = Storage.read_into

    def spoiled(self, array):
        read_into(self, array)
        array[:] = SPOILED[kind](array)

    monkeypatch.setattr(Storage, "read_into", spoiled)
    expect_one_warning(expected, caplog, "results are wrong")


@pytest.mark.parametrize(("factor", "is_accepted"), [(1 + 1e-10, True), (1 + 1e-8, False)])
def test_reported_quads_are_compared_with_the_cpu(monkeypatch, caplog, factor, is_accepted):
    read_into = Storage.read_into

    def change_cost(self, array):
        read_into(self, array)
        words = array[[0, -1]]
        words.view(np.float64)[0] *= factor
        array[[0, -1]] = words

    monkeypatch.setattr(Storage, "read_into", change_cost)
    batch = triangulate_many([star(9)], "optimal:expected-quads", device="llvmpipe")
    expected = triangulate_many([star(9)], "optimal:expected-quads")
    assert np.array_equal(batch.triangles, expected.triangles)
    assert batch.compiled.tolist() == [is_accepted]
    assert ["results are wrong" in r.message for r in caplog.records] == [True] * (not is_accepted)


def test_failed_device_is_reopened_on_next_call(monkeypatch, expected, caplog):
    with monkeypatch.context() as patch:
        fail_after(patch, engine.Engine, "solve", 0, RuntimeError("lost"))
        expect_one_warning(expected, caplog, "lost")
        triangulate_many(POLYGONS, device="llvmpipe")
        assert len(caplog.records) == 1  # said once
    recorded = fail_after(monkeypatch, engine, "open_context", 1, AssertionError)
    batch = triangulate_many(POLYGONS, device="llvmpipe")
    assert np.array_equal(batch.triangles, expected.triangles)
    assert len(recorded) == 1
    assert len(caplog.records) == 1


def forked(_):
    batch = triangulate_many(POLYGONS, device="llvmpipe")
    return batch.triangles, sorted(engine._warned)


def test_forked_process_does_not_use_parents_driver(expected, caplog):
    triangulate_many(POLYGONS, device="llvmpipe")
    with multiprocessing.get_context("fork").Pool(1) as pool:
        ((triangles, warnings),) = pool.map_async(forked, [0]).get(timeout=60)
    assert np.array_equal(triangles, expected.triangles)
    (line,) = warnings
    assert "loaded before this process was forked" in line
    triangulate_many(POLYGONS, device="llvmpipe")
    assert caplog.records == []


def test_command_writes_equal_files_on_all_devices(harness, tmp_path, caplog):
    """Also on an unusable device, which is logged once."""
    rings = [vertices(star(n)) for n in (5, 12, 70)] + [vertices(star(9)) / 3]
    source = write_geojson(tmp_path / "stars.geojson", [shapely.Polygon(ring) for ring in rings])
    command = ("triangulate", str(source), "-o", "out.npz", "--device")
    results = []
    for device in ("llvmpipe", "cpu", "gpu31"):
        out, _ = require_ok(harness(*command, device))
        assert "4 polygons" in out
        with np.load("out.npz") as arrays:
            results.append(dict(arrays))
        Path("out.npz").unlink()
    np.testing.assert_equal(results, results[:1] * 3)
    assert caplog.text.count("gpu31: no EGL device of this name supports compute shaders") == 1
    assert_refused(harness(*command, "cuda"), "unknown device 'cuda'")
    assert not Path("out.npz").exists()

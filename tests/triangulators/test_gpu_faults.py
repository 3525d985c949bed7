"""A device that fails costs one line and its speed: the results are the CPU's."""

import multiprocessing

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
    """Each test opens the device itself, and leaves none behind."""
    engine.close_all()
    yield
    engine.close_all()


def found_with_one_line(expected, caplog, *words):
    """Triangulate on a device that is broken; it must not show but in one line of these words."""
    found = triangulate_many(POLYGONS, device="llvmpipe")
    assert found.failed == {}
    assert np.array_equal(found.triangles, expected.triangles)
    assert np.array_equal(found.triangle_offsets, expected.triangle_offsets)
    (line,) = [record.message for record in caplog.records]
    assert line.startswith("llvmpipe")
    assert "\n" not in line
    for word in ("CPU", *words):
        assert word in line
    return line


def fails_after(monkeypatch, owner, name, calls, error):
    """Let a method work for some calls and raise from then on; returns a count of its calls."""
    method, made = getattr(owner, name), []

    def broken(*arguments, **named):
        made.append(name)
        if len(made) > calls:
            raise error
        return method(*arguments, **named)

    monkeypatch.setattr(owner, name, broken)
    return made


@pytest.mark.parametrize(
    "error",
    [
        DeviceError("there is no llvmpipe with compute shaders here"),
        OSError("libEGL.so.1: cannot open shared object file"),
        Exception("eglCreateContext failed\n(0x3003)"),
        MemoryError(),
    ],
)
def test_a_driver_that_does_not_open(monkeypatch, expected, caplog, error):
    fails_after(monkeypatch, engine, "open_context", 0, error)
    found_with_one_line(expected, caplog, str(error).split("\n")[0] or "MemoryError")


@pytest.mark.parametrize("calls", [0, 1, 3])
def test_shaders_that_do_not_compile(monkeypatch, expected, caplog, calls):
    error = Exception("GLSL Compiler failed\n\ncompute_shader\n0:1(1): syntax error")
    fails_after(monkeypatch, Compute, "program", calls, error)
    found_with_one_line(expected, caplog, "GLSL Compiler failed compute_shader 0:1(1): syntax")


@pytest.mark.parametrize("calls", range(4))
def test_a_dispatch_that_fails_early_or_late(monkeypatch, expected, caplog, calls):
    made = fails_after(monkeypatch, Compute, "run", calls, RuntimeError("device lost"))
    found_with_one_line(expected, caplog, "device lost")
    assert len(made) == calls + 1


def test_what_was_done_before_the_device_failed_is_kept(monkeypatch, expected, caplog):
    done = []
    attempt = engine.attempt

    def kept(name, batch, *how):
        attempt(name, batch, *how)
        done.extend(batch.done.tolist())

    monkeypatch.setattr(engine, "attempt", kept)
    monkeypatch.setattr(engine, "chunk_bounds", lambda offsets: [0, 2, 4, len(offsets) - 1])
    fails_after(monkeypatch, Storage, "read_into", 1, RuntimeError("gone"))
    found_with_one_line(expected, caplog, "gone")
    assert done == [True] * 2 + [False] * (len(POLYGONS) - 2)


class OnError:
    """A context of which OpenGL reports an error; the rest is the real one's."""

    def __init__(self, ctx, error, after):
        self._ctx, self._error, self._after = ctx, error, after

    def __getattr__(self, name):
        return getattr(self._ctx, name)

    @property
    def error(self):
        self._after -= 1
        return self._error if self._after < 0 else "GL_NO_ERROR"


@pytest.mark.parametrize("after", range(5))
@pytest.mark.parametrize("error", ["GL_OUT_OF_MEMORY", "GL_CONTEXT_LOST"])
def test_errors_that_opengl_notes(monkeypatch, expected, caplog, error, after):
    def opened(name):
        compute = open_context(name)
        compute.ctx = OnError(compute.ctx, error, after)
        return compute

    monkeypatch.setattr(engine, "open_context", opened)
    found_with_one_line(expected, caplog, error)


def test_no_memory_for_a_buffer(monkeypatch, expected, caplog):
    reserve = Storage.reserve

    def refused(self, count):
        if count >= 1 << 10:
            raise DeviceError(f"OpenGL error GL_OUT_OF_MEMORY while taking {count:,} bytes")
        reserve(self, count)

    monkeypatch.setattr(Storage, "reserve", refused)
    found_with_one_line(expected, caplog, "GL_OUT_OF_MEMORY")


def zeros(array):
    array[:] = 0


def noise(array):
    array[:] = np.random.default_rng(7).integers(0, 2**32, len(array), dtype=np.uint32)


def unfinished(array):
    array[len(array) // 8 :] = 0


def swapped(array):
    array[1], array[2] = array[2], array[1]


def dearer(array):
    array[0] += 1


@pytest.mark.parametrize("spoil", [zeros, noise, unfinished, swapped, dearer])
def test_results_that_a_driver_spoils_are_not_believed(monkeypatch, expected, caplog, spoil):
    read_into = Storage.read_into

    def spoiled(self, array):
        read_into(self, array)
        spoil(array)

    monkeypatch.setattr(Storage, "read_into", spoiled)
    found_with_one_line(expected, caplog, "results are wrong")


def test_a_device_that_failed_is_opened_anew_when_it_is_named(monkeypatch, expected, caplog):
    with monkeypatch.context() as patch:
        fails_after(patch, engine.Engine, "do", 0, RuntimeError("lost"))
        found_with_one_line(expected, caplog, "lost")
        triangulate_many(POLYGONS, device="llvmpipe")
        assert len(caplog.records) == 1  # said once
    made = fails_after(monkeypatch, engine, "open_context", 1, AssertionError)
    found = triangulate_many(POLYGONS, device="llvmpipe")
    assert np.array_equal(found.triangles, expected.triangles)
    assert len(made) == 1
    assert len(caplog.records) == 1


def forked(_):
    found = triangulate_many(POLYGONS, device="llvmpipe")
    return found.triangles, sorted(engine._said)


def test_a_process_that_was_forked_does_without_its_parents_driver(expected, caplog):
    triangulate_many(POLYGONS, device="llvmpipe")
    with multiprocessing.get_context("fork").Pool(1) as pool:
        ((triangles, said),) = pool.map_async(forked, [0]).get(timeout=60)
    assert np.array_equal(triangles, expected.triangles)
    (line,) = said
    assert "loaded before this process was forked" in line
    triangulate_many(POLYGONS, device="llvmpipe")
    assert caplog.records == []


def test_the_command_line_gives_the_same_file_on_every_device(harness, tmp_path):
    source = square_file(tmp_path)
    for device in ("llvmpipe", "cpu"):
        given = ["triangulate", str(source), "--device", device]
        code, out, err = harness(*given, "-o", f"{device}.npz")
        assert (code, "4 polygons" in out) == (0, True), err
    with np.load("llvmpipe.npz") as ours, np.load("cpu.npz") as theirs:
        assert set(ours) == set(theirs)
        for key in ours:
            assert np.array_equal(ours[key], theirs[key]), key


def square_file(folder):
    """A GeoJSON of polygons on the grid, and one that is not."""
    rings = [vertices(star(n)) for n in (5, 12, 70)] + [vertices(star(9)) / 3]
    return write_geojson(folder / "stars.geojson", [shapely.Polygon(ring) for ring in rings])


def test_the_command_line_says_what_it_cannot_use(harness, tmp_path, caplog):
    source = square_file(tmp_path)
    out, _ = require_ok(harness("triangulate", str(source), "-o", "x.npz", "--device", "gpu31"))
    assert "4 polygons" in out
    assert caplog.text.count("there is no gpu31 with compute shaders here") == 1
    assert_refused(
        harness("triangulate", str(source), "-o", "y.npz", "--device", "cuda"),
        "unknown device 'cuda'",
    )
    assert not (tmp_path / "y.npz").exists()

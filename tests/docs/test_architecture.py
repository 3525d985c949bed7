"""Imports go one way, as the picture in docs/architecture.md shows it."""

import ast
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from tests.docs.blocks import pages
from tests.paths import ROOT

SVG = "{http://www.w3.org/2000/svg}"
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
PACKAGES = ("harness", "scenes", "triangulators")
FOLDERS = "docs|examples|harness|ports|scenes|scripts|tests|triangulators"
NAMED = re.compile(rf"(?<!commit \w{{7}}, )`((?:{FOLDERS})/[\w./-]+)`(?! at commit)")


def read_boxes() -> list[tuple[str, set[str]]]:
    """Return (package, modules) of each box of the picture, from top to bottom."""
    groups = ET.parse(PICTURE).getroot().iter(f"{SVG}g")
    found = [(group.get("data-layer", ""), group) for group in groups]
    return [(layer, set(group.get("data-modules", "").split())) for layer, group in found]


def room_of(name: str) -> tuple[str, str]:
    """Return the package, and the part of it that a box names, of a dotted name of ours."""
    package, *rest = name.split(".")
    part = rest[0] if rest else ""
    place = ROOT / package / part
    known = bool(part) and (place.is_dir() or place.with_suffix(".py").exists())
    return package, part if known else "__init__"


def module_of(file: Path) -> tuple[str, str]:
    """Return the package, and the part of it that a box names, of a source file."""
    return room_of(".".join(file.relative_to(ROOT).with_suffix("").parts))


def named(file: Path) -> Iterator[str]:
    """Yield everything of ours that a file imports, wherever it does."""
    for node in ast.walk(ast.parse(file.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        yield from (name for name in names if name.partition(".")[0] in PACKAGES)


def imports(file: Path) -> Iterator[tuple[str, str]]:
    """Yield package and part of everything of ours that a file imports."""
    yield from (room_of(name) for name in named(file))


def room_graph() -> dict[tuple[str, str], set[tuple[str, str]]]:
    """Return, for each room, the others that its modules import from."""
    graph: dict[tuple[str, str], set[tuple[str, str]]] = {}
    for file in sources():
        source = module_of(file)
        graph.setdefault(source, set()).update(set(imports(file)) - {source})
    return graph


def import_graph() -> dict[str, set[str]]:
    """Return, for each module, those that it imports; a name stands for its module."""
    files = {}
    for file in sources():
        name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        files[name.removesuffix(".__init__")] = file
    return {
        module: {name if name in files else name.rpartition(".")[0] for name in named(file)}
        for module, file in files.items()
    }


def import_cycle(graph: dict[Any, set[Any]]) -> list[Any]:
    """Return modules or rooms that import each other around, or [] if there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def sources() -> list[Path]:
    return [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]


def test_every_module_is_in_one_box():
    drawn = [(layer, module) for layer, modules in read_boxes() for module in modules]
    assert len(drawn) == len(set(drawn))
    there = {module_of(file) for file in sources()} - {(name, "__init__") for name in PACKAGES}
    assert there == set(drawn)


def test_modules_import_from_their_own_box_and_below_only():
    level = {
        (layer, module): number
        for number, (layer, modules) in enumerate(read_boxes())
        for module in modules
    }
    upward = [
        f"{file.relative_to(ROOT)} imports {'.'.join(target)}"
        for file in sources()
        if (source := module_of(file)) in level
        for target in imports(file)
        if target in level and level[target] < level[source]
    ]
    assert upward == []


def test_modules_have_no_import_cycle():
    graph = import_graph()
    assert "harness.measuring.run" in graph["harness.commands.run"]
    assert set().union(*graph.values()) <= set(graph)
    assert import_cycle(graph) == []


def test_an_import_cycle_is_detected():
    graph = import_graph()
    graph["harness.results.run_folder"].add("harness.measuring.run")
    assert {"harness.results.run_folder", "harness.measuring.run"} <= set(import_cycle(graph))


def test_folders_have_no_import_cycle():
    graph = room_graph()
    assert ("triangulators", "geometry") in graph["triangulators", "methods"]
    assert import_cycle(graph) == []
    graph["triangulators", "geometry"].add(("triangulators", "methods"))
    assert ("triangulators", "methods") in import_cycle(graph)


def test_scenes_and_triangulators_import_only_themselves():
    for file in sources():
        package, _ = module_of(file)
        if package != "harness":
            assert {target for target, _ in imports(file)} <= {package}, file


def test_checker_and_search_share_only_definitions():
    """Only `certify` imports the checker; `starting` uses its edges for an initial solution."""
    shared = {"evidence", "units", "claims"}
    more = {"certify": {"checker"}, "initial": {"edges"}}
    for file in sources():
        if "checking" in file.parts:
            continue
        parts = [name.split(".") for name in named(file)]
        known = {part[2] for part in parts if part[:2] == ["triangulators", "checking"]}
        assert known <= shared | more.get(file.stem, set()), file
    of_checking = (name for file in sources() if "checking" in file.parts for name in named(file))
    assert not any(name.startswith("triangulators.certificate") for name in of_checking)


def test_the_picture_shows_the_modules_that_it_declares():
    groups = list(ET.parse(PICTURE).getroot().iter(f"{SVG}g"))
    assert len(groups) == len(read_boxes())
    for group, (_, modules) in zip(groups, read_boxes(), strict=True):
        words = set(re.findall(r"\w+", " ".join(group.itertext())))
        assert modules - {"__main__"} <= words


def test_files_named_in_pages_exist():
    """Files at a named commit are excluded."""
    texts = {page: " ".join(page.read_text(encoding="utf-8").split()) for page in pages()}
    named = {(page.name, name) for page, text in texts.items() for name in NAMED.findall(text)}
    assert len(named) > 50
    assert sorted(each for each in named if not (ROOT / each[1]).exists()) == []


def test_the_life_of_a_case_names_functions_that_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    steps = re.findall(r"^\|[^|]+\| `([\w/]+\.py)` \| `(\w+)` \|$", text, re.MULTILINE)
    assert len(steps) >= 10
    for file, name in steps:
        assert re.search(rf"\b(def|class) {name}\b", (ROOT / file).read_text()), (file, name)

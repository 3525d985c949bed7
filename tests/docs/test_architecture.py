"""Modules import only from their own box of the picture in docs/architecture.md and from below."""

import ast
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import pytest

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
    return [(g.get("data-layer", ""), set(g.get("data-modules", "").split())) for g in groups]


def find_box(name: str) -> tuple[str, str]:
    """Return the package and the folder or module, as boxes name it, of a dotted name."""
    package, *rest = name.split(".")
    part = rest[0] if rest else ""
    place = ROOT / package / part
    known = bool(part) and (place.is_dir() or place.with_suffix(".py").exists())
    return package, part if known else "__init__"


def find_box_of_file(file: Path) -> tuple[str, str]:
    return find_box(get_module(file))


def get_module(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts)


def read_imports(file: Path) -> Iterator[str]:
    """Yield the dotted names of our packages that a file imports, also in functions."""
    for node in ast.walk(ast.parse(file.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        yield from (name for name in names if name.partition(".")[0] in PACKAGES)


def read_box_imports(file: Path) -> set[tuple[str, str]]:
    """Return package and folder or module, as boxes name it, of each import of our packages."""
    return {find_box(name) for name in read_imports(file)}


def make_box_graph() -> dict[tuple[str, str], set[tuple[str, str]]]:
    """Return, for each folder or single module, those from which its modules import."""
    graph: dict[tuple[str, str], set[tuple[str, str]]] = {}
    for file in list_sources():
        source = find_box_of_file(file)
        graph.setdefault(source, set()).update(read_box_imports(file) - {source})
    return graph


def make_import_graph() -> dict[str, set[str]]:
    """Return the modules that each module imports; an imported name stands for its module."""
    files = {get_module(file).removesuffix(".__init__"): file for file in list_sources()}
    return {
        module: {name if name in files else name.rpartition(".")[0] for name in read_imports(file)}
        for module, file in files.items()
    }


def find_import_cycle(graph: dict[Any, set[Any]]) -> list[Any]:
    """Return a cycle of imports between modules or folders, or [] if there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def list_sources() -> list[Path]:
    return [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]


def test_every_module_is_in_one_box():
    drawn = [(layer, module) for layer, modules in read_boxes() for module in modules]
    assert len(drawn) == len(set(drawn))
    sources = {find_box_of_file(file) for file in list_sources()}
    assert sources - {(name, "__init__") for name in PACKAGES} == set(drawn)


def test_modules_import_from_their_own_box_and_below_only():
    level = {
        (layer, module): number
        for number, (layer, modules) in enumerate(read_boxes())
        for module in modules
    }
    upward = [
        f"{file.relative_to(ROOT)} imports {'.'.join(target)}"
        for file in list_sources()
        if (source := find_box_of_file(file)) in level
        for target in read_box_imports(file)
        if target in level and level[target] < level[source]
    ]
    assert upward == []


@pytest.mark.parametrize(
    ("make_graph", "importing", "imported"),
    [
        (make_import_graph, "harness.commands.run", "harness.measuring.run"),
        (make_box_graph, ("triangulators", "methods"), ("triangulators", "geometry")),
    ],
    ids=["modules", "folders"],
)
def test_there_is_no_import_cycle(make_graph, importing, imported):
    graph = make_graph()
    assert imported in graph[importing]
    assert set().union(*graph.values()) <= set(graph)
    assert find_import_cycle(graph) == []
    graph[imported].add(importing)
    assert {imported, importing} <= set(find_import_cycle(graph))


def test_scenes_and_triangulators_import_only_themselves():
    for file in list_sources():
        package, _ = find_box_of_file(file)
        if package != "harness":
            assert {target for target, _ in read_box_imports(file)} <= {package}, file


def test_checker_and_search_share_only_definitions():
    """Only `certify` imports the checker; `initial` imports its visible edges."""
    more = {"certify": {"checker"}, "initial": {"edges"}}
    for file in list_sources():
        if "checking" in file.parts:
            continue
        parts = [name.split(".") for name in read_imports(file)]
        known = {part[2] for part in parts if part[:2] == ["triangulators", "checking"]}
        assert known <= {"evidence"} | more.get(file.stem, set()), file
    for file in (ROOT / "triangulators" / "checking").glob("*.py"):
        names = read_imports(file)
        assert not any(name.startswith("triangulators.certificate") for name in names), file


def test_the_picture_shows_the_modules_that_it_declares():
    groups = ET.parse(PICTURE).getroot().iter(f"{SVG}g")
    for group, (_, modules) in zip(groups, read_boxes(), strict=True):
        words = set(re.findall(r"\w+", " ".join(group.itertext())))
        assert modules - {"__main__"} <= words


def test_files_named_in_pages_exist():
    """Every file named in a page exists, except files at a named commit."""
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

"""Examples in public docstrings run, and documented functions have examples and sections."""

import doctest
import importlib
import inspect
import pkgutil
import re
from pkgutil import resolve_name

import pytest

import scenes
import triangulators
from tests.paths import ROOT

OF_SCENES = [
    f"scenes.{name}" for name in ("fill", "repair", "projection", "registry", "scene", "spec")
]
WITH_EXAMPLES = [
    *("scenes", *OF_SCENES, "triangulators", "triangulators.many", "triangulators.polygon"),
    *("triangulators.certificate.certify", "triangulators.criteria", "triangulators.dropin"),
    *("triangulators.polygon_arrays", "triangulators.registry", "triangulators.verify"),
    "harness.metrics.statistics",
]
"""Modules with a documented interface; other modules of scenes are called by `load`."""
SCENE_MODULES = {module.name for module in pkgutil.walk_packages(scenes.__path__, "scenes.")}


@pytest.mark.parametrize("name", sorted({*WITH_EXAMPLES, *SCENE_MODULES}))
def test_examples_run(name):
    module = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0
    assert result.attempted > 0 or name not in WITH_EXAMPLES


def list_functions(name: str) -> list:
    module = importlib.import_module(name)
    functions = inspect.getmembers(module, inspect.isfunction)
    return [f for key, f in functions if key[0] != "_" and f.__module__ == name]


def test_public_functions_have_an_example():
    public = [getattr(triangulators, name) for name in triangulators.__all__]
    functions = [value for value in public if inspect.isfunction(value)]
    assert len(functions) > 6
    for name in OF_SCENES[:3]:
        functions += list_functions(name)
        assert list_functions(name)
    for function in functions:
        assert ">>>" in (inspect.getdoc(function) or ""), function.__qualname__


@pytest.mark.parametrize(
    "name", ["triangulators", "triangulators.criteria", "triangulators.dropin"]
)
def test_the_reference_has_every_public_name(name):
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    for public in importlib.import_module(name).__all__:
        module = f"{name}.errors" if public.endswith("Error") else name
        described = public in ("criteria", "CRITERIA") or f"\n### {module}.{public}\n" in page
        assert described, public


def test_documented_functions_have_numpydoc_sections():
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    names = re.findall(r"^### (\S+)$", page, re.MULTILINE)
    functions = [function for function in map(resolve_name, names) if inspect.isfunction(function)]
    assert len(functions) > 20
    for function in functions:
        signature, text = inspect.signature(function), inspect.getdoc(function) or ""
        assert not signature.parameters or "\nParameters\n---" in text, function
        assert signature.return_annotation in (None, "None") or "\nReturns\n---" in text, function
        for parameter in signature.parameters:
            assert re.search(rf"^[\w*, ]*\b{parameter}\b", text, re.MULTILINE), parameter

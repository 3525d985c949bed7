"""The examples in the public docstrings run, and every public function has one."""

import doctest
import importlib
import inspect
import pkgutil

import pytest

import scenes

MODULES = [
    "scenes",
    *(module.name for module in pkgutil.walk_packages(scenes.__path__, "scenes.")),
]
SHOWN = (
    *("cleaning.clean", "cleaning.projection"),
    *("registry", "spec"),
)
"""Modules that other code calls, function by function; the others are reached by `scenes.load`."""


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name):
    module = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0


@pytest.mark.parametrize("name", SHOWN)
def test_public_functions_have_an_example(name):
    module = importlib.import_module(f"scenes.{name}")
    functions = [
        function
        for own, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__ and not own.startswith("_")
    ]
    assert functions
    for function in functions:
        assert ">>>" in (inspect.getdoc(function) or ""), f"{name}.{function.__name__}"


def test_the_package_has_examples():
    assert doctest.testmod(scenes).attempted > 0

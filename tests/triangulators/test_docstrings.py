"""The examples in the public docstrings run, and every public function has one."""

import doctest
import importlib
import inspect

import pytest

import triangulators

MODULES = (
    "triangulators",
    "triangulators.batch.triangulate_many",
    "triangulators.certificate.certify",
    "triangulators.criteria.catalogue",
    "triangulators.dropin",
    "triangulators.polygon",
    "triangulators.registry",
    "triangulators.verify",
)


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name):
    module = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0
    assert result.attempted > 0


def test_public_functions_have_an_example():
    functions = [
        value
        for name in triangulators.__all__
        if inspect.isfunction(value := getattr(triangulators, name))
    ]
    assert len(functions) > 6
    for function in functions:
        assert ">>>" in inspect.getdoc(function), function.__qualname__

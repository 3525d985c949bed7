"""Triangulators by name: the built-in ones, entry points, and `module:function` strings."""

import difflib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pkgutil import resolve_name
from typing import Any, NamedTuple

import numpy as np

from triangulators import criteria
from triangulators.criteria import FLIP_TESTS
from triangulators.errors import Unavailable, UnknownName

ENTRY_POINTS = "raster_harness.triangulators"
Function = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Entry:
    """One triangulator.

    `function` is `module:function`; built-in functions take (boundary, **parameters),
    a third party's take the polygon. `criteria` says whether it is steered by a criterion, which is
    `default_criterion` where none is given, `tests` what else may stand in a criterion's place.
    `with_gap` is a function like `function` that also says how far the result may be from the
    optimum. `needs` is a module that must be importable, `install` the line that provides it.
    """

    name: str
    description: str
    function: str
    handles_holes: bool = True
    criteria: bool = False
    default_criterion: str = "overdraw"
    tests: tuple[str, ...] = ()
    with_gap: str | None = None
    needs: str | None = None
    install: str | None = None
    builtin: bool = True

    def available(self) -> str | None:
        """Return None if it can be used here, otherwise the line that installs what is missing."""
        if self.needs is None:
            return None
        if ":" in self.needs:
            probe = load(self.needs)
            return None if probe() else self.install
        return None if importlib.util.find_spec(self.needs) else self.install

    def load(self) -> Function:
        """Import and return the function.

        Raises `Unavailable` with the install line, and `UnknownName` where a third party's module
        has no such function, or cannot be imported.
        """
        missing = self.available()
        if missing:
            raise Unavailable(f"triangulator {self.name!r} is not available; install: {missing}")
        try:
            function = load(self.function)
        except (ImportError, AttributeError, ValueError) as error:
            hint = _hint(self.function.partition(":")[0])
            raise UnknownName(f"triangulator {self.function!r}: {error}{hint}") from error
        if not callable(function):
            raise UnknownName(f"triangulator {self.function!r}: not a function")
        return function


def _ours(
    name: str, description: str, where: str = "", *, holes: bool = True, **more: Any
) -> Entry:
    """Return a triangulator of `methods`; where: "module:function", or as `name` is."""
    place = f"triangulators.methods.{where or f'{name}:triangulate'}"
    return Entry(name, description, place, handles_holes=holes, **more)


def _library(name: str, description: str, **more: Any) -> Entry:
    place = f"triangulators.libraries:{name.replace('-', '_')}"
    return Entry(name, description, place, **more)


BUILTIN = {
    entry.name: entry
    for entry in (
        _ours("fan", "a fan from a vertex that sees the whole polygon", "simple:fan", holes=False),
        _ours(
            "strip",
            "a zigzag of diagonals, where some start allows it",
            "simple:strip",
            holes=False,
        ),
        _library("ear-clipping", "mapbox_earcut"),
        _library("delaunay", "constrained Delaunay triangulation (GEOS, through shapely)"),
        _library(
            "sweep",
            "sweep line into monotone pieces (GLU tessellator, through PyOpenGL)",
            needs="triangulators.libraries:sweep_installed",
            install="apt-get install libglu1-mesa; pip install PyOpenGL",
        ),
        _library(
            "manifold",
            "manifold3d's ear clipping",
            needs="manifold3d",
            install="pip install manifold3d",
        ),
        _ours(
            "max-area", "largest triangle first (Persson 2009)", "simple:largest_first", holes=False
        ),
        _ours("greedy", "shortest diagonals first", "simple:greedy"),
        _ours(
            "random",
            "uniform over all triangulations, by counting; seed=",
            "counting:draw",
            holes=False,
        ),
        _ours(
            "pareto",
            "a point of the Pareto front of A and D, by its number from the least A on; k=",
            holes=False,
        ),
        _ours(
            "listed",
            "one of all that the paper's method lists, by its number from the least A on; k=",
            "exhaustive:triangulate_listed",
            holes=False,
        ),
        _ours(
            "exhaustive",
            "the best of all triangulations, every one listed (the paper's method)",
            holes=False,
            criteria=True,
        ),
        _ours(
            "earcut-refine",
            "ear clipping, then flips to Delaunay, as refine() of npm's earcut 3.2.4 makes them",
            "flips:triangulate_as_earcut",
        ),
        _ours(
            "flips",
            "ear clipping, then flips: by l1, euclidean, delaunay or a criterion; l1 by default",
            criteria=True,
            default_criterion="l1",
            tests=FLIP_TESTS,
        ),
        _ours(
            "refined",
            "the better of flips from ear clipping and from Delaunay, half-perimeter by default",
            "flips:triangulate_refined",
            criteria=True,
            default_criterion="half-perimeter",
        ),
        _ours(
            "optimal",
            "the minimum of a criterion: exact up to 2,000 vertices, with holes nearly always;"
            " beyond by search",
            criteria=True,
            with_gap="triangulators.methods.optimal:triangulate_with_gap",
        ),
        _ours(
            "worst",
            "the maximum of a criterion: exact up to 2,000 vertices without holes; else by search",
            "optimal:triangulate_worst",
            criteria=True,
        ),
    )
}


ALIASES = {"earcut": "ear-clipping"}
"""Other names that people know triangulators by."""


class Choice(NamedTuple):
    """A triangulator as written on the command line: an entry and, if it takes one, a criterion."""

    entry: Entry
    criterion: str | None

    @property
    def full_name(self) -> str:
        """`name` or `name:criterion`, the criterion always written out."""
        return f"{self.entry.name}:{self.criterion}" if self.criterion else self.entry.name


@cache
def load(reference: str) -> Function:
    """Import what "module:function" names."""
    function: Function = resolve_name(reference)
    return function


@cache
def _third_party() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=ENTRY_POINTS)}


def names(*, available_only: bool = False) -> list[str]:
    """Return the names of all triangulators, built-in first, then those of entry points.

    >>> names()[:3]
    ['fan', 'strip', 'ear-clipping']
    """
    everything = [*BUILTIN, *(name for name in _third_party() if name not in BUILTIN)]
    if available_only:
        return [name for name in everything if find(name).available() is None]
    return everything


def find(name: str) -> Entry:
    """Return the entry called `name` or given as `module:function`; raises `UnknownName`.

    A third party's module is not imported before `Entry.load`.

    >>> find("fan").handles_holes
    False
    """
    name = ALIASES.get(name, name)
    if name in BUILTIN:
        return BUILTIN[name]
    if name in _third_party():
        point = _third_party()[name]
        return Entry(name, f"from {point.value}", point.value, builtin=False)
    if ":" in name:  # imported when it is loaded: it may do anything
        return Entry(name, f"user's function {name}", name, builtin=False)
    raise UnknownName(f"unknown triangulator {name!r}{_hint(name)} (known: {', '.join(names())})")


def _hint(name: str) -> str:
    near = difflib.get_close_matches(name, names(), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def parse(text: str) -> Choice:
    """Read `name` or `name:criterion` (or `module:function`, as `find`); raises `UnknownName`.

    >>> parse("optimal").criterion
    'overdraw'
    """
    name, _, criterion = text.partition(":")
    name = ALIASES.get(name, name)
    if name not in BUILTIN:
        return Choice(find(text), None)
    entry = BUILTIN[name]
    if not entry.criteria:
        if criterion:
            raise UnknownName(f"triangulator {name!r} takes no criterion, got {criterion!r}")
        return Choice(entry, None)
    wanted = criterion or entry.default_criterion
    return Choice(entry, wanted if wanted in entry.tests else criteria.find(wanted).name)


def full_name(text: str) -> str:
    """Return the full name: `optimal` is `optimal:overdraw`, `optimal:mixed=1.0/.5/0` is
    `optimal:mixed=1/0.5/0`; raises `UnknownName`.

        >>> full_name("optimal")
        'optimal:overdraw'
    """
    return parse(text).full_name

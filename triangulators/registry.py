"""Triangulators by name: built-in names, entry points, and `module:function` strings."""

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
from triangulators.errors import ArgumentError, UnavailableError, UnknownNameError, suggest
from triangulators.geometry.order import is_walk

ENTRY_POINTS = "raster_harness.triangulators"
Function = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Entry:
    """A registered triangulator."""

    name: str
    description: str
    function: str  # "module:function"; of (boundary, **parameters) if built-in, else of a polygon
    handles_holes: bool = True
    criteria: bool = False  # a criterion can follow the name, as in "optimal:overdraw"
    default_criterion: str = "overdraw"
    tests: tuple[str, ...] = ()  # flip tests that can follow the name, as in "flips:l1"
    with_gap: str | None = None  # "module:function" that returns (triangles, gap to the optimum)
    needs: str | None = None  # a module to import, or a "module:function" that must return True
    install: str | None = None
    builtin: bool = True
    order: str = "native"  # default order: "walk" from neighbour to neighbour, or "native"

    def uses_walk(self, order: str | None) -> bool:
        """Return whether to put triangles in walk order; None is the entry's default order."""
        return is_walk(self.order if order is None else order)

    def find_install_command(self) -> str | None:
        """Return the command that installs a missing package, or None if none is missing."""
        if self.needs is None:
            return None
        if ":" in self.needs:
            probe = load(self.needs)
            return None if probe() else self.install
        return None if importlib.util.find_spec(self.needs) else self.install

    def load(self) -> Function:
        """Import the triangulator's function; raise `UnavailableError` if a package is missing."""
        missing = self.find_install_command()
        if missing:
            raise UnavailableError(
                f"triangulator {self.name!r} is not available; install: {missing}"
            )
        try:
            function = load(self.function)
        except (ImportError, AttributeError, ValueError) as error:
            module = self.function.partition(":")[0]
            hint = suggest(module, names(), fallback="check the name and PYTHONPATH")
            raise UnknownNameError(f"triangulator {self.function!r}: {error}; {hint}") from error
        if not callable(function):
            raise UnknownNameError(
                f"triangulator {self.function!r}: not a function; give module:function"
            )
        return function


def _make_method_entry(
    name: str, description: str, reference: str = "", *, holes: bool = True, **fields: Any
) -> Entry:
    """Return an entry for "module:function" in `methods`, by default for "NAME:triangulate"."""
    function = f"triangulators.methods.{reference or f'{name}:triangulate'}"
    return Entry(name, description, function, handles_holes=holes, **fields)


def _make_library_entry(name: str, description: str, **fields: Any) -> Entry:
    function = f"triangulators.libraries:{name.replace('-', '_')}"
    return Entry(name, description, function, **fields)


BUILTIN = {
    entry.name: entry
    for entry in (
        _make_method_entry(
            "fan",
            "all triangles at one vertex, which sees the whole polygon",
            "simple:triangulate_fan",
            holes=False,
        ),
        _make_method_entry(
            "strip",
            "a triangle strip: a zigzag of diagonals, if one is inside the polygon",
            "simple:triangulate_strip",
            holes=False,
        ),
        _make_library_entry("ear-clipping", "ear clipping by mapbox_earcut"),
        _make_library_entry(
            "delaunay", "constrained Delaunay triangulation (GEOS, through shapely)"
        ),
        _make_library_entry(
            "sweep",
            "sweep line into monotone pieces (GLU tessellator, through PyOpenGL)",
            needs="triangulators.libraries:is_sweep_installed",
            install="apt-get install libglu1-mesa; pip install PyOpenGL",
        ),
        _make_library_entry(
            "manifold",
            "ear clipping by manifold3d",
            needs="manifold3d",
            install="pip install manifold3d",
        ),
        _make_method_entry(
            "max-area",
            "the largest triangle, then the largest in each remaining polygon (Persson 2009)",
            "simple:triangulate_largest_first",
            holes=False,
        ),
        _make_method_entry(
            "greedy",
            "the shortest diagonal, then always the shortest that crosses none",
            "simple:triangulate_greedy",
        ),
        _make_method_entry(
            "random",
            "a random triangulation, all being equally likely; parameter seed",
            "exhaustive:draw_triangulation",
            holes=False,
        ),
        _make_method_entry(
            "pareto",
            "point k of the Pareto front of overdraw and shape, by ascending overdraw; parameter k",
            holes=False,
        ),
        _make_method_entry(
            "listed",
            "triangulation k of the paper's list, by ascending overdraw; parameter k",
            "exhaustive:triangulate_listed",
            holes=False,
        ),
        _make_method_entry(
            "exhaustive",
            "the minimum of a criterion, by listing all triangulations (the paper's method)",
            holes=False,
            criteria=True,
        ),
        _make_method_entry(
            "earcut-refine",
            "ear clipping, then the Delaunay flips of refine() in npm's earcut 3.2.4",
            "flips:triangulate_as_earcut",
            order="walk",
        ),
        _make_method_entry(
            "flips",
            "ear clipping, then flips by l1 (the default), euclidean, delaunay or a criterion",
            criteria=True,
            default_criterion="l1",
            tests=FLIP_TESTS,
            order="walk",
        ),
        _make_method_entry(
            "refined",
            "ear clipping, improved by flips for half-perimeter (the default) and edge-length, by"
            " exactly optimised windows for other criteria",
            "flips:triangulate_refined",
            criteria=True,
            default_criterion="half-perimeter",
        ),
        _make_method_entry(
            "optimal",
            "the minimum of a criterion: exact up to 2,000 vertices, with holes almost always;"
            " otherwise by local search",
            criteria=True,
            with_gap="triangulators.methods.optimal:triangulate_with_gap",
        ),
        _make_method_entry(
            "worst",
            "the maximum of a criterion: exact up to 2,000 vertices without holes; otherwise by"
            " local search",
            "optimal:triangulate_worst",
            criteria=True,
        ),
    )
}


ALIASES = {"earcut": "ear-clipping"}  # common alternative names of triangulators


class Choice(NamedTuple):
    """A triangulator's parsed name: the entry, and a criterion, a flip test or None."""

    entry: Entry
    criterion: str | None

    @property
    def full_name(self) -> str:
        """`name` or `name:criterion`, including a default criterion."""
        return f"{self.entry.name}:{self.criterion}" if self.criterion else self.entry.name


@cache
def load(reference: str) -> Function:
    """Import and return the function that "module:function" names."""
    function: Function = resolve_name(reference)
    return function


@cache
def _find_third_party_entry_points() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=ENTRY_POINTS)}


def names(*, available_only: bool = False) -> list[str]:
    """Return the names of all triangulators, built-in names first, then entry points.

    Parameters
    ----------
    available_only
        Omit triangulators whose package is not installed.

    Returns
    -------
    list of str
        Names for `find` and `triangulate`.

    Examples
    --------
    >>> names()[:3]
    ['fan', 'strip', 'ear-clipping']
    """
    registered = [
        *BUILTIN,
        *(name for name in _find_third_party_entry_points() if name not in BUILTIN),
    ]
    if available_only:
        return [name for name in registered if find(name).find_install_command() is None]
    return registered


def find(name: str) -> Entry:
    """Return the entry of a triangulator; third-party modules are imported by `Entry.load` only.

    Parameters
    ----------
    name
        A name without a criterion, or "module:function".

    Returns
    -------
    Entry
        Its description, its function, and the polygons that it supports.

    Raises
    ------
    UnknownNameError
        If there is no such triangulator.

    Examples
    --------
    >>> find("fan").handles_holes
    False
    """
    name = ALIASES.get(name, name)
    if name in BUILTIN:
        return BUILTIN[name]
    if name in _find_third_party_entry_points():
        point = _find_third_party_entry_points()[name]
        return Entry(name, f"from {point.value}", point.value, builtin=False)
    if ":" in name:
        return Entry(name, f"user's function {name}", name, builtin=False)
    raise UnknownNameError(f"unknown triangulator {name!r}; {suggest(name, names())}")


def parse(text: str) -> Choice:
    """Split a triangulator's name into the registered triangulator and the criterion.

    Parameters
    ----------
    text
        "name", "name:criterion" or "module:function". Without a criterion, a triangulator that
        takes one gets its default criterion.

    Returns
    -------
    Choice
        The entry, and the criterion's name or None.

    Raises
    ------
    UnknownNameError
        If there is no such triangulator or criterion.
    ArgumentError
        If the criterion's weights are invalid, or the triangulator takes no criterion.

    Examples
    --------
    >>> parse("optimal").criterion
    'overdraw'
    """
    name, criterion = _split_name(text)
    if name not in BUILTIN:
        return Choice(find(text), None)
    entry = BUILTIN[name]
    if not entry.criteria:
        check_criterion(name, criterion or None)
        return Choice(entry, None)
    criterion = criterion or entry.default_criterion
    return Choice(entry, criterion if criterion in entry.tests else criteria.find(criterion).name)


def _split_name(text: str) -> tuple[str, str]:
    """Split "name:criterion" into the registered name and the criterion, "" if there is none."""
    if not isinstance(text, str):
        raise ArgumentError(f"triangulator: expected a name, got {type(text).__name__}")
    name, _, criterion = text.partition(":")
    return ALIASES.get(name, name), criterion


def check_criterion(text: str, criterion: Any) -> None:
    """Raise `ArgumentError` unless a name permits an additional criterion."""
    name, in_name = _split_name(text)
    if name not in BUILTIN or criterion is None:
        return
    if not BUILTIN[name].criteria:
        raise ArgumentError(f"triangulator {name!r}: takes no criterion (got {criterion!r})")
    if in_name:
        raise ArgumentError(
            f"triangulator {text!r}: criterion given twice ({in_name!r} in the name, "
            f"{criterion!r} as an argument); give only one"
        )


def full_name(text: str) -> str:
    """Return a triangulator's full name, with the criterion and the shortest form of weights.

    Parameters
    ----------
    text
        As for `parse`.

    Returns
    -------
    str
        The canonical name.

    Raises
    ------
    UnknownNameError, ArgumentError
        As `parse`.

    Examples
    --------
    >>> full_name("optimal"), full_name("optimal:mixed=1.0/.5/0")
    ('optimal:overdraw', 'optimal:mixed=1/0.5/0')
    """
    return parse(text).full_name

"""Triangulators of a run: values parsed from `name:criterion#number@0`.

random#7                the random triangulation of seed 7, whatever the seed of the run
pareto#3, listed#3      index 3, from 0, of each polygon's Pareto front, or of its list
optimal:overdraw@0      triangulated at rotation 0 and drawn at the rotation of the view, as in a
                        program that triangulates once and then moves its camera
module:function         a third-party triangulator, imported only by a worker process
BASE fan                `fan` of another version of the code, the interleaved baseline
original                the triangles in a model's file
"""

import importlib.util
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

import triangulators
from harness.errors import UsageError
from harness.machine.user_modules import allow_user_module
from harness.results.record import BASE_MARK, NUMBER_MARK, UPRIGHT_MARK, full_name
from triangulators import criteria, registry
from triangulators.errors import TriangulationError, suggest, summarize_error
from triangulators.polygon_arrays import PolygonArray

NUMBERED = {"random": "seed", "pareto": "k", "listed": "k"}
"""Triangulators with a number, and the name of that parameter."""

ORIGINAL = "original"
"""The triangles in a model's file: nothing is computed."""

CALIBRATED = ":calibrated"
FUNCTION = re.compile(r"[^\W\d][\w.]*:[^\W\d][\w.]*")
"""Name of a third-party triangulator, a function of a module."""


@dataclass(frozen=True)
class Recipe:
    """All parameters of a triangulation except the polygon.

    base : name for `triangulators.triangulate`, with its criterion, or "module:function"
    number : number after the name, or None
    seed : the run's seed, for a random triangulator without a number
    upright : whether polygons are triangulated at rotation 0, and then rotated
    calibration : (term, coefficient) pairs of the criterion `calibrated`
    other : whether another version of the code triangulates
    """

    base: str
    number: int | None = None
    seed: int = 0
    upright: bool = False
    calibration: tuple[tuple[str, float], ...] | None = None
    other: bool = False

    def __str__(self) -> str:
        """The full name: a record's `triangulator`."""
        mark = BASE_MARK if self.other else ""
        return mark + full_name(self.base, self.number, upright=self.upright)

    @property
    def builtin(self) -> bool:
        """Whether it is a built-in triangulator of this version."""
        name = self.base.partition(":")[0]
        return (self.base == ORIGINAL or name in registry.BUILTIN) and not self.other

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters other than base and polygon, JSON-ready."""
        if self.calibration is not None:
            return {"calibration": [list(term) for term in self._weights]}
        if self.number is not None:
            return {NUMBERED[self.base]: self.number}
        return {"seed": self.seed} if self.base == "random" else {}

    @property
    def _weights(self) -> tuple[tuple[str, float], ...]:
        # The cost of a draw does not depend on the triangulation, so no criterion has that term.
        return tuple(term for term in self.calibration or () if term[0] != "draw")

    @property
    def _call(self) -> tuple[str, dict[str, Any]]:
        """Name and keyword arguments for `triangulators.triangulate`."""
        if self.calibration is not None:
            calibrated = criteria.calibrated(dict(self._weights))
            return self.base.removesuffix(CALIBRATED), {"criterion": calibrated}
        return self.base, self.parameters

    def load(self) -> None:
        """Import the triangulator, which runs third-party code.

        Raises
        ------
        UsageError
            if there is no such function, or importing it raises an `Exception`
        """
        try:
            registry.find(self.base if not self.builtin else self.base.partition(":")[0]).load()
        except TriangulationError as error:
            raise UsageError(str(error)) from error
        except Exception as error:
            raise UsageError(
                f"triangulator '{self}' cannot be loaded: {summarize_error(error)}"
            ) from error

    def attempt(
        self, polygons: PolygonArray
    ) -> tuple[Sequence[NDArray[np.int32]], NDArray[np.bool_]]:
        """Return triangles (m, 3) of each polygon of a batch, and which (p,) are any good.

        On one thread. The others are left to `triangulate`, and all of them for third parties.
        """
        if not self.builtin:
            return [], np.zeros(len(polygons), np.bool_)
        from triangulators.many import attempt_many  # where it is run

        name, arguments = self._call
        batch = attempt_many(polygons, name, threads=1, **arguments)
        return batch, batch.compiled

    def triangulate(self, polygon: Polygon) -> NDArray[np.int32]:
        """Return (m, 3) triangles; raises what `triangulators.triangulate` raises."""
        return self.triangulate_with_gap(polygon)[0]

    def gap_of_cached(self, vertices: int) -> float | None:
        """Return the gap of cached triangles of a polygon: only proven optima are cached.

        Of polygons that are too large for a proof by `optimal`, all are cached.
        """
        name = self.base.partition(":")[0]
        if name not in registry.BUILTIN or registry.BUILTIN[name].with_gap is None:
            return None
        from triangulators.methods.optimal import LIMIT  # where it is run

        return 0.0 if vertices <= LIMIT else math.inf

    def triangulate_with_gap(self, polygon: Polygon) -> tuple[NDArray[np.int32], float | None]:
        """Return what `triangulators.triangulate_with_gap` does, and raise what it raises."""
        name, arguments = self._call
        return triangulators.triangulate_with_gap(polygon, name, **arguments)


def parse(text: str, *, seed: int = 0, calibration: Mapping[str, float] | None = None) -> Recipe:
    """Read the name of a triangulator; nothing of third parties is imported.

    calibration : a device's coefficients, by term

    Raises
    ------
    UsageError
        if it is unknown
    """
    rest = text.removesuffix(UPRIGHT_MARK)
    base, mark, digits = rest.partition(NUMBER_MARK)
    if "@" in rest:
        raise UsageError(f"triangulator '{text}': only {UPRIGHT_MARK} can follow a name")
    if mark and not (base in NUMBERED and digits.isdecimal()):
        raise UsageError(
            f"triangulator '{text}': a seed is written random{NUMBER_MARK}7, "
            f"a point of the Pareto front pareto{NUMBER_MARK}3"
        )
    if rest == ORIGINAL:
        return Recipe(ORIGINAL)
    if base.partition(":")[0] in registry.BUILTIN or ":" not in base:
        try:
            base = registry.full_name(base)
        except TriangulationError as error:
            raise UsageError(str(error)) from error
    else:
        _require_module(base)
    number = int(digits) if mark else 0 if base == "pareto" else None
    terms = None
    if base.endswith(CALIBRATED) and calibration is not None:
        terms = tuple(sorted(calibration.items()))
    return Recipe(
        base=base,
        number=number,
        seed=seed if base == "random" and number is None else 0,
        upright=text.endswith(UPRIGHT_MARK),
        calibration=terms,
    )


def parse_all(
    texts: Iterable[str], *, seed: int = 0, calibration: Mapping[str, float] | None = None
) -> tuple[Recipe, ...]:
    """Read names of triangulators, each once; raises as `parse` does, and if there is none."""
    recipes = [parse(text, seed=seed, calibration=calibration) for text in texts]
    if not recipes:
        raise UsageError("no triangulator is named; give --triangulators fan,ear-clipping")
    return tuple(dict.fromkeys(recipes))


def _require_module(reference: str) -> None:
    """Refuse what cannot be a function of a module that is here; imports nothing.

    Raises UsageError also as `allow_user_module` does.
    """
    allow_user_module(reference)
    # Of a module inside a package nothing can be told without importing the package.
    package = reference.partition(":")[0].partition(".")[0]
    if FUNCTION.fullmatch(reference) and importlib.util.find_spec(package) is not None:
        return
    name = reference.partition(":")[0]
    # A module's name need not be like a triangulator's: only what is all but one is hinted at.
    otherwise = "a module lies in the folder you are in, or is installed"
    hint = suggest(name, registry.names(), cutoff=0.75, fallback=otherwise)
    raise UsageError(f"unknown triangulator '{reference}': there is no module '{name}'; {hint}")

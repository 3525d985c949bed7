"""Triangulators of a run: values parsed from `name:criterion#number@0`.

random#7                the random triangulation of seed 7, independent of the run's seed
pareto#3, listed#3      index 3, from 0, of each polygon's Pareto front or list
optimal:overdraw@0      triangulated at rotation 0 and drawn at the rotation of the view, as in a
                        program that triangulates once and then moves the camera
module:function         a third-party triangulator, imported only by a worker process
BASE fan                `fan` of another version of the code, the interleaved baseline
original                the triangles in a model's file
"""

import importlib.util
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

import triangulators
from harness.errors import UsageError
from harness.machine.process import FUNCTION, allow_user_module
from harness.results.record import BASE_MARK, NUMBER_MARK, UPRIGHT_MARK, format_full_name
from triangulators import criteria, registry
from triangulators.errors import TriangulationError, suggest, summarize_error
from triangulators.polygon_arrays import PolygonArray

NUMBERED = {"random": "seed", "pareto": "k", "listed": "k"}  # parameter that the number sets
ORIGINAL = "original"  # name of the triangles in a model's file

CALIBRATED = ":calibrated"


@dataclass(frozen=True)
class Recipe:
    """All parameters of a triangulation except the polygon.

    base : name for `triangulators.triangulate`, with criterion, or "module:function"
    seed : the run's seed, for a random triangulator without a number
    upright : True to triangulate polygons at rotation 0, and then rotate them
    calibration : (term, coefficient) pairs of the criterion `calibrated`
    other : True if the interleaved baseline triangulates
    """

    base: str
    number: int | None = None
    seed: int = 0
    upright: bool = False
    calibration: tuple[tuple[str, float], ...] | None = None
    other: bool = False

    def __str__(self) -> str:
        """Return the full name, which records have as `triangulator`."""
        mark = BASE_MARK if self.other else ""
        return mark + format_full_name(self.base, self.number, upright=self.upright)

    @property
    def builtin(self) -> bool:
        """True for a built-in triangulator of this version."""
        name = self.base.partition(":")[0]
        return (self.base == ORIGINAL or name in registry.BUILTIN) and not self.other

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters other than base and polygon, JSON-ready."""
        if self.calibration is not None:
            # No criterion has the cost of a draw, as it does not depend on the triangulation.
            terms = [[name, cost] for name, cost in self.calibration if name != "draw"]
            return {"calibration": terms}
        if self.number is not None:
            return {NUMBERED[self.base]: self.number}
        return {"seed": self.seed} if self.base == "random" else {}

    @property
    def _call(self) -> tuple[str, dict[str, Any]]:
        if self.calibration is not None:
            calibrated = criteria.calibrated(dict(self.parameters["calibration"]))
            return self.base.removesuffix(CALIBRATED), {"criterion": calibrated}
        return self.base, self.parameters

    def load(self) -> None:
        """Import the triangulator, which runs third-party code; raise UsageError on failure."""
        try:
            registry.find(self.base if not self.builtin else self.base.partition(":")[0]).load()
        except TriangulationError as error:
            raise UsageError(str(error)) from error
        except Exception as error:
            raise UsageError(
                f"triangulator '{self}' cannot be loaded: {summarize_error(error)}"
            ) from error

    def triangulate_batch(
        self, polygons: PolygonArray
    ) -> tuple[Sequence[NDArray[np.int32]], NDArray[np.bool_]]:
        """Triangulate together, on one thread, those polygons that compiled code can solve.

        Returns triangles (m, 3) of each polygon, and flags (p,) of the solved polygons.
        """
        if not self.builtin:
            return [], np.zeros(len(polygons), np.bool_)
        from triangulators.many import triangulate_supported  # compiled code

        name, arguments = self._call
        batch = triangulate_supported(polygons, name, threads=1, **arguments)
        return batch, batch.compiled

    def get_batch_gap(self, vertices: int) -> float | None:
        """Return the gap of a polygon that `triangulate_batch` solved; None without gaps.

        A batch has only optima up to `LIMIT` vertices; beyond, the gap is unknown (infinite).
        """
        if registry.BUILTIN[self.base.partition(":")[0]].with_gap is None:
            return None
        from triangulators.methods.optimal import LIMIT  # compiled code

        return 0.0 if vertices <= LIMIT else math.inf

    def triangulate_with_gap(self, polygon: Polygon) -> tuple[NDArray[np.int32], float | None]:
        """Return triangles and gap, as `triangulators.triangulate_with_gap` does."""
        name, arguments = self._call
        return triangulators.triangulate_with_gap(polygon, name, **arguments)


def parse(text: str, *, seed: int = 0, calibration: Mapping[str, float] | None = None) -> Recipe:
    """Parse a triangulator's name, without importing third-party code, or raise UsageError."""
    stem = text.removesuffix(UPRIGHT_MARK)
    base, mark, digits = stem.partition(NUMBER_MARK)
    if "@" in stem:
        raise UsageError(
            f"triangulator '{text}': only {UPRIGHT_MARK} can follow a name, as in fan{UPRIGHT_MARK}"
        )
    if mark and not (base in NUMBERED and digits.isdecimal()):
        raise UsageError(
            f"triangulator '{text}': invalid number; write a seed as random{NUMBER_MARK}7, a point "
            f"of the Pareto front as pareto{NUMBER_MARK}3"
        )
    if stem == ORIGINAL:
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
    """Return distinct recipes; raise as `parse` does, and if `texts` is empty."""
    recipes = [parse(text, seed=seed, calibration=calibration) for text in texts]
    if not recipes:
        raise UsageError("--triangulators: no name; give e.g. --triangulators fan,ear-clipping")
    return tuple(dict.fromkeys(recipes))


def _require_module(reference: str) -> None:
    """Raise UsageError unless the module of "module:function" exists, without importing it."""
    allow_user_module(reference)
    # Only the package is checked: finding a module inside would import the package.
    package = reference.partition(":")[0].partition(".")[0]
    if FUNCTION.fullmatch(reference) and importlib.util.find_spec(package) is not None:
        return
    name = reference.partition(":")[0]
    # A high cutoff, as names of modules may resemble names of triangulators by chance.
    fallback = "the module must be in the current folder or installed"
    hint = suggest(name, registry.names(), cutoff=0.75, fallback=fallback)
    raise UsageError(f"unknown triangulator '{reference}': no module '{name}'; {hint}")

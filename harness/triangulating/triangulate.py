"""Triangulation of polygons from the cache, in one batch, or one by one; times of triangulators.

`triangulate_many` runs third-party triangulators in a worker process: if one crashes or returns an
invalid triangulation, only that polygon fails.
"""

import logging
import multiprocessing
import traceback
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, box

import triangulators
from harness.machine.system import cpu_clock
from harness.triangulating.database import CacheLookup
from harness.triangulating.recipes import Recipe, parse
from triangulators.criteria import predict_many
from triangulators.errors import MAX_TRACEBACK, SkippedError, format_error, truncate
from triangulators.polygon_arrays import PolygonArray, Triangulations, offsets_of
from triangulators.verify import find_unconfirmed, verify

_LOG = logging.getLogger(__name__)

MAX_CRASHES = 10  # crashing polygons to single out; further crashing parts fail as a unit

Rows = NDArray[np.int32]
Columns = dict[str, NDArray[np.float64]]
"""Triangles (m, 3), rows of three vertex indices; values per polygon, (p,), by name."""


@dataclass
class FrameTriangulation:
    """Result of one triangulator for the polygons of a frame.

    parts : for each polygon the (m, 3) triangles, or None without triangles
    seconds : CPU time without checks and compilation; for `cached` polygons the stored time
    samples_s : `seconds` of several interleaved rounds; [] if timed once
    skipped, failed : (polygon number in the frame, reason)
    t_junctions : for each polygon, the number of vertices inside an edge of a triangle
    cached : number of polygons read from the model database
    gaps : for optima, for each polygon with triangles, the maximum relative excess over the minimum
        cost: 0 if proven optimal, infinite if unknown
    predicted : (p,) sums of each criterion over each polygon's triangles; lengths in px, areas px^2
    notes : messages about the model database
    trace : traceback of the first error in a triangulator's code, or ""
    """

    parts: list[Rows | None] = field(default_factory=list)
    seconds: float = 0.0
    samples_s: list[float] = field(default_factory=list)
    skipped: list[tuple[int, str]] = field(default_factory=list)
    failed: list[tuple[int, str]] = field(default_factory=list)
    t_junctions: list[int] = field(default_factory=list)
    cached: int = 0
    gaps: list[float] = field(default_factory=list)
    predicted: Columns = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    trace: str = ""

    @property
    def conforming(self) -> bool:
        """True if no polygon's triangulation has a T-junction."""
        return not any(self.t_junctions)

    @property
    def drawn(self) -> NDArray[np.bool_]:
        """Flags (p,) of polygons with triangles."""
        return np.array([part is not None for part in self.parts], np.bool_)

    def add(self, part: Rows | None, junctions: int = 0, problem: str = "") -> None:
        """Add the triangles of the next polygon with the number of T-junctions, or the problem."""
        if problem:
            self.failed.append((len(self.parts), problem))
        self.parts.append(None if problem else part)
        self.t_junctions.append(junctions)


def sum_criteria_per_polygon(polygons: PolygonArray, parts: Sequence[Rows | None]) -> Columns:
    """Return each criterion's sum over each polygon's triangles (m, 3), (p,) by column."""
    if not len(polygons):
        return {}
    empty = np.empty((0, 3), np.int32)
    rows = [empty if part is None else part for part in parts]
    offsets = offsets_of([len(part) for part in rows])
    return predict_many(polygons.coords, polygons.vertex_offsets, np.concatenate(rows), offsets)


def check_triangles(polygon: Polygon, triangles: Rows) -> tuple[int, str]:
    """Return the number of T-junctions, and "" if the triangulation is valid, else its problems."""
    result = verify(polygon, triangles)
    return (len(result.t_junctions), "") if result.ok else (0, "; ".join(result.problems[:3]))


LARGE_VERTICES, LARGE_HOLES = 50_000, 5_000  # from there on, ear clipping takes more than 5 s


def describe_large_polygon(polygons: Sequence[Polygon] | NDArray[Any]) -> str:
    """Return a line about the first polygon that takes long, or ""."""
    geometries = np.asarray(polygons, dtype=object)
    vertices = shapely.get_num_coordinates(geometries)
    holes = shapely.get_num_interior_rings(geometries)
    large = np.flatnonzero((vertices >= LARGE_VERTICES) | (holes >= LARGE_HOLES))
    if not len(large):
        return ""
    index = large[0]
    return (
        f"polygon {index} has {vertices[index]:,} vertices and {holes[index]:,} holes; ear "
        "clipping takes time quadratic in both, Delaunay and the test of validity up to quadratic: "
        "minutes to hours; Ctrl-C stops"
    )


def triangulate_polygons(
    recipe: Recipe, polygons: Sequence[Polygon], database: Path | None = None
) -> FrameTriangulation:
    """Triangulate polygons in px; a failure on a polygon is stored in the result, not raised.

    All triangles are verified. Invalid triangles from the cache, which only built-in triangulators
    use, or from a batch are computed again, one polygon at a time.
    """
    arrays = polygons if isinstance(polygons, PolygonArray) else PolygonArray.from_shapely(polygons)
    result = FrameTriangulation()
    cache_file = database if recipe.builtin else None
    with CacheLookup(cache_file, recipe.base, recipe.parameters) as cache:
        cached = cache.find(arrays)
        if None in cached:
            warm_up(recipe)
        triangles = {k: timed.triangles for k, timed in enumerate(cached) if timed is not None}
        missing = [k for k, timed in enumerate(cached) if timed is None]
        batch = triangulate_in_batch(recipe, arrays.take(missing) if triangles else arrays, result)
        triangles |= {missing[k]: part for k, part in batch.items()}
        checks = _check_unconfirmed(arrays, triangles)
        valid = {k for k in triangles if not checks.get(k, (0, ""))[1]}
        attempts = {
            k: _triangulate_one(recipe, polygon, result)
            for k, polygon in enumerate(polygons if len(valid) < len(arrays) else ())
            if k not in valid
        }
        computed = {k: attempt.part for k, attempt in attempts.items() if attempt.part is not None}
        computed_checks = _check_unconfirmed(arrays, computed)
        for k, vertices in enumerate(arrays.vertex_counts.tolist()):
            timed = cached[k]
            if k in valid:
                gap = recipe.get_batch_gap(vertices) if timed is None else timed.gap
                result.seconds += 0.0 if timed is None else timed.seconds
                result.cached += timed is not None
                result.add(triangles[k], checks.get(k, (0, ""))[0])
            else:
                attempt = attempts[k]
                junctions, problem = computed_checks.get(k, (0, ""))
                if attempt.skipped:
                    result.skipped.append((k, attempt.skipped))
                result.add(attempt.part, junctions, problem or attempt.problem)
                gap = attempt.gap
                if result.parts[-1] is not None:
                    cache.store(k, result.parts[-1], attempt.seconds, gap)
            if result.parts[-1] is not None and gap is not None:
                result.gaps.append(gap)
    result.notes = cache.notes
    result.predicted = sum_criteria_per_polygon(arrays, result.parts)
    return result


def triangulate_in_batch(
    recipe: Recipe, polygons: PolygonArray, result: FrameTriangulation
) -> dict[int, Rows]:
    """Return triangles of the polygons that compiled code solves; add the time to `result`."""
    if not len(polygons):
        return {}
    start = cpu_clock()
    try:
        batch, compiled = recipe.triangulate_batch(polygons)
    except Exception:  # single calls report the problem of each polygon
        return {}
    if compiled.any():
        result.seconds += cpu_clock() - start
    return {index: batch[index] for index in np.flatnonzero(compiled).tolist()}


def time_in_rounds(
    recipes: Sequence[Recipe], polygons: Sequence[Polygon], rounds: int, seed: int
) -> list[list[float]]:
    """Return the seconds of each triangulator for all polygons, in each round.

    The order is shuffled in each round, so that machine drift affects all triangulators equally.
    """
    order = np.random.default_rng(seed)
    arrays = polygons if isinstance(polygons, PolygonArray) else PolygonArray.from_shapely(polygons)
    samples: list[list[float]] = [[] for _ in recipes]
    warm_up(*recipes)
    for _ in range(rounds):
        for index in order.permutation(len(recipes)).tolist():
            result = FrameTriangulation()
            batch = triangulate_in_batch(recipes[index], arrays, result)
            for k, polygon in enumerate(polygons if len(batch) < len(arrays) else ()):
                if k not in batch:
                    start = cpu_clock()
                    # `triangulate_polygons` has already reported the error.
                    with suppress(Exception, SystemExit, GeneratorExit):
                        recipes[index].triangulate_with_gap(polygon)
                    result.seconds += cpu_clock() - start
            samples[index].append(result.seconds)
    return samples


@dataclass(frozen=True)
class _Attempt:
    part: Rows | None
    gap: float | None
    seconds: float
    skipped: str = ""
    problem: str = ""


def _triangulate_one(recipe: Recipe, polygon: Polygon, result: FrameTriangulation) -> _Attempt:
    part, gap, skipped, problem = None, None, "", ""
    start = cpu_clock()
    try:
        part, gap = recipe.triangulate_with_gap(polygon)
    except SkippedError as reason:
        skipped = truncate(str(reason)) or "skipped"
    except (Exception, SystemExit, GeneratorExit) as error:  # all except Ctrl-C
        problem = format_error(error)
        result.trace = result.trace or "".join(traceback.format_exception(error))[:MAX_TRACEBACK]
    seconds = cpu_clock() - start
    result.seconds += seconds
    return _Attempt(part, gap, seconds, skipped, problem)


def _check_unconfirmed(
    polygons: PolygonArray, triangles: dict[int, Rows]
) -> dict[int, tuple[int, str]]:
    unconfirmed = find_unconfirmed(polygons, triangles)
    return {k: check_triangles(polygons[k], triangles[k]) for k in unconfirmed}


def warm_up(*recipes: Recipe) -> None:
    """Load compiled code before timing; the first call on a machine compiles for minutes."""
    for recipe in recipes:
        if recipe.base in _warm:
            continue
        polygons = PolygonArray.from_shapely(list(make_small_polygons()))
        batch = triangulate_in_batch(recipe, polygons, FrameTriangulation())
        find_unconfirmed(polygons, batch)
        for polygon in polygons:
            # the triangulation of the scene reports errors
            with suppress(Exception, SystemExit, GeneratorExit):
                check_triangles(polygon, recipe.triangulate_with_gap(polygon)[0])
        _warm.add(recipe.base)


_warm: set[str] = set()  # triangulators whose code this process has loaded


def make_small_polygons() -> Iterator[Polygon]:
    """Yield a polygon for each code path that triangulators may have: holes, many vertices."""
    square = box(0, 0, 8, 8).exterior
    holes = [box(x, 3, x + 2, 5).exterior for x in (1, 5)]
    yield Polygon(square)
    yield Polygon(square, holes[:1])
    yield Polygon(square, holes)
    # Many vertices with little mutual visibility, as large polygons use other code.
    angles = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    radii = np.where(np.arange(200) % 2, 50.0, 400.0)
    yield Polygon(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]))


def triangulate_many(
    polygons: Sequence[Polygon] | NDArray[Any] | PolygonArray,
    name: str,
    *,
    conforming: bool = False,
    **more: Any,
) -> Triangulations:
    """Triangulate as `triangulators.triangulate_many` with parameters `more` does, and verify.

    Polygons with invalid triangulations (if `conforming`, also with T-junctions), or on which a
    user's triangulator ends the process, are `failed` as well.

    Raises UsageError, or TaskError if the process ends, when a third-party module is imported.
    """
    arrays = polygons if isinstance(polygons, PolygonArray) else PolygonArray.from_shapely(polygons)
    if triangulators.parse(name).entry.builtin or multiprocessing.parent_process() is not None:
        return _mark_invalid(
            arrays, triangulators.triangulate_many(polygons, name, **more), conforming
        )
    # Most commands need no worker process, so the modules are loaded here.
    from harness.worker import TaskError, get_shared_worker, get_third_party_limits

    worker = get_shared_worker(f"triangulator {name}", get_third_party_limits)
    worker.call(parse(name).load)
    task = partial(triangulators.triangulate_many, **more)
    pieces: list[Rows] = []
    failed: dict[int, str] = {}
    # A stack of slices; a crashing slice is halved, down to one polygon.
    parts = [(0, len(polygons))]
    crashes = 0
    while parts:
        first, last = parts.pop()
        batch = arrays[first:last]
        try:
            done = worker.call(task, batch, name)
        except TaskError as error:
            if last - first > 1 and crashes < MAX_CRASHES:
                _LOG.info("%s: retry in halves: polygons %d to %d", name, first, last - 1)
                middle = (first + last) // 2
                parts += [(middle, last), (first, middle)]
                continue
            crashes += 1
            limit = f"; after {MAX_CRASHES} crashes, a crashing polygon's neighbours fail as well"
            reason = str(error) + limit * (last - first > 1)
            pieces += [np.empty((0, 3), np.int32)] * (last - first)
            failed |= dict.fromkeys(range(first, last), reason)
        else:
            pieces += list(done)
            failed |= {first + number: reason for number, reason in done.failed.items()}
    joined = _join_pieces(pieces, failed, np.zeros(len(pieces), np.bool_))
    return _mark_invalid(arrays, joined, conforming)


def _join_pieces(
    pieces: list[Rows], failed: dict[int, str], compiled: NDArray[np.bool_]
) -> Triangulations:
    triangles = np.concatenate([np.empty((0, 3), np.int32), *pieces])
    return Triangulations(triangles, offsets_of([len(piece) for piece in pieces]), failed, compiled)


def _mark_invalid(
    polygons: PolygonArray, triangulations: Triangulations, conforming: bool
) -> Triangulations:
    pieces = list(triangulations)
    triangles_by_index = {
        number: piece for number, piece in enumerate(pieces) if number not in triangulations.failed
    }
    failed = {}
    for number in find_unconfirmed(polygons, triangles_by_index):
        junctions, problem = check_triangles(polygons[number], pieces[number])
        if conforming and junctions:
            problem = f"{junctions} T-junction(s): a vertex lies on an edge of a triangle"
        if problem:
            failed[number] = problem
            pieces[number] = np.empty((0, 3), np.int32)
    if not failed:
        return triangulations
    return _join_pieces(pieces, {**triangulations.failed, **failed}, triangulations.compiled)

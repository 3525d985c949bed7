"""Triangulation of millions of small polygons, by threads of compiled code or on a device."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from mapbox_earcut import triangulate_float64

from triangulators.calling import triangulate
from triangulators.compute.kernels import count_usable_cores
from triangulators.criteria import FLIP_TESTS
from triangulators.criteria import find as find_criterion
from triangulators.criteria.cost import Cost, find_plain_cost
from triangulators.criteria.criterion import FEATURES, CriterionLike
from triangulators.errors import ArgumentError, TriangulationError, UnknownNameError, format_error
from triangulators.geometry.ear_clipping import MAX_VERTICES, find_far_offsets
from triangulators.gpu import CPU, check_device_name
from triangulators.methods.flips import (
    AS_EARCUT,
    COST,
    NO_COST,
    NONE,
    find_flip_test,
    improve_batch,
)
from triangulators.methods.optimal import LIMIT
from triangulators.optimum.cut_holes import MAX_HOLES, solve_by_cuts
from triangulators.optimum.full_table import MAX_SMALL_VERTICES, triangulate_rings_optimally
from triangulators.polygon_arrays import (
    Batch,
    PolygonArray,
    Triangulations,
    allocate_batch,
    offsets_of,
    rings_at,
)
from triangulators.registry import Choice, check_criterion, parse

# Vertices that mapbox_earcut clips in less than the 5 ms for which a thread waits for the GIL.
_CHUNK_VERTICES = 20_000
_MIN_CHUNK_VERTICES = 1_000
_DEVICE_FEATURES = ("half_perimeter", "expected_quads")  # minimised or maximised by devices
# Flip test by full name of a triangulator.
_FLIPS = {"ear-clipping": NONE, "earcut-refine": AS_EARCUT} | {
    f"flips:{name}": test for test, name in enumerate(FLIP_TESTS)
}

_FLIP_TRIANGULATORS = ("refined", "flips")  # triangulators whose flips can decrease any criterion


def triangulate_many(
    polygons: Sequence[shapely.Polygon] | np.ndarray | PolygonArray,
    name: str = "optimal:half-perimeter",
    *,
    check: bool = True,
    threads: int | None = None,
    device: str = CPU,
    criterion: CriterionLike | None = None,
    repair: bool = False,
    order: str | None = None,
    **parameters: Any,
) -> Triangulations:
    """Triangulate many polygons; a polygon that fails is listed in the result's `failed`.

    Parameters
    ----------
    polygons
        Shapely polygons, or a `PolygonArray`.
    name
        A triangulator, as for `triangulate`.
    check
        Test shapely polygons for validity first; a `PolygonArray` is not tested.
    threads
        Number of threads, by default one per core that this process may use.
    device
        "gpu0", "gpu1", ... or "llvmpipe" computes the optimum (or worst) of half-perimeter or
        expected-quads in OpenGL compute shaders, for polygons without holes, of up to 64 vertices,
        on a grid (1/256 px, integer metres, ...), with the same results (expected-quads: up to
        1e-9, if the device rounds differently). The CPU does the other polygons, and all of them if
        the device fails, which is logged once.
    criterion, repair, order, **parameters
        As for `triangulate`.

    Returns
    -------
    Triangulations
        A sequence of p arrays (m, 3), and the reasons of failures.

    Raises
    ------
    UnknownNameError
        If there is no such triangulator, criterion, device or order.
    ArgumentError
        If the criterion is given twice, or `polygons` is a single polygon.

    Notes
    -----
    For the optimum (or worst) of half-perimeter, overdraw, edge-length or a calibrated criterion,
    compiled code triangulates polygons of up to 192 vertices with at most three holes, exactly and
    on all threads; for `refined`, `flips`, `earcut-refine` and `ear-clipping` polygons of any size.
    `triangulate` does all other polygons one by one. The costs are those of `triangulate`.

    Examples
    --------
    >>> results = triangulate_many([shapely.box(0, 0, 2, 1), shapely.Polygon()])
    >>> results[0].shape, results.failed
    ((2, 3), {1: 'the polygon is empty'})
    """
    options = {"criterion": criterion, "repair": repair, "order": order, **parameters}
    batch = triangulate_supported(
        polygons, name, check=check, threads=threads, device=device, **options
    )
    offsets, triangles, done = batch.triangle_offsets, batch.triangles, batch.compiled
    if done.all():
        return batch
    failed: dict[int, str] = {}
    pieces: list[np.ndarray] = []
    lengths = np.diff(offsets)
    copied = 0
    builtin = parse(name).entry.builtin
    for index in np.flatnonzero(~done).tolist():
        pieces.append(triangles[offsets[copied] : offsets[index]])
        copied = index + 1
        try:
            pieces.append(triangulate(polygons[index], name, **options))
        except (Exception, SystemExit) as error:
            wrong_call = isinstance(error, (ArgumentError, UnknownNameError))
            refused = isinstance(error, TriangulationError) and not wrong_call
            if builtin and not refused:
                raise
            failed[index] = str(error) if refused else format_error(error)
            pieces.append(triangles[:0])
        lengths[index] = len(pieces[-1])
    pieces.append(triangles[offsets[copied] :])
    return Triangulations(np.concatenate(pieces), offsets_of(lengths), failed, done)


def triangulate_supported(
    polygons: Sequence[shapely.Polygon] | np.ndarray | PolygonArray,
    name: str = "optimal:half-perimeter",
    *,
    check: bool = True,
    threads: int | None = None,
    device: str = CPU,
    criterion: CriterionLike | None = None,
    repair: bool = False,
    order: str | None = None,
    **parameters: Any,
) -> Triangulations:
    """Triangulate polygons that a device or compiled code supports; others stay uninitialised."""
    if isinstance(polygons, shapely.Geometry):
        kind = type(polygons).__name__
        raise ArgumentError(f"polygons: expected a sequence, got one {kind}; give [polygon]")
    check_criterion(name, criterion)
    arrays = polygons if isinstance(polygons, PolygonArray) else PolygonArray.from_shapely(polygons)
    batch = allocate_batch(arrays)
    result = Triangulations(batch.triangles, batch.triangle_offsets, compiled=batch.done)
    threads = threads or count_usable_cores()
    choice = parse(name)
    in_walk = choice.entry.uses_walk(order)
    if not choice.entry.builtin:
        choice.entry.load()
    check_device_name(device)
    limit = parameters.get("limit", LIMIT)
    searched = ("limit", "seed") if choice.entry.name in ("optimal", "worst") else ()
    weights = {name: parameters[name] for name in parameters if name not in searched}
    cost = None if repair else _find_batch_cost(choice, criterion, weights, device)
    steered = bool(parameters) or criterion is not None or repair
    flips = None if steered else _FLIPS.get(choice.full_name)
    if cost is None and flips is None:
        return result
    valid = np.ones(len(batch.done), dtype=np.bool_)
    if check and arrays is not polygons:
        valid = shapely.is_valid(np.asarray(polygons, dtype=object))
    if cost is None:
        _triangulate_by_ears(batch, valid, threads, flips, NO_COST, None, False, in_walk)
    elif choice.entry.name in _FLIP_TRIANGULATORS:
        refined, test = choice.entry.name == "refined", find_flip_test(cost)
        decreased = cost if test == COST else None
        _triangulate_by_ears(batch, valid, threads, test, cost, decreased, refined, in_walk)
    else:
        feature = _find_device_feature(cost, device)
        if feature is not None:
            selected = valid & (arrays.ring_counts == 1)
            from triangulators.gpu import engine  # imported only if a device is selected

            engine.solve_on_device(device, batch, selected, limit, *feature)
        if cost["is_box"]:
            _triangulate_optimally(batch, cost, valid, threads, limit)
    return result


def _triangulate_optimally(
    batch: Batch, cost: Cost, valid: np.ndarray, threads: int, limit: int
) -> None:
    """Write the optima of supported polygons to `batch`; valid (p,): overwritten."""
    vertices, rings = np.diff(batch.vertex_offsets), np.diff(batch.geom_offsets)
    valid &= (vertices >= 3) & (vertices <= min(limit, MAX_SMALL_VERTICES))
    single = valid & (rings == 1) & ~batch.done
    with_holes = np.flatnonzero(valid & (rings > 1) & (rings <= MAX_HOLES + 1))
    with ThreadPoolExecutor(threads) as pool:
        running = []
        for kernel, count, selection in (
            (_triangulate_with_holes, len(with_holes), with_holes),
            (triangulate_rings_optimally, len(batch.done), single),
        ):
            chunks = max(1, min(8 * threads, count // 64))
            bounds = np.linspace(0, count, chunks + 1).astype(int).tolist()
            for first, last in pairwise(bounds):
                running.append(pool.submit(kernel, first, last, batch, selection, cost["box"]))
        for task in running:
            task.result()


def _triangulate_with_holes(
    first: int, last: int, batch: Batch, indices: np.ndarray, box: np.ndarray
) -> None:
    offsets = batch.triangle_offsets
    # Not compiled: that would compile all of `cut_holes` again, to save 3 of 50 us per polygon.
    for index in indices[first:last].tolist():
        points, rings = rings_at(index, batch.coords, batch.ring_offsets, batch.geom_offsets)
        triangles = batch.triangles[offsets[index] : offsets[index + 1]]
        batch.done[index] = solve_by_cuts(points, rings, box, triangles)


def _triangulate_by_ears(batch: Batch, valid: np.ndarray, threads: int, *how: Any) -> None:
    """Clip large polygons and holes in this thread, clip others and flip in `threads` threads."""
    vertex_offsets, geom_offsets = batch.vertex_offsets.tolist(), batch.geom_offsets.tolist()
    first_vertices = np.repeat(batch.vertex_offsets[:-1], np.diff(batch.geom_offsets))
    # earcut expects the ends of rings relative to the polygon's first vertex.
    ring_ends = (batch.ring_offsets[1:] - first_vertices).astype(np.uint32)
    sizes, rings = np.diff(batch.vertex_offsets), np.diff(batch.geom_offsets)
    selected = valid & (sizes >= 3)
    to_clip = selected & (rings == 1) & (sizes <= MAX_VERTICES)
    clip_here = (selected & ~to_clip).tolist()
    empty = np.empty(0, dtype=np.uint32)
    chunk = min(max(vertex_offsets[-1] // (4 * threads), _MIN_CHUNK_VERTICES), _CHUNK_VERTICES)
    marks = np.arange(0, vertex_offsets[-1], chunk)
    cuts = np.searchsorted(batch.vertex_offsets, marks)
    bounds = np.unique(np.append(cuts, len(batch.done))).tolist()
    running = []
    with ThreadPoolExecutor(threads) as pool:
        for first, last in pairwise(bounds):
            start, stop = vertex_offsets[first], vertex_offsets[last]
            starts = batch.vertex_offsets[first:last] - start
            counts = np.diff(batch.vertex_offsets[first : last + 1])
            local, filled = batch.coords[start:stop], np.flatnonzero(counts)
            if len(filled):
                far = find_far_offsets(local, starts[filled])
                local = local - np.repeat(far, counts[filled], axis=0)
            raw = [
                triangulate_float64(
                    local[vertex_offsets[i] - start : vertex_offsets[i + 1] - start],
                    ring_ends[geom_offsets[i] : geom_offsets[i + 1]],
                )
                if clip_here[i]
                else empty
                for i in range(first, last)
            ]
            rows = offsets_of([len(indices) // 3 for indices in raw])
            joined = np.concatenate(raw).astype(np.int32).reshape(-1, 3)
            part = (first, last, batch, (joined, rows, to_clip), *how)
            if last < len(batch.done):
                running.append(pool.submit(improve_batch, *part))
            else:  # the last chunk: this thread is idle
                improve_batch(*part)
        for task in running:
            task.result()


def _find_device_feature(cost: Cost, device: str) -> tuple[str, bool] | None:
    """Return the feature that a device optimises, and whether to maximise it; None for the CPU."""
    # Without the number and the area of triangles, which are equal in all triangulations.
    weights = dict(zip(FEATURES[2:], cost["weights"][2:].tolist(), strict=True))
    for feature in _DEVICE_FEATURES:
        size = abs(weights[feature])
        if device != CPU and size == 1.0 and sum(map(abs, weights.values())) == size:
            return feature, weights[feature] < 0.0
    return None


def _find_batch_cost(
    choice: Choice, criterion: Any, weights: dict[str, Any], device: str
) -> Cost | None:
    """Return the `Cost` that a triangulator decreases, or None if a batch has no common cost."""
    name = choice.entry.name
    resolved = choice.criterion if criterion is None else criterion
    if (
        name not in ("optimal", "worst", *_FLIP_TRIANGULATORS)
        or resolved is None
        or resolved in FLIP_TESTS
    ):
        return None
    cost = find_plain_cost(find_criterion(resolved, **weights), -1.0 if name == "worst" else 1.0)
    if cost is None or cost["is_box"] or name in _FLIP_TRIANGULATORS:
        return cost
    return None if _find_device_feature(cost, device) is None else cost

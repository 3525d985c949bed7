"""Millions of small polygons at once, over ragged arrays and in parallel."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from mapbox_earcut import triangulate_float64

from triangulators.calling import triangulate
from triangulators.criteria import FLIP_TESTS
from triangulators.criteria import find as find_criterion
from triangulators.criteria.cost import Cost, plain_cost
from triangulators.devices import CPU, check_name, cores
from triangulators.errors import Skipped, TriangulationError, told_of
from triangulators.geometry.earcut import far_offsets
from triangulators.methods.flips import AS_EARCUT, NO_COST, NONE, improve_many, test_of
from triangulators.methods.optimal import LIMIT
from triangulators.optimum.cut_holes import MOST_HOLES, by_cuts
from triangulators.optimum.full_table import SMALL, do_rings
from triangulators.ragged import (
    Batch,
    Ragged,
    Triangulations,
    batch_of,
    polygon_at,
    polygon_of,
    ragged,
)
from triangulators.registry import parse

_CHUNK = 20_000
"""Vertices whose ears are clipped while those of others are improved. mapbox_earcut holds the
interpreter's lock; a thread that waits for it waits up to 5 ms, in which some 30,000 are done."""
_ON_DEVICE = ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0])
"""Coefficients of half-perimeter, bounding-box area and edge length that devices know."""
_FLIPS = {"ear-clipping": NONE, "earcut-refine": AS_EARCUT} | {
    f"flips:{name}": test for test, name in enumerate(FLIP_TESTS)
}
"""Triangulators that are ear clipping with flips after it, and by which test."""

_FLIPPED = ("refined", "flips")
"""Those whose flips may lessen any criterion."""


def triangulate_many(
    polygons: Sequence[shapely.Polygon] | np.ndarray | Ragged,
    name: str = "optimal:half-perimeter",
    *,
    check: bool = True,
    threads: int | None = None,
    device: str = CPU,
    **parameters: Any,
) -> Triangulations:
    """Triangulate a batch; one polygon that cannot be done is named in `failed`, not fatal.

    polygons: shapely polygons, or `Ragged` arrays. If `name` is the optimum (or worst) of
    half-perimeter, overdraw, edge-length or a calibrated criterion, compiled code does those of up
    to 192 vertices with few holes or none, exactly and on all threads; also `refined`, `flips`,
    `earcut-refine` and `ear-clipping`. What is left, and everything under other names, goes one at
    a time through `triangulate`. Either way a polygon's triangulation costs what that of
    `triangulate` does.

    check: test shapely polygons for validity first. threads: by default one for each core this
    process may use. device: "gpu0", "gpu1", ... or "llvmpipe" computes the optimum (or worst) of
    half-perimeter in OpenGL's compute shaders, for polygons without holes, of up to 64 vertices, on
    a grid (1/256 px, whole metres, ...); the results are the same. Compiled code does the others,
    and all where the device fails, of which one line is logged. parameters: as for `triangulate`.
    Raises `UnknownName`.

        >>> found = triangulate_many([shapely.box(0, 0, 2, 1), shapely.Polygon()])
        >>> found[0].shape, found.failed
        ((2, 3), {1: 'the polygon is empty'})
    """
    found = attempt_many(polygons, name, check=check, threads=threads, device=device, **parameters)
    starts, triangles, done = found.starts, found.triangles, found.compiled
    if done.all():
        return found
    failed: dict[int, str] = {}
    pieces: list[np.ndarray] = []
    lengths = np.diff(starts)
    copied = 0
    builtin = parse(name).entry.builtin
    for index in np.flatnonzero(~done).tolist():
        pieces.append(triangles[starts[copied] : starts[index]])
        copied = index + 1
        given = polygon_at(polygons, index) if isinstance(polygons, Ragged) else polygons[index]
        try:
            pieces.append(triangulate(given, name, **parameters))
        except (Exception, SystemExit) as error:
            refused = isinstance(error, (TriangulationError, Skipped))
            if builtin and not refused:
                raise
            failed[index] = str(error) if refused else told_of(error)
            pieces.append(triangles[:0])
        lengths[index] = len(pieces[-1])
    pieces.append(triangles[starts[copied] :])
    return Triangulations(np.concatenate(pieces), np.r_[0, np.cumsum(lengths)], failed, done)


def attempt_many(
    polygons: Sequence[shapely.Polygon] | np.ndarray | Ragged,
    name: str = "optimal:half-perimeter",
    *,
    check: bool = True,
    threads: int | None = None,
    device: str = CPU,
    **parameters: Any,
) -> Triangulations:
    """Do the part of `triangulate_many` that a device and compiled code can.

    What is there for the polygons that are not `compiled` is worth nothing. Raises `UnknownName`.
    """
    work = batch_of(polygons if isinstance(polygons, Ragged) else ragged(polygons))
    found = Triangulations(work.triangles, work.starts, compiled=work.done)
    threads = threads or cores()
    choice = parse(name)
    if not choice.entry.builtin:
        choice.entry.load()
    check_name(device)
    cost = _plain_cost(choice.entry.name, choice.criterion, parameters)
    flips = None if parameters else _FLIPS.get(choice.full_name)
    if cost is None and flips is None:
        return found
    sound = np.ones(len(work.done), dtype=np.bool_)
    if check and not isinstance(polygons, Ragged):
        sound = shapely.is_valid(np.asarray(polygons, dtype=object))
    if cost is None:
        _clipped(work, sound, threads, flips, NO_COST, False)
    elif choice.entry.name in _FLIPPED:
        _clipped(work, sound, threads, test_of(cost), cost, choice.entry.name == "refined")
    else:
        limit = parameters.get("limit", LIMIT)
        if device != CPU and cost["box"].tolist() in _ON_DEVICE:
            wanted = sound & (np.diff(work.owners) == 1)
            worst = bool(cost["box"][0] < 0.0)
            from triangulators.gpu import engine  # asked for by name alone

            engine.attempt(device, work, wanted, limit, worst)
        _compiled(work, cost, sound, threads, limit)
    return found


def _compiled(work: Batch, cost: Cost, sound: np.ndarray, threads: int, limit: int) -> None:
    """Do what compiled code can; marks it in `work.done`."""
    lengths, rings = np.diff(work.begins), np.diff(work.owners)
    sound &= (lengths >= 3) & (lengths <= min(limit, SMALL))
    by_table = sound & (rings == 1) & ~work.done
    with_holes = np.flatnonzero(sound & (rings > 1) & (rings <= MOST_HOLES + 1))
    with ThreadPoolExecutor(threads) as pool:
        running = []
        for kernel, count, which in (
            (_do_holes, len(with_holes), with_holes),
            (do_rings, len(work.done), by_table),
        ):
            chunks = max(1, min(8 * threads, count // 64))
            bounds = np.linspace(0, count, chunks + 1).astype(int).tolist()
            for first, last in pairwise(bounds):
                running.append(pool.submit(kernel, first, last, work, which, cost["box"]))
        for task in running:
            task.result()


def _do_holes(first: int, last: int, work: Batch, which: np.ndarray, box: np.ndarray) -> None:
    """Triangulate the polygons which[first:last], which have holes; marks `work.done`.

    Called one by one: each takes some fifty microseconds, a call two or three, and a loop in
    compiled code would compile all of `cut_holes` a second time.
    """
    for index in which[first:last].tolist():
        own = work.triangles[work.starts[index] : work.starts[index + 1]]
        work.done[index] = by_cuts(*polygon_of(index, *work[:4]), box, own)


def _clipped(work: Batch, sound: np.ndarray, threads: int, *how: Any) -> None:
    """Clip ears in this thread, and let others `improve_many`; marks `work.done`."""
    counts = np.diff(work.owners)
    ends = (work.rings[1:] - np.repeat(work.begins[:-1], counts)).astype(np.uint32)
    begins, owners, coordinates = work.begins.tolist(), work.owners.tolist(), work.coordinates
    wanted = (sound & (np.diff(work.begins) >= 3)).tolist()
    nothing = np.empty(0, dtype=np.uint32)
    cuts = np.searchsorted(work.begins, np.arange(0, work.begins[-1], _CHUNK))
    bounds = np.unique(np.append(cuts, len(work.done))).tolist()
    running = []
    with ThreadPoolExecutor(threads) as pool:
        for first, last in pairwise(bounds):
            start, stop = begins[first], begins[last]
            filled = np.flatnonzero(np.diff(work.begins[first : last + 1]))
            local = coordinates[start:stop]
            if len(filled):
                offsets = far_offsets(local, work.begins[first:last][filled] - start)
                local = local - np.repeat(offsets, np.diff(work.begins)[first:last][filled], axis=0)
            raw = [
                triangulate_float64(
                    local[begins[i] - start : begins[i + 1] - start],
                    ends[owners[i] : owners[i + 1]],
                )
                if wanted[i]
                else nothing
                for i in range(first, last)
            ]
            rows = np.r_[0, np.cumsum([len(indices) for indices in raw]) // 3]
            joined = np.concatenate(raw).astype(np.int32).reshape(-1, 3)
            part = (first, last, work, (joined, rows), *how)
            if last < len(work.done):
                running.append(pool.submit(improve_many, *part))
            else:  # there is nothing else left for this thread to do
                improve_many(*part)
        for task in running:
            task.result()


def _plain_cost(name: str, criterion: str | None, parameters: dict[str, Any]) -> Cost | None:
    """Return the cost if compiled code can do it, whatever the polygon; otherwise None."""
    wanted = parameters.get("criterion", criterion)
    known = name in ("optimal", "worst", *_FLIPPED)
    if not known or wanted is None or parameters.get("repair") or wanted in FLIP_TESTS:
        return None
    steered = {k: v for k, v in parameters.items() if k not in ("criterion", "limit", "seed")}
    found = find_criterion(wanted, **steered)
    cost = plain_cost(found, -1.0 if name == "worst" else 1.0)
    return cost if cost is not None and (cost["is_box"] or name in _FLIPPED) else None

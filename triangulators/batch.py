"""Millions of small polygons at once, over ragged arrays and in parallel."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from mapbox_earcut import triangulate_float64

from triangulators.batch_kernels import SMALL, do_rings, improve_many
from triangulators.cost import Cost, cost_of
from triangulators.criteria import find as find_criterion
from triangulators.errors import Skipped, TriangulationError
from triangulators.registry import parse, triangulate


class Ragged(NamedTuple):
    """Polygons as arrays: coordinates (n, 2) float64, ring after ring and none closed.

    `ring_ends` (r,): where in `coordinates` each ring ends; `polygon_ends` (p,): where in
    `ring_ends` each polygon ends, its exterior first. Rings are taken to be valid.
    """

    coordinates: np.ndarray
    ring_ends: np.ndarray
    polygon_ends: np.ndarray


@dataclass(frozen=True)
class Triangulations(Sequence[np.ndarray]):
    """Triangulations of many polygons; `[i]` is that of polygon i, (m, 3) int32.

    triangles: (M, 3), each polygon's as indices into its own vertices; starts: (p + 1,), where
    each polygon's begin. `failed` says why, for each polygon that has none.
    """

    triangles: np.ndarray
    starts: np.ndarray
    failed: dict[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"polygon {index} of {len(self)}")
        index %= len(self)
        return self.triangles[self.starts[index] : self.starts[index + 1]]

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[index] for index in range(len(self)))


def ragged(polygons: Sequence[shapely.Polygon] | np.ndarray) -> Ragged:
    """Return shapely polygons as `Ragged` arrays."""
    array = np.asarray(polygons, dtype=object)
    rings, owner = shapely.get_rings(array, return_index=True)
    lengths = shapely.get_num_coordinates(rings)
    coordinates = shapely.get_coordinates(rings)
    keep = np.ones(len(coordinates), dtype=np.bool_)
    keep[np.cumsum(lengths) - 1] = False
    polygon_ends = np.cumsum(np.bincount(owner, minlength=len(array)))
    return Ragged(coordinates[keep], np.cumsum(lengths - 1), polygon_ends)


def triangulate_many(
    polygons: Sequence[shapely.Polygon] | np.ndarray | Ragged,
    name: str = "optimal:half-perimeter",
    *,
    check: bool = True,
    threads: int | None = None,
    **parameters: Any,
) -> Triangulations:
    """Triangulate a batch; one polygon that cannot be done is named in `failed`, not fatal.

    polygons: shapely polygons, or `Ragged` arrays. If `name` is the optimum (or worst) of
    half-perimeter, overdraw, edge-length or a calibrated criterion, compiled code does those of up
    to 192 vertices on all threads: exactly without holes; with holes from ear clipping on, trying
    a few cuts. What is left, and everything under other names, goes one at a time through
    `triangulate`. check: test shapely polygons for validity first. threads: by default one for
    each core this process may use. parameters: as for `triangulate`. Raises `UnknownName`.

        >>> found = triangulate_many([shapely.box(0, 0, 2, 1), shapely.Polygon()])
        >>> found[0].shape, found.failed
        ((2, 3), {1: 'the polygon is empty'})
    """
    choice = parse(name)
    arrays = polygons if isinstance(polygons, Ragged) else ragged(polygons)
    work = _Work.of(arrays)
    cost = _box_cost(choice.entry.name, choice.criterion, parameters)
    if cost is not None:
        sound = np.ones(len(work.done), dtype=np.bool_)
        if check and not isinstance(polygons, Ragged):
            sound = shapely.is_valid(np.asarray(polygons, dtype=object))
        _compiled(work, cost, sound, threads or _cores())
    if work.done.all():
        return Triangulations(work.triangles, work.starts)
    return _finish(arrays, polygons, name, parameters, work)


class _Work(NamedTuple):
    """Arrays of a batch of p polygons.

    coordinates (n, 2); rings (r + 1,): bounds of rings in it; owners (p + 1,): bounds of polygons
    in `rings`; begins (p + 1,): bounds of polygons in `coordinates`; starts (p + 1,): bounds of
    polygons in `triangles` (m, 3), where there is room for each one's; done (p,).
    """

    coordinates: np.ndarray
    rings: np.ndarray
    owners: np.ndarray
    begins: np.ndarray
    starts: np.ndarray
    triangles: np.ndarray
    done: np.ndarray

    @classmethod
    def of(cls, arrays: Ragged) -> "_Work":
        coordinates = np.ascontiguousarray(arrays.coordinates, dtype=np.float64)
        rings = np.r_[0, arrays.ring_ends].astype(np.int64)
        owners = np.r_[0, arrays.polygon_ends].astype(np.int64)
        begins = rings[owners]
        room = np.diff(begins) - 2 + 2 * (np.diff(owners) - 1)
        starts = np.r_[0, np.cumsum(np.maximum(room, 0))]
        triangles = np.empty((starts[-1], 3), dtype=np.int32)
        done = np.zeros(len(owners) - 1, dtype=np.bool_)
        return cls(coordinates, rings, owners, begins, starts, triangles, done)


def _compiled(work: _Work, cost: Cost, sound: np.ndarray, threads: int) -> None:
    """Do what compiled code can; marks it in `work.done`."""
    lengths, one_ring = np.diff(work.begins), np.diff(work.owners) == 1
    sound &= lengths >= 3
    by_table = sound & one_ring & (lengths <= SMALL)
    others = np.flatnonzero(sound & ~by_table & (np.diff(work.starts) + 2 <= SMALL))
    with ThreadPoolExecutor(threads) as pool:
        running = _share(
            pool,
            threads,
            len(work.done),
            do_rings,
            *(work.coordinates, work.begins, by_table, cost.box),
            *(work.starts, work.triangles, work.done),
        )
        raw = _earcut(work, others)  # in this thread, meanwhile
        _wait(running)
        if len(raw) == 0:
            return
        bounds = np.r_[0, np.cumsum([len(indices) // 3 for indices in raw])]
        joined = np.concatenate(raw).astype(np.int32).reshape(-1, 3)
        improved = np.zeros(len(others), dtype=np.bool_)
        running = _share(
            pool,
            threads,
            len(others),
            improve_many,
            *(work.coordinates, work.rings[1:], work.owners, others),
            *(cost.box, joined, bounds, improved),
        )
        _wait(running)
    # Improved triangulations fill their room exactly.
    good = others[improved]
    rows = np.repeat(work.starts[good], np.diff(bounds)[improved])
    rows += _positions(np.diff(bounds)[improved])
    work.triangles[rows] = joined[np.repeat(improved, np.diff(bounds))]
    work.done[others] = improved


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _share(
    pool: ThreadPoolExecutor,
    threads: int,
    count: int,
    kernel: Callable[..., None],
    *arguments: Any,
) -> list[Future[None]]:
    """Start a compiled kernel(first, last, *arguments) over 0..count - 1, in chunks."""
    chunks = max(1, min(8 * threads, count // 64))
    bounds = np.linspace(0, count, chunks + 1).astype(int).tolist()
    return [pool.submit(kernel, *chunk, *arguments) for chunk in pairwise(bounds)]


def _wait(running: list[Future[None]]) -> None:
    for task in running:
        task.result()


def _earcut(work: _Work, which: np.ndarray) -> list[np.ndarray]:
    """Return earcut's flat indices for each of some polygons."""
    counts = np.diff(work.owners)
    ends = (work.rings[1:] - np.repeat(work.begins[:-1], counts)).astype(np.uint32)
    bounds = (work.begins, work.owners)
    return [
        triangulate_float64(work.coordinates[start:end], ends[first:last])
        for start, end, first, last in zip(
            *(bound[which + step].tolist() for bound in bounds for step in (0, 1)), strict=True
        )
    ]


def _positions(lengths: np.ndarray) -> np.ndarray:
    """Count 0, 1, ... anew within each of some consecutive lengths."""
    return np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)


def _box_cost(name: str, criterion: str | None, parameters: dict[str, Any]) -> Cost | None:
    """Return the cost if compiled code can do it, whatever the polygon; otherwise None."""
    wanted = parameters.get("criterion", criterion)
    if name not in ("optimal", "worst") or wanted is None or parameters.get("repair"):
        return None
    steered = {k: v for k, v in parameters.items() if k not in ("criterion", "limit", "seed")}
    found = find_criterion(wanted, **steered)
    if found.normalise is not None or found.function is not None:
        return None
    cost = cost_of(found, 1.0, 1, 1.0 if name == "optimal" else -1.0)
    return cost if cost.is_box else None


def polygon_at(arrays: Ragged, index: int) -> shapely.Polygon:
    """Return one polygon of `Ragged` arrays."""
    first = int(arrays.polygon_ends[index - 1]) if index else 0
    ends = arrays.ring_ends[first : int(arrays.polygon_ends[index])]
    start = int(arrays.ring_ends[first - 1]) if first else 0
    rings = np.split(arrays.coordinates[start : int(ends[-1])], ends[:-1] - start)
    return shapely.Polygon(rings[0], rings[1:])


def _finish(
    arrays: Ragged,
    polygons: Sequence[shapely.Polygon] | np.ndarray | Ragged,
    name: str,
    parameters: dict[str, Any],
    work: _Work,
) -> Triangulations:
    """Do what compiled code left, one polygon at a time, and put all in order."""
    starts, triangles = work.starts, work.triangles
    failed: dict[int, str] = {}
    pieces: list[np.ndarray] = []
    lengths = np.diff(starts)
    copied = 0
    for index in np.flatnonzero(~work.done).tolist():
        pieces.append(triangles[starts[copied] : starts[index]])
        copied = index + 1
        given = polygon_at(arrays, index) if isinstance(polygons, Ragged) else polygons[index]
        try:
            pieces.append(triangulate(given, name, **parameters))
        except (TriangulationError, Skipped) as error:
            failed[index] = str(error)
            pieces.append(triangles[:0])
        lengths[index] = len(pieces[-1])
    pieces.append(triangles[starts[copied] :])
    return Triangulations(np.concatenate(pieces), np.r_[0, np.cumsum(lengths)], failed)

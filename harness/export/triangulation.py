"""Triangulates a batch of polygons, reading from the model database where that is quicker."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.export.apart import triangulate_many
from harness.triangulating import database as model
from triangulators import full_name, parse
from triangulators.batch.doubtful import doubtful
from triangulators.batch.triangulate_many import Ragged, ragged
from triangulators.verify import verify

COMPILED = 64
"""With at most this many vertices, an optimum without holes is computed as fast as it is read.

Measured on 20,000 footprints, microseconds per polygon: reading 8 (and 9 once for writing);
computing the optimum of 25..64 vertices 21, of 65..500 vertices 350, with holes 60..770, and
120..400 for ear-clipping and Delaunay, which go one polygon at a time.
"""


@dataclass
class Batch:
    """Triangulations of a batch.

    arrays : the polygons as ragged arrays; triangles : (M, 3) int32, each polygon's as indices into
    its own vertices; starts : (p + 1,), where each one's begin; failed : polygon number to reason;
    read : how many came from the model database; compiled : (p,) those that compiled code did, an
    optimum exactly; None where some came from the database.
    """

    arrays: Ragged
    triangles: NDArray[np.int32]
    starts: NDArray[np.int64]
    failed: dict[int, str] = field(default_factory=dict)
    read: int = 0
    compiled: NDArray[np.bool_] | None = None


def triangulate_batch(
    polygons: NDArray[Any],
    name: str,
    parameters: dict[str, Any],
    database: model.ModelDatabase | None = None,
    device: str | None = None,
) -> Batch:
    """Triangulate valid polygons; what fails is named in `failed` and has no triangles.

    device : as for `triangulators.triangulate_many`; the triangles are the same on all.

    Raises `triangulators.UnknownName` for an unknown triangulator or criterion.
    """
    name = full_name(name)
    arrays = ragged(polygons)
    keys = {} if database is None else _keys(arrays, name, parameters)
    if database is None or not keys:
        computed = triangulate_many(arrays, name, device=device, **parameters)
        starts = np.asarray(computed.starts, dtype=np.int64)
        batch = Batch(arrays, computed.triangles, starts, dict(computed.failed))
        batch.compiled = computed.compiled
        return batch
    found = database.get_many(list(keys.values()))
    pieces: list[NDArray[np.int32] | None] = [None] * len(polygons)
    for number, key in keys.items():
        pieces[number] = found.get(key)
    known = {number: piece for number, piece in enumerate(pieces) if piece is not None}
    for number in doubtful(arrays, known):
        if not verify(polygons[number], known[number]).ok:  # forged: its checksum is right
            pieces[number] = None
    missing = [number for number, piece in enumerate(pieces) if piece is None]
    failed: dict[int, str] = {}
    if missing:
        computed = triangulate_many(
            polygons[missing], name, check=False, device=device, **parameters
        )
        failed = {missing[k]: reason for k, reason in computed.failed.items()}
        for k, number in enumerate(missing):
            pieces[number] = computed[k]
        fresh = [k for k, n in enumerate(missing) if n in keys and n not in failed]
        if fresh:
            database.put_many(name, [(keys[missing[k]], computed[k]) for k in fresh])
    whole = [piece for piece in pieces if piece is not None]
    starts = np.r_[0, np.cumsum([len(piece) for piece in whole])].astype(np.int64)
    return Batch(arrays, np.concatenate(whole), starts, failed, len(polygons) - len(missing))


def _keys(arrays: Ragged, name: str, parameters: dict[str, Any]) -> dict[int, bytes]:
    """Keys of those polygons for which reading the model database can be faster."""
    if not parse(name).entry.builtin:
        return {}  # a user's function may change without its name doing so
    rings = np.r_[0, arrays.ring_ends].astype(np.int64)
    owners = np.r_[0, arrays.polygon_ends].astype(np.int64)
    begins = rings[owners]
    vertices, holes = np.diff(begins), np.diff(owners) - 1
    compiled = parse(name).entry.name in ("optimal", "worst")
    worth = (vertices > COMPILED) | (holes > 0) | (not compiled)
    coordinates = np.ascontiguousarray(arrays.coordinates, dtype="<f8")
    keys = {}
    for i in np.flatnonzero(worth).tolist():
        ends = rings[owners[i] + 1 : owners[i + 1] + 1] - begins[i]
        keys[i] = model.key(name, parameters, coordinates[begins[i] : begins[i + 1]], ends)
    return keys

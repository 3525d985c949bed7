"""A census: what each triangulator gains on every footprint of a data set, by exact counting."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.export.export import counted_notes
from harness.scaling.counted import measured, sums_of
from harness.scaling.dataset import Kind
from harness.scaling.part_files import AT_A_TIME, Done, about, make_part
from harness.scaling.parts import Part
from harness.scaling.snapping import on_pixels
from harness.scaling.sums import FOOTPRINTS, MEASURES, Sums, read_counted, save
from scenes.files import Chunk, read_chunks


@dataclass(frozen=True)
class Options:
    """What a census counts.

    triangulators : full names; the first is the one that the others are compared with
    units_per_pixel : of the map on which footprints are drawn: metres, if they are in degrees
    cell : edge of a cell of the map, in the source's own units
    """

    triangulators: tuple[str, ...]
    units_per_pixel: float
    cell: float
    layer: str | None = None
    where: str | None = None


def count_part(part: Part, options: Options, out: str, code: str, threads: int | None = 1) -> Done:
    """Count a part and put its file into the folder `out`, unless it is there.

    Raises as `make_part` does.
    """
    place = Path(out) / f"{part.key}.npz"
    return make_part(place, code, read_counted, lambda: _write(part, options, place, code, threads))


def _write(part: Part, options: Options, place: Path, code: str, threads: int | None) -> Done:
    sums = Sums.empty(len(options.triangulators))
    counts: Counter[tuple[str, str]] = Counter()
    notes: list[str] = []
    for chunk in read_chunks(
        part.path, layer=options.layer, where=options.where, size=AT_A_TIME, rows=part.rows
    ):
        counts += counted_notes("dropped", chunk.cleaned.dropped)
        counts += counted_notes("repaired", chunk.cleaned.repaired)
        notes += chunk.notes
        if len(chunk.cleaned.polygons):
            sums.add(_counted(chunk, options, threads, counts))
    done = done_of(part, asdict(options), code, sums, counts, notes)
    save(place, done, {FOOTPRINTS: sums})
    return done


def done_of(
    part: Part,
    options: dict[str, Any],
    code: str,
    sums: Sums,
    counts: Counter[tuple[str, str]],
    notes: list[str],
) -> Done:
    """Return what a part's file says of itself; `sums` are those of all its groups."""
    return Done(
        polygons=sums.footprints,
        vertices=sums.vertices,
        triangles=int(sums.totals[0, MEASURES.index("triangles")]),
        proven=0,
        counts=[[kind, reason, count] for (kind, reason), count in sorted(counts.items())],
        certified=None,
        about=about(part, json.loads(json.dumps(options)), code),
        notes=notes,
    )


COUNTING = Kind("counting", ".npz", count_part, read_counted)


def _counted(
    chunk: Chunk, options: Options, threads: int | None, counts: Counter[tuple[str, str]]
) -> Sums:
    """Triangulate a chunk's footprints by each triangulator and count them."""
    given = chunk.cleaned.polygons
    polygons, owners, vanished = on_pixels(given, options.units_per_pixel)
    names = options.triangulators
    table, failed = measured(polygons, owners, len(given), names, threads=threads)
    counts["dropped", "thinner than the grid of 1/256 px"] += vanished
    for name, bad in zip(names, failed, strict=True):
        counts["failed", name] += int(bad.sum())
    counts += Counter()  # a count of none is none
    kept = ~failed.any(axis=0) & np.isin(np.arange(len(given)), owners)
    table = table[:, kept]
    sums = sums_of(table, given[kept])
    sums.cells = _cells(chunk, kept, table[:, :, MEASURES.index("helper_lanes")], options.cell)
    return sums


def _cells(
    chunk: Chunk, kept: NDArray[np.bool_], lanes: NDArray[np.float64], cell: float
) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Footprints and their helper lanes (t, p) by cells of the source's coordinates."""
    middle = shapely.get_coordinates(shapely.centroid(chunk.cleaned.polygons[kept]))
    if chunk.projection is not None:
        middle = chunk.projection.inverse(middle)
    places, number = np.unique(
        np.floor(middle / cell).astype(np.int64), axis=0, return_inverse=True
    )
    weights = np.vstack([np.ones(len(middle)), lanes])
    sums = [np.bincount(number.ravel(), weights=row, minlength=len(places)) for row in weights]
    return dict(zip(map(tuple, places.tolist()), np.stack(sums, axis=1), strict=True))

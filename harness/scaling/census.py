"""A census: what each triangulator gains on every footprint of a data set, by exact counting.

A part's file holds sums, a histogram of the gains, and the sums of each cell of a map. They are
integers, but for the criteria, and small; so a country's are added up in a moment.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.export.apart import triangulate_many
from harness.export.export import counted_notes
from harness.rasterisers.reference import predict
from harness.scaling.dataset import Kind
from harness.scaling.part_files import AT_A_TIME, Done, about, lasting, make_part
from harness.scaling.parts import Part
from harness.scaling.snapping import on_pixels
from harness.stored.folder import UNREADABLE
from harness.stored.output import Output
from scenes.files import Chunk, read_chunks
from triangulators.batch.triangulate_many import Ragged, ragged

COUNTED = ("fragments", "quads", "helper_lanes", "blocks", "bbox_tests", "triangles")
PREDICTED = ("half_perimeter", "overdraw")
MEASURES = (*COUNTED, *PREDICTED)
"""Sums over a footprint's triangles: exact counters, then criteria in px and px^2."""

GAINED = ("quads", "helper_lanes", "blocks", "bbox_tests", *PREDICTED)
"""Measures that a choice of triangulation changes."""

BINS = 400
"""Bins of a gain, 0.5 % each, from -100 % to 100 %; what is beyond is in the first."""


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
    done = Done(
        polygons=sums.footprints,
        vertices=sums.vertices,
        triangles=int(sums.totals[0, MEASURES.index("triangles")]),
        proven=0,
        counts=[[kind, reason, count] for (kind, reason), count in sorted(counts.items())],
        certified=None,
        about=about(part, json.loads(json.dumps(asdict(options))), code),
        notes=notes,
    )
    with Output(place, forced=True) as output:
        told = json.dumps(lasting(done), sort_keys=True)
        with output.file() as file:
            np.savez_compressed(file, allow_pickle=False, told=np.array(told), **sums.arrays())
        output.publish()
    return done


def read_counted(file: Path) -> Done | None:
    """Return what a part's file says of itself; None where it is no such file, or is damaged."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return Done(**json.loads(str(arrays["told"])))
    except (*UNREADABLE, TypeError):
        return None


@dataclass
class Sums:
    """Sums over footprints, for t triangulators.

    totals : (t, len(MEASURES)) float64; integers but for the criteria
    bins : (t, len(GAINED), BINS) int64, footprints by what they gain
    cells : (column, row) to (t + 1,) float64: footprints, then each triangulator's helper lanes
    """

    footprints: int
    vertices: int
    totals: NDArray[np.float64]
    bins: NDArray[np.int64]
    cells: dict[tuple[int, int], NDArray[np.float64]]

    @classmethod
    def empty(cls, triangulators: int) -> Sums:
        """Return those of no footprint."""
        totals = np.zeros((triangulators, len(MEASURES)))
        return cls(0, 0, totals, np.zeros((triangulators, len(GAINED), BINS), np.int64), {})

    def add(self, other: Sums) -> None:
        """Add other footprints'."""
        self.footprints += other.footprints
        self.vertices += other.vertices
        self.totals += other.totals
        self.bins += other.bins
        for cell, values in other.cells.items():
            self.cells[cell] = self.cells[cell] + values if cell in self.cells else values

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file keeps."""
        cells = sorted(self.cells)
        width = len(self.totals) + 1
        return {
            "size": np.array([self.footprints, self.vertices], np.int64),
            "totals": self.totals,
            "bins": self.bins,
            "cells": np.array(cells, np.int64).reshape(-1, 2),
            "cell_sums": np.array([self.cells[cell] for cell in cells]).reshape(-1, width),
        }

    @classmethod
    def read(cls, file: Path) -> Sums:
        """Read what a part's file keeps."""
        with np.load(file, allow_pickle=False) as kept:
            footprints, vertices = kept["size"].tolist()
            places = map(tuple, kept["cells"].tolist())
            cells = dict(zip(places, kept["cell_sums"], strict=True))
            return cls(footprints, vertices, kept["totals"], kept["bins"], cells)


COUNTING = Kind("counting", ".npz", count_part, read_counted)


def total(folder: Path, keys: Iterable[str], triangulators: int) -> Sums:
    """Add up the files of parts."""
    sums = Sums.empty(triangulators)
    for key in keys:
        sums.add(Sums.read(folder / f"{key}.npz"))
    return sums


def _counted(
    chunk: Chunk, options: Options, threads: int | None, counts: Counter[tuple[str, str]]
) -> Sums:
    """Triangulate a chunk's footprints by each triangulator and count them."""
    given = chunk.cleaned.polygons
    polygons, owners, vanished = on_pixels(given, options.units_per_pixel)
    counts["dropped", "thinner than the grid of 1/256 px"] += vanished
    counts += Counter()  # a count of none is none
    arrays = ragged(polygons)
    measured: list[NDArray[np.float64]] = []
    failed = np.zeros(len(given), dtype=bool)
    for name in options.triangulators:
        columns, bad = _measured(arrays, owners, len(given), name, threads)
        measured.append(columns)
        failed |= bad
        counts["failed", name] += int(bad.sum())
    for name in options.triangulators:
        if not counts["failed", name]:
            del counts["failed", name]
    kept = ~failed & np.isin(np.arange(len(given)), owners)
    table = np.stack(measured)[:, kept]
    vertices = shapely.get_num_coordinates(given[kept]).sum()
    sums = Sums.empty(len(options.triangulators))
    sums.footprints, sums.vertices = int(kept.sum()), int(vertices)
    sums.totals = table.sum(axis=1)
    for measure, name in enumerate(GAINED):
        column = MEASURES.index(name)
        for triangulator in range(len(table)):
            gained = gains(table[0, :, column], table[triangulator, :, column])
            places = np.clip(np.floor((gained + 1.0) * BINS / 2), 0, BINS - 1).astype(int)
            sums.bins[triangulator, measure] = np.bincount(places, minlength=BINS)
    sums.cells = _cells(chunk, kept, table[:, :, MEASURES.index("helper_lanes")], options.cell)
    return sums


def gains(base: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (p,) how much less `other` is than `base`, relative to it; 0 where both are 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(base == other, 0.0, 1.0 - other / base)


def _measured(
    arrays: Ragged, owners: NDArray[np.int64], count: int, name: str, threads: int | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(count, len(MEASURES)) sums of each footprint, and (count,) which could not be done."""
    found = triangulate_many(arrays, name, check=False, threads=threads)
    rings = np.r_[0, arrays.ring_ends].astype(np.int64)
    begins = rings[np.r_[0, arrays.polygon_ends].astype(np.int64)]
    sizes = np.diff(found.starts)
    triangles = found.triangles + np.repeat(begins[:-1], sizes)[:, None].astype(np.int32)
    points = np.rint(arrays.coordinates * 256).astype(np.int32)
    each = predict(points, np.ascontiguousarray(triangles, np.int32))
    columns: dict[str, NDArray[Any]] = {**each, "triangles": np.ones(len(triangles))}
    columns |= _predictions(arrays.coordinates[triangles])
    owner = np.repeat(owners, sizes)
    table = np.column_stack(
        [np.bincount(owner, weights=columns[measure], minlength=count) for measure in MEASURES]
    ).astype(np.float64)
    failed = np.zeros(count, dtype=bool)
    failed[owners[list(found.failed)]] = True
    return table, failed


def _predictions(corners: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
    """What the criteria say of triangles (m, 3, 2): H in px, A in px^2."""
    width, height = np.ptp(corners, axis=1).T
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v = b - a, c - a
    area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    return {"half_perimeter": width + height, "overdraw": width * height - area}


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

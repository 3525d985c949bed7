"""Exact counts of a part's polygons for each triangulator, and the small files of these counts.

Each footprint is drawn alone on the pixel grid of a map. Polygons of map tiles are drawn as on a
map, clipped at their tile's edge, and summed by zoom and layer.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from harness.atomic import Output
from harness.frame import MARGIN_STEP_PX, UNBOUNDED
from harness.grid import SUBPIXEL, snap_polygons
from harness.rasterisers.reference import count_per_triangle
from harness.results.run_folder import UNREADABLE
from harness.scaling.dataset import CHUNK_ROWS, FilePart, PartResult
from harness.triangulating.triangulate import triangulate_many
from scenes.files import Chunk
from scenes.scene import NoteCounter
from scenes.slices import Tile
from triangulators.polygon_arrays import PolygonArray

PERIOD_PX = 4  # translations by multiples preserve 2x2 and 4x4 blocks, and all counters
TOO_THIN = "thinner than the grid of 1/256 px"
MAX_SIDE_PX = 8_000_000  # below 2^31 steps of 1/256 px, so that 32-bit integers hold coordinates
TOO_LARGE = f"wider or higher than {MAX_SIDE_PX:,} px"

GAINED = (  # depend on the triangulation: exact counters, then criteria in px and px^2
    *("quads", "helper_lanes", "partial_quads", "blocks", "bbox_tests"),
    *("half_perimeter", "overdraw"),
)

MEASURES = ("fragments", "triangles", *GAINED)  # sums over a footprint's triangles
BINS = 400  # of a gain's histogram, 0.5 % each, from -100 % (or less) to 100 %

COUNTS = ("tiles", "polygons", "vertices", "dropped", "repaired")
"""Counts of `Sums`: tiles with a polygon, dropped (undrawable) and repaired (invalid) polygons."""

Group = tuple[int | None, str]  # zoom and layer of polygons of map tiles
FOOTPRINTS: Group = (None, "")  # the group of all footprints


class Sums(NamedTuple):
    """Sums over footprints, or polygons of map tiles, for t triangulators."""

    counts: NDArray[np.int64]  # (len(COUNTS),)
    totals: NDArray[np.float64]  # (t, len(MEASURES)), integers except the criteria
    bins: NDArray[np.int64]  # (t, len(GAINED), BINS), number of polygons by gain

    @classmethod
    def empty(cls, triangulators: int, **counts: int) -> "Sums":
        """Return sums of 0 for t triangulators, with the given counts."""
        totals = np.zeros((triangulators, len(MEASURES)))
        bins = np.zeros((triangulators, len(GAINED), BINS), np.int64)
        return cls(np.array([counts.get(name, 0) for name in COUNTS], np.int64), totals, bins)

    def get_count(self, name: str) -> int:
        """Return a count by its name in `COUNTS`."""
        return int(self.counts[COUNTS.index(name)])

    def get_total(self, measure: str) -> NDArray[np.float64]:
        """Return a measure's sum for each triangulator, (t,)."""
        return self.totals[:, MEASURES.index(measure)]


@dataclass
class CensusCounts:
    """Counts of one or more parts."""

    groups: dict[Group, Sums] = field(default_factory=dict)
    cells: list[pd.DataFrame] = field(default_factory=list)  # x, y, footprints, helper lanes
    damaged: list[tuple[str, str]] = field(default_factory=list)  # (tile, reason)
    layers: set[str] = field(default_factory=set)  # names

    def add(self, group: Group, sums: Sums) -> None:
        """Add sums to a group."""
        old = self.groups.get(group)
        self.groups[group] = sums if old is None else Sums(*map(np.add, old, sums))

    def sum_groups(self) -> Sums:
        """Return the sum of all groups, of which there is at least one."""
        return Sums(*(sum(values) for values in zip(*self.groups.values(), strict=True)))

    def save(self, path: Path, done: PartResult) -> None:
        """Write a part's file, with these counts and the part's result, atomically."""
        cells = [_sum_cells(self.cells)] if self.cells else []
        content = {
            "done": asdict(done),
            "groups": list(self.groups),
            "cells": [list(frame) for frame in cells],
            "damaged": self.damaged,
            "known": sorted(self.layers),
        }
        arrays = {
            name: np.array([getattr(sums, name) for sums in self.groups.values()])
            for name in Sums._fields
        } | {"cells": np.array(cells, np.int64)}
        with Output(path, forced=True) as output:
            with output.open_published() as file:
                np.savez_compressed(file, allow_pickle=False, content=json.dumps(content), **arrays)
            output.publish()

    @classmethod
    def read(cls, files: Iterable[Path]) -> "CensusCounts":
        """Read and sum the files of parts."""
        result = cls()
        for file in files:
            with np.load(file, allow_pickle=False) as stored:
                content = json.loads(str(stored["content"]))
                arrays = zip(*(stored[name] for name in Sums._fields), strict=True)
                for (zoom, layer), sums in zip(content["groups"], arrays, strict=True):
                    result.add((zoom, layer), Sums(*sums))
                for rows, columns in zip(stored["cells"], content["cells"], strict=True):
                    result.cells.append(pd.DataFrame(rows, columns=columns))
            result.damaged += map(tuple, content["damaged"])
            result.layers.update(content["known"])
        if result.cells:
            result.cells = [_sum_cells(result.cells)]
        return result


def _sum_cells(cells: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(cells).groupby(["x", "y"], as_index=False).sum()


def read_part_result(file: Path) -> PartResult | None:
    """Return the result in a part's file, or None if the file is invalid."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return PartResult(**json.loads(str(arrays["content"]))["done"])
    except (*UNREADABLE, TypeError):
        return None


class _Batch(NamedTuple):
    """Polygons of a zoom and layer, their labels, and `times`: how many tiles repeat them."""

    group: Group
    polygons: NDArray[np.object_]
    labels: Sequence[str]
    times: int = 1


@dataclass
class PartCounter:
    """Counts of a part, and `waiting`, the polygons of tiles that are not counted yet."""

    triangulators: tuple[str, ...]
    threads: int | None
    counted: CensusCounts = field(default_factory=CensusCounts)
    noted: NoteCounter = field(default_factory=NoteCounter)
    notes: list[str] = field(default_factory=list)
    waiting: list[_Batch] = field(default_factory=list)

    def add_chunk(self, chunk: Chunk, units_per_pixel: float, cell: float) -> None:
        """Count the footprints of a chunk, also by map cells with sides of `cell` units."""
        self.noted.note("dropped", chunk.cleaned.dropped)
        self.noted.note("repaired", chunk.cleaned.repaired)
        self.notes += chunk.notes
        polygons = chunk.cleaned.polygons
        if not len(polygons):
            return
        labels = [chunk.labels[source] for source in chunk.cleaned.source.tolist()]
        counted, table = self.count_batch([_Batch(FOOTPRINTS, polygons, labels)], units_per_pixel)
        centres = shapely.get_coordinates(shapely.centroid(polygons[counted]))
        if chunk.projection is not None:
            centres = chunk.projection.inverse(centres)
        lanes = table[:, counted, MEASURES.index("helper_lanes")].astype(np.int64)
        names = ("x", "y", "footprints", *(f"helper_lanes {name}" for name in self.triangulators))
        cells = np.floor(centres / cell).astype(np.int64).T
        rows = np.vstack([cells, np.ones(len(centres), np.int64), lanes])
        self.counted.cells.append(pd.DataFrame(rows.T, columns=names))

    def add_tile(self, tile: Tile, side: int) -> list[Any]:
        """Add a tile's polygons to `waiting`, counted from `CHUNK_ROWS` on; return its layers."""
        self.counted.layers.update(tile.content.layer_names)
        if tile.damage:
            self.counted.damaged.append((tile.name, tile.damage))
            self.noted.counts["damaged", "tile or layer that cannot be read"] += tile.repeats
        layers = [layer for layer in tile.content.layers if len(layer.polygons) or layer.dropped]
        for layer in layers:
            numbers = {"tiles": tile.repeats * (len(layer.polygons) > 0)}
            label = f"{tile.name} {layer.name}"
            for kind, notes in (("dropped", layer.dropped), ("repaired", layer.repaired)):
                numbers[kind] = tile.repeats * len(notes)
                labelled = [(f"{label} {which}", why) for which, why in notes]
                self.noted.note(kind, labelled, tile.repeats)
            group = (tile.zoom, layer.name)
            self.counted.add(group, Sums.empty(len(self.triangulators), **numbers))
            labels = [f"{label} polygon {number}" for number in range(len(layer.polygons))]
            self.waiting.append(_Batch(group, layer.polygons, labels, tile.repeats))
        if sum(len(part.polygons) for part in self.waiting) >= CHUNK_ROWS:
            self.count_waiting(side)
        return layers

    def count_waiting(self, side: int) -> None:
        """Count and remove the waiting polygons, drawn in tiles of `side` pixels."""
        if any(len(part.polygons) for part in self.waiting):
            # The margin is a tile: polygons extend at most so far beyond the edge of their tile.
            margin = -(-side // MARGIN_STEP_PX) * MARGIN_STEP_PX
            window = np.array([margin, margin, margin + side - 1, margin + side - 1], np.int64)
            self.count_batch(self.waiting, 1.0, margin, window)
        self.waiting = []

    def count_batch(
        self,
        batch: Sequence[_Batch],
        units_per_pixel: float,
        margin: int | None = None,
        window: NDArray[np.int64] = UNBOUNDED,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Triangulate p polygons by each of t triangulators, and add the counts to the groups.

        Returns flags (p,) of the polygons that every triangulator triangulated, and the counts of
        all polygons, (t, p, len(MEASURES)).
        """
        sizes = [len(part.polygons) for part in batch]
        polygons = np.concatenate([part.polygons for part in batch])
        labels = [label for part in batch for label in part.labels]
        times = np.repeat([part.times for part in batch], sizes)
        count = len(polygons)
        sides = np.diff(shapely.bounds(polygons).reshape(-1, 2, 2), axis=1)[:, 0] / units_per_pixel
        small = np.flatnonzero(sides.max(axis=1) <= MAX_SIDE_PX)
        pieces, owners = scale_to_pixels(polygons[small], units_per_pixel, margin)
        arrays, owners = PolygonArray.from_shapely(pieces), small[owners]
        drawn = np.isin(np.arange(count), owners)
        lost = np.flatnonzero(~drawn)
        reasons = np.where(np.isin(lost, small), TOO_THIN, TOO_LARGE).tolist()
        skipped = [("dropped", k, why) for k, why in zip(lost.tolist(), reasons, strict=True)]
        tables = []
        for name in self.triangulators:
            table, failed = _count_shading(arrays, owners, count, name, window, self.threads)
            tables.append(table)
            for k, why in sorted(failed.items()):
                skipped.append(("failed", k, f"{name}: {why.removeprefix(f'{name}: ')}"))
        counted = np.ones(count, np.bool_)
        for kind, k, why in skipped:
            self.noted.note(kind, [(labels[k], why)], int(times[k]))
            counted[k] = False
        counts = np.stack(tables)
        for group in dict.fromkeys(part.group for part in batch):
            in_group = np.repeat([part.group == group for part in batch], sizes)
            members = in_group & counted
            dropped = int(times[in_group & ~drawn].sum())
            sums = _sum_counts(counts[:, members], polygons[members], times[members], dropped)
            self.counted.add(group, sums)
        return counted, counts

    def save(self, part: FilePart, path: Path) -> PartResult:
        """Write a part's file; return the part's result."""
        groups = self.counted.groups.values()
        done = PartResult(
            polygons=sum(sums.get_count("polygons") for sums in groups),
            triangles=int(sum(sums.get_total("triangles")[0] for sums in groups)),
            proven=0,
            counts=[[*which, count] for which, count in sorted((+self.noted.counts).items())],
            certified=None,
            about=part.about,
            notes=self.notes,
            left_out=self.noted.list_examples("dropped", "failed"),
        )
        self.counted.save(path, done)
        return done


def scale_to_pixels(
    polygons: NDArray[Any], units_per_pixel: float, margin: int | None = None
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Scale polygons to pixels, move each near the origin, and snap it to 1/256 px.

    Returns the pieces (p,), in px, and each piece's polygon; vanished polygons have none. Positions
    modulo `PERIOD_PX` are preserved; `margin` translates all alike, if positions matter.
    """
    # Near the origin, doubles represent 1/256 px exactly, as the reference's integers do.
    scaled = shapely.transform(polygons, lambda xy: xy / units_per_pixel)
    corner = shapely.bounds(scaled)[:, :2]
    shift = PERIOD_PX * np.floor(corner / PERIOD_PX)
    if margin is not None:
        shift[:] = -margin
    counts = shapely.get_num_coordinates(scaled)
    moved = shapely.get_coordinates(scaled) - np.repeat(shift, counts, axis=0)
    snapped = snap_polygons(shapely.set_coordinates(scaled, moved))
    return snapped.pieces, snapped.source


def _sum_counts(
    table: NDArray[np.float64], polygons: NDArray[Any], times: NDArray[np.int64], dropped: int
) -> Sums:
    """Sum the counts (t, p, len(MEASURES)) of p polygons, which occur `times` (p,) times."""
    corners = shapely.get_num_coordinates(polygons) - 1 - shapely.get_num_interior_rings(polygons)
    sums = Sums.empty(
        len(table),
        polygons=int(times.sum()),
        vertices=int((times * corners).sum()),
        dropped=dropped,
    )
    columns = table[:, :, [MEASURES.index(name) for name in GAINED]]
    gained = compute_gains(columns[0], columns)
    places = np.clip(np.floor((gained + 1.0) * BINS / 2), 0, BINS - 1).astype(int)
    which = np.arange(len(table))[:, None, None], np.arange(len(GAINED))
    np.add.at(sums.bins, (*which, places), times[:, None])
    return sums._replace(totals=(table * times[:, None]).sum(axis=1))


def compute_gains(base: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relative saving of `other` compared with `base`; 0 if both are 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(base == other, 0.0, 1.0 - other / base)


def _count_shading(
    polygons: PolygonArray,
    owners: NDArray[np.int64],
    count: int,
    name: str,
    window: NDArray[np.int64],
    threads: int | None,
) -> tuple[NDArray[np.float64], dict[int, str]]:
    """Triangulate pieces on the pixel grid, and sum `MEASURES` over each polygon's triangles.

    owners : (p,) index (0 to count - 1) of each piece's polygon; window : as `Frame.window`.
    Returns the sums (count, len(MEASURES)), and the reason of each failure by the polygon's index.
    """
    result = triangulate_many(polygons, name, check=False, threads=threads)
    sizes = np.diff(result.triangle_offsets)
    first = polygons.vertex_offsets[:-1].astype(np.int32)
    triangles = result.triangles + np.repeat(first, sizes)[:, None]
    points = np.rint(polygons.coords * SUBPIXEL).astype(np.int32)
    counters = count_per_triangle(points, np.ascontiguousarray(triangles, np.int32), window)
    columns: dict[str, NDArray[Any]] = {**counters, "triangles": np.ones(len(triangles))}
    corners = polygons.coords[triangles]
    width, height = np.ptp(corners, axis=1).T
    (u, v) = (corners[:, k] - corners[:, 0] for k in (1, 2))
    area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    columns |= {"half_perimeter": width + height, "overdraw": width * height - area}
    owner = np.repeat(owners, sizes)
    table = np.column_stack(
        [np.bincount(owner, weights=columns[measure], minlength=count) for measure in MEASURES]
    ).astype(np.float64)
    return table, {int(owners[piece]): why for piece, why in result.failed.items()}

"""Census: gains of each triangulator over all polygons of a data set, counted exactly.

Each footprint is drawn alone on the pixel grid of a map. Polygons of map tiles are drawn as on a
map, clipped at their tile's edge, and summed by zoom and layer.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from harness.frame import MARGIN_STEP_PX, UNBOUNDED
from harness.grid import SUBPIXEL, snap_polygons
from harness.rasterisers.reference import count_per_triangle
from harness.scaling.dataset import CHUNK_ROWS, FilePart, PartResult, PartWork
from harness.scaling.sums import (
    BINS,
    FOOTPRINTS,
    GAINED,
    MEASURES,
    CensusCounts,
    Group,
    Sums,
    read_part_result,
)
from harness.triangulating.isolated import triangulate_many
from scenes.files import Chunk, read_chunks
from scenes.scene import NoteCounter
from scenes.slices import Slices, Tile, TileSelection, cut_file, cut_tiles, read_tiles
from scenes.tiles.read import note_rounding
from triangulators.polygon_arrays import PolygonArray

PERIOD_PX = 4  # translations by multiples preserve 2x2 and 4x4 blocks, and all counters
TOO_THIN = "thinner than the grid of 1/256 px"


@dataclass(frozen=True)
class Counting(PartWork):
    """Options of both kinds of census; the first triangulator is the base of the gains."""

    title: ClassVar[str] = "counting"
    suffix: ClassVar[str] = ".npz"
    noun: ClassVar[str]
    read_result = staticmethod(read_part_result)

    triangulators: tuple[str, ...]


@dataclass(frozen=True)
class Census(Counting):
    """A census of footprints."""

    noun: ClassVar[str] = "footprints"

    units_per_pixel: float  # metres if the source is in degrees
    cell: float  # side of a map cell, in the source's units
    layer: str | None = None
    where: str | None = None

    def list_slices(self, path: str) -> Slices:
        """Return the slices of a file, which are ranges of rows."""
        return cut_file(path, self.layer, self.where)

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        """Count the footprints in a part's rows, and write the part's file."""
        counter = _Counter(self.triangulators, threads)
        for chunk in read_chunks(
            part.path, layer=self.layer, where=self.where, size=CHUNK_ROWS, rows=part.rows
        ):
            counter.add_chunk(chunk, self)
        return counter.save(part, path)


@dataclass(frozen=True)
class TileCensus(Counting):
    """A census of map tiles; `selection` has zooms, layers and a tile's side in pixels."""

    unit: ClassVar[str] = "tiles"
    noun: ClassVar[str] = "polygons"

    selection: TileSelection

    def list_slices(self, path: str) -> Slices:
        """Return the slices of an archive, which are ranges of tiles."""
        return cut_tiles(path, self.selection.zooms)

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        """Count the polygons of a part's tiles, and write the part's file."""
        counter = _Counter(self.triangulators, threads)
        assert part.rows is not None
        extents: set[int] = set()
        for tile in read_tiles(part.path, part.rows, self.selection):
            extents.update(layer.extent for layer in counter.add_tile(tile, self.selection.pixels))
        counter.count_waiting(self.selection.pixels)
        counter.notes += note_rounding(extents, self.selection.pixels)
        return counter.save(part, path)


class _Batch(NamedTuple):
    """Polygons of a zoom and layer, their labels, and `times`: how many tiles repeat them."""

    group: Group
    polygons: NDArray[np.object_]
    labels: Sequence[str]
    times: int = 1


@dataclass
class _Counter:
    """Counts of a part, and `waiting`, the polygons of tiles that are not counted yet."""

    triangulators: tuple[str, ...]
    threads: int | None
    counted: CensusCounts = field(default_factory=CensusCounts)
    noted: NoteCounter = field(default_factory=NoteCounter)
    notes: list[str] = field(default_factory=list)
    waiting: list[_Batch] = field(default_factory=list)

    def add_chunk(self, chunk: Chunk, census: Census) -> None:
        self.noted.note("dropped", chunk.cleaned.dropped)
        self.noted.note("repaired", chunk.cleaned.repaired)
        self.notes += chunk.notes
        polygons = chunk.cleaned.polygons
        if not len(polygons):
            return
        labels = [chunk.labels[source] for source in chunk.cleaned.source.tolist()]
        counted, table = self.count_batch(
            [_Batch(FOOTPRINTS, polygons, labels)], census.units_per_pixel
        )
        centres = shapely.get_coordinates(shapely.centroid(polygons[counted]))
        if chunk.projection is not None:
            centres = chunk.projection.inverse(centres)
        lanes = table[:, counted, MEASURES.index("helper_lanes")].astype(np.int64)
        names = ("x", "y", "footprints", *(f"helper_lanes {name}" for name in self.triangulators))
        cells = np.floor(centres / census.cell).astype(np.int64).T
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
            numbers = {"tiles": int(len(layer.polygons) > 0)}
            label = f"{tile.name} {layer.name}"
            for kind, notes in (("dropped", layer.dropped), ("repaired", layer.repaired)):
                numbers[kind] = len(notes)
                labelled = [(f"{label} {which}", why) for which, why in notes]
                self.noted.note(kind, labelled, tile.repeats)
            numbers = {name: tile.repeats * count for name, count in numbers.items()}
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
        pieces, owners = scale_to_pixels(polygons, units_per_pixel, margin)
        arrays = PolygonArray.from_shapely(pieces)
        drawn = np.isin(np.arange(len(polygons)), owners)
        skipped = [("dropped", k, TOO_THIN) for k in np.flatnonzero(~drawn).tolist()]
        tables = []
        for name in self.triangulators:
            table, failed = _count_shading(
                arrays, owners, len(polygons), name, window, self.threads
            )
            tables.append(table)
            for k, why in sorted(failed.items()):
                skipped.append(("failed", k, f"{name}: {why.removeprefix(f'{name}: ')}"))
        counted = np.ones(len(polygons), np.bool_)
        for kind, k, why in skipped:
            self.noted.note(kind, [(labels[k], why)], int(times[k]))
            counted[k] = False
        number = {group: k for k, group in enumerate(dict.fromkeys(part.group for part in batch))}
        groups = np.repeat([number[part.group] for part in batch], sizes)
        counts = np.stack(tables)
        for group, k in number.items():
            members = (groups == k) & counted
            dropped = int(times[(groups == k) & ~drawn].sum())
            sums = _sum_counts(counts[:, members], polygons[members], times[members], dropped)
            self.counted.add(group, sums)
        return counted, counts

    def save(self, part: FilePart, path: Path) -> PartResult:
        zero = Sums.empty(len(self.triangulators))
        sums = self.counted.sum_groups() if self.counted.groups else zero
        done = PartResult(
            polygons=sums.get_count("polygons"),
            triangles=int(sums.get_total("triangles")[0]),
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

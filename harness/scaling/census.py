"""A census: what each triangulator gains on every polygon of a data set, by exact counting.

Footprints are drawn on the pixel grid of a map, each by itself. Polygons of map tiles are drawn as
maps draw them, cut at their tile's edge, and added up for each zoom and layer.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.export.apart import triangulate_many
from harness.frame import MARGIN_STEP_PX, SUBPIXEL, WHOLE, snap
from harness.rasterisers.reference import predict
from harness.scaling.dataset import Kind
from harness.scaling.parts import AT_A_TIME, Done, Part, about, files, make_part
from harness.scaling.sums import (
    BINS,
    FOOTPRINTS,
    GAINED,
    MEASURES,
    Group,
    Sums,
    groups_of,
    read_counted,
    save,
    whole,
)
from scenes.cleaning.clean import Noted
from scenes.files import Chunk, read_chunks
from scenes.slices import Chosen, Slices, Tile, cut_tiles, is_folder, read_tiles
from scenes.tiles.read import rounding
from triangulators.ragged import Ragged, ragged

PERIOD_PX = 4
"""Moving a polygon by so many pixels changes no counter: blocks of 2x2 and 4x4 stay the same."""

THIN = "thinner than the grid of 1/256 px"


@dataclass(frozen=True)
class Options:
    """What a census of footprints counts.

    triangulators : full names; the first is the one that the others are compared with
    units_per_pixel : of the map on which footprints are drawn: metres, if they are in degrees
    cell : edge of a cell of the map, in the source's own units
    """

    triangulators: tuple[str, ...]
    units_per_pixel: float
    cell: float
    layer: str | None = None
    where: str | None = None


@dataclass(frozen=True)
class TileOptions:
    """What a census of tiles counts.

    triangulators : full names; the first is the one that the others are compared with
    chosen : zooms, layers and a tile's side in pixels
    """

    triangulators: tuple[str, ...]
    chosen: Chosen


class _Some(NamedTuple):
    """Polygons of a group, what each is called, and how often they are there in tiles."""

    group: Group
    polygons: NDArray[np.object_]
    named: Callable[[int], str]
    times: int = 1


@dataclass
class _Found:
    """What was found so far, and `waiting`, the polygons of tiles that are not counted yet."""

    options: Options | TileOptions
    threads: int | None
    groups: dict[Group, Sums] = field(default_factory=dict)
    noted: Noted = field(default_factory=Noted)
    notes: list[str] = field(default_factory=list)
    damaged: list[tuple[str, str]] = field(default_factory=list)
    known: set[str] = field(default_factory=set)
    waiting: list[_Some] = field(default_factory=list)

    def sums_of(self, group: Group) -> Sums:
        """Return the sums of a group, which may be there already."""
        return self.groups.setdefault(group, Sums.empty(len(self.options.triangulators)))

    def add_chunk(self, chunk: Chunk, options: Options) -> None:
        """Count the footprints of a chunk, and add them up by cells of the source's coordinates."""
        self.noted.note("dropped", chunk.cleaned.dropped)
        self.noted.note("repaired", chunk.cleaned.repaired)
        self.notes += chunk.notes
        given = chunk.cleaned.polygons
        if not len(given):
            return
        some = _Some(FOOTPRINTS, given, lambda k: chunk.labels[int(chunk.cleaned.source[k])])
        kept, table = self.count([some], options.units_per_pixel)
        middle = shapely.get_coordinates(shapely.centroid(given[kept]))
        if chunk.projection is not None:
            middle = chunk.projection.inverse(middle)
        places, number = np.unique(
            np.floor(middle / options.cell).astype(np.int64), axis=0, return_inverse=True
        )
        lanes = table[:, kept, MEASURES.index("helper_lanes")]
        weights = np.vstack([np.ones(len(middle)), lanes])
        sums = [np.bincount(number.ravel(), weights=row, minlength=len(places)) for row in weights]
        cells = zip(map(tuple, places.tolist()), np.stack(sums, axis=1), strict=True)
        self.sums_of(FOOTPRINTS).add_cells(dict(cells))

    def add_tile(self, tile: Tile, extents: set[int], options: TileOptions) -> None:
        """Take a tile in; count what waits, if that is enough."""
        self.known.update(tile.parts.known)
        if tile.damage:
            self.damaged.append((tile.name, tile.damage))
            self.noted.counts["damaged", "tile or layer that cannot be read"] += tile.times
        for own in tile.parts.layers:
            if not (len(own.polygons) or own.dropped):
                continue
            group = (tile.zoom, own.name)
            sums = self.sums_of(group)
            sums.tiles += tile.times if len(own.polygons) else 0
            sums.dropped += tile.times * len(own.dropped)
            sums.repaired += tile.times * len(own.repaired)
            place = f"{tile.name} {own.name}"
            for kind, notes in (("dropped", own.dropped), ("repaired", own.repaired)):
                placed = [(f"{place} {which}", why) for which, why in notes]
                self.noted.note(kind, placed, tile.times)
            extents.add(own.extent)
            named = f"{place} polygon {{}}".format
            self.waiting.append(_Some(group, own.polygons, named, tile.times))
        if sum(len(some.polygons) for some in self.waiting) >= AT_A_TIME:
            self.count_waiting(options.chosen.pixels)

    def count_waiting(self, side: int) -> None:
        """Count what waits, as tiles of `side` pixels show it."""
        if any(len(some.polygons) for some in self.waiting):
            # No polygon reaches further over the edge than a side.
            margin = -(-side // MARGIN_STEP_PX) * MARGIN_STEP_PX
            window = np.array([margin, margin, margin + side - 1, margin + side - 1], np.int64)
            self.count(self.waiting, 1.0, margin, window)
        self.waiting = []

    def count(
        self,
        batch: Sequence[_Some],
        units_per_pixel: float,
        margin: int | None = None,
        window: NDArray[np.int64] = WHOLE,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Triangulate a batch of p polygons by each triangulator, and add them to their groups.

        Returns which (p,) all could do, and what was counted, (t, p, len(MEASURES)).
        """
        sizes = [len(some.polygons) for some in batch]
        given = np.concatenate([some.polygons for some in batch])
        times = np.repeat([some.times for some in batch], sizes)
        pieces, owners = on_pixels(given, units_per_pixel, margin)
        arrays = ragged(pieces)
        names = self.options.triangulators
        tables, failures = zip(
            *(_measured(arrays, owners, len(given), name, window, self.threads) for name in names),
            strict=True,
        )
        table = np.stack(tables)
        of = np.repeat(np.arange(len(batch)), sizes)
        first = np.cumsum([0, *sizes])

        def note(kind: str, k: int, why: str) -> None:
            which = batch[of[k]].named(k - int(first[of[k]]))
            self.noted.note(kind, [(which, why)], int(times[k]))

        drawn = np.isin(np.arange(len(given)), owners)
        kept = drawn.copy()
        for k in np.flatnonzero(~drawn).tolist():
            note("dropped", k, THIN)
        for name, failed in zip(names, failures, strict=True):
            for k, why in sorted(failed.items()):
                # what it says of itself begins with its name already
                note("failed", k, why if why.startswith(f"{name}: ") else f"{name}: {why}")
                kept[k] = False
        for group in dict.fromkeys(some.group for some in batch):
            among = np.isin(of, [k for k, some in enumerate(batch) if some.group == group])
            own = among & kept
            sums = self.sums_of(group)
            sums.add(_added_up(table[:, own], given[own], times[own]))
            sums.dropped += int(times[among & ~drawn].sum())
        return kept, table


def count_part(
    part: Part, options: Options | TileOptions, out: str, code: str, threads: int | None = 1
) -> Done:
    """Count a part and put its file into the folder `out`, unless it is there.

    Raises as `make_part` does.
    """
    place = Path(out) / f"{part.key}.npz"
    return make_part(place, code, read_counted, lambda: _write(part, options, place, code, threads))


def _write(
    part: Part, options: Options | TileOptions, place: Path, code: str, threads: int | None
) -> Done:
    found = _Found(options, threads)
    if isinstance(options, TileOptions):
        assert part.rows is not None
        extents: set[int] = set()
        for tile in read_tiles(part.path, part.rows, options.chosen):
            found.add_tile(tile, extents, options)
        found.count_waiting(options.chosen.pixels)
        found.notes += rounding(extents, options.chosen.pixels)
    else:
        for chunk in read_chunks(
            part.path, layer=options.layer, where=options.where, size=AT_A_TIME, rows=part.rows
        ):
            found.add_chunk(chunk, options)
    sums = whole(found.groups, len(options.triangulators))
    done = Done(
        polygons=sums.footprints,
        vertices=sums.vertices,
        triangles=int(sums.totals[0, MEASURES.index("triangles")]),
        proven=0,
        counts=[[*which, count] for which, count in sorted((+found.noted.counts).items())],
        certified=None,
        about=about(part, json.loads(json.dumps(asdict(options))), code),
        notes=found.notes,
        left_out=found.noted.told("dropped", "failed"),
    )
    save(place, done, found.groups, {"damaged": found.damaged, "known": sorted(found.known)})
    return done


def _cut(path: str, options: Mapping[str, Any]) -> Slices:
    zooms = options["chosen"]["zooms"]
    return cut_tiles(path, None if zooms is None else (zooms[0], zooms[1]))


def archives(pattern: str) -> list[Path]:
    """Return the archives that a name or a pattern stands for; raises UsageError if none is."""
    return [Path(pattern).absolute()] if is_folder(pattern) else files(pattern)


COUNTING = Kind("counting", ".npz", count_part, read_counted)
TILE_COUNTING = Kind(
    "counting", ".npz", count_part, read_counted, unit="tiles", cut=_cut, files=archives
)


def also_found(folder: Path, keys: Iterable[str]) -> tuple[list[tuple[str, str]], list[str]]:
    """Return the tiles of parts that are damaged, and why; and the names of all layers."""
    found = [groups_of(folder / f"{key}.npz")[1] for key in keys]
    damaged = [(name, why) for each in found for name, why in each["damaged"]]
    return damaged, sorted({name for each in found for name in each["known"]})


def on_pixels(
    polygons: NDArray[Any], units_per_pixel: float, margin: int | None = None
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Scale polygons to pixels, move each near the origin, and snap it to 1/256 px.

    margin : pixels by which all are moved instead, where it matters at which pixel they lie

    Returns the pieces (p,), in px, and for each the number of its polygon; those that vanish on the
    grid have none. The place on the grid of pixels, modulo `PERIOD_PX`, is that of the coordinates.
    """
    # Near the origin doubles hold 1/256 px exactly, as the reference's integers do; what the grid
    # leaves valid, which is nearly all, is snapped at once, and the rest mended one by one.
    scaled = shapely.transform(polygons, lambda xy: xy / units_per_pixel)
    corner = shapely.bounds(scaled)[:, :2]
    shift = PERIOD_PX * np.floor(corner / PERIOD_PX)
    if margin is not None:
        shift[:] = -margin
    counts = shapely.get_num_coordinates(scaled)
    offsets = np.repeat(shift, counts, axis=0)
    near = shapely.set_coordinates(scaled, shapely.get_coordinates(scaled) - offsets)
    grid = shapely.transform(near, lambda xy: np.rint(xy * SUBPIXEL) / SUBPIXEL)
    good = shapely.is_valid(grid) & (shapely.area(grid) > 0)
    plain = shapely.remove_repeated_points(grid[good])
    good[good] = shapely.get_num_coordinates(plain) == counts[good]
    pieces: list[Any] = []
    source: list[int] = []
    for number in np.flatnonzero(~good).tolist():
        found, _ = snap(near[number])
        pieces += found
        source += [number] * len(found)
    made = np.array([*grid[good], *pieces], dtype=object)
    owners = np.r_[np.flatnonzero(good), np.array(source, dtype=np.int64)].astype(np.int64)
    order = np.argsort(owners, kind="stable")
    return shapely.orient_polygons(made[order]), owners[order]


def _added_up(table: NDArray[np.float64], polygons: NDArray[Any], times: NDArray[np.int64]) -> Sums:
    """Add up what was measured (t, p, len(MEASURES)) of p polygons.

    times : (p,) how often each is there
    """
    corners = shapely.get_num_coordinates(polygons) - 1 - shapely.get_num_interior_rings(polygons)
    sums = Sums.empty(len(table))
    sums.footprints, sums.vertices = int(times.sum()), int((times * corners).sum())
    sums.totals = (table * times[:, None]).sum(axis=1)
    for measure, name in enumerate(GAINED):
        column = MEASURES.index(name)
        for triangulator in range(len(table)):
            gained = gains(table[0, :, column], table[triangulator, :, column])
            places = np.clip(np.floor((gained + 1.0) * BINS / 2), 0, BINS - 1).astype(int)
            bins = np.bincount(places, weights=times, minlength=BINS)
            sums.bins[triangulator, measure] = bins.astype(np.int64)
    return sums


def gains(base: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (p,) how much less `other` is than `base`, relative to it; 0 where both are 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(base == other, 0.0, 1.0 - other / base)


def _measured(
    arrays: Ragged,
    owners: NDArray[np.int64],
    count: int,
    name: str,
    window: NDArray[np.int64],
    threads: int | None,
) -> tuple[NDArray[np.float64], dict[int, str]]:
    """Triangulate polygons by one triangulator, and count them.

    arrays, owners : p polygons on the grid of pixels, and which of `count` ones each is of
    window : what is drawn, as `Frame.window` is

    Returns (count, len(MEASURES)) sums, and why which of them could not be done.
    """
    found = triangulate_many(arrays, name, check=False, threads=threads)
    rings = np.r_[0, arrays.ring_ends].astype(np.int64)
    begins = rings[np.r_[0, arrays.polygon_ends].astype(np.int64)]
    sizes = np.diff(found.starts)
    triangles = found.triangles + np.repeat(begins[:-1], sizes)[:, None].astype(np.int32)
    points = np.rint(arrays.coordinates * SUBPIXEL).astype(np.int32)
    each = predict(points, np.ascontiguousarray(triangles, np.int32), window)
    columns: dict[str, NDArray[Any]] = {**each, "triangles": np.ones(len(triangles))}
    corners = arrays.coordinates[triangles]
    width, height = np.ptp(corners, axis=1).T
    (u, v) = (corners[:, k] - corners[:, 0] for k in (1, 2))
    area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    columns |= {"half_perimeter": width + height, "overdraw": width * height - area}
    owner = np.repeat(owners, sizes)
    table = np.column_stack(
        [np.bincount(owner, weights=columns[measure], minlength=count) for measure in MEASURES]
    ).astype(np.float64)
    return table, {int(owners[piece]): why for piece, why in found.failed.items()}

"""A census of map tiles: what each triangulator gains, for each zoom and layer of an archive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.export.export import counted_notes
from harness.frame import MARGIN_STEP_PX
from harness.scaling.census import done_of
from harness.scaling.counted import measured, sums_of
from harness.scaling.dataset import Kind
from harness.scaling.part_files import AT_A_TIME, Done, make_part
from harness.scaling.parts import Part, files
from harness.scaling.snapping import on_pixels
from harness.scaling.sums import Group, Sums, groups_of, read_counted, save, whole
from scenes.slices import Chosen, Slices, Tile, cut_tiles, is_folder, read_tiles
from scenes.tiles.tile import rounding


@dataclass(frozen=True)
class TileOptions:
    """What a census of tiles counts.

    triangulators : full names; the first is the one that the others are compared with
    chosen : zooms, layers and a tile's side in pixels
    """

    triangulators: tuple[str, ...]
    chosen: Chosen


def count_tiles(
    part: Part, options: TileOptions, out: str, code: str, threads: int | None = 1
) -> Done:
    """Count a part and put its file into the folder `out`, unless it is there.

    Raises as `make_part` does.
    """
    place = Path(out) / f"{part.key}.npz"
    return make_part(place, code, read_counted, lambda: _write(part, options, place, code, threads))


class _Some(NamedTuple):
    """Polygons of a layer of one tile, and how many tiles have just them."""

    group: Group
    polygons: NDArray[np.object_]
    times: int


@dataclass
class _Found:
    """What was found so far, and `waiting`, the polygons that are not counted yet."""

    options: TileOptions
    threads: int | None
    groups: dict[Group, Sums] = field(default_factory=dict)
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    damaged: list[tuple[str, str]] = field(default_factory=list)
    known: set[str] = field(default_factory=set)
    extents: set[int] = field(default_factory=set)
    waiting: list[_Some] = field(default_factory=list)

    def add(self, tile: Tile) -> None:
        """Take a tile in; count what waits, if that is enough."""
        self.known.update(tile.parts.known)
        if tile.damage:
            self.damaged.append((tile.name, tile.damage))
            self.counts["damaged", "tile or layer that cannot be read"] += tile.times
        for name, extent, own in tile.parts.layers:
            if not (len(own.polygons) or own.dropped):
                continue
            group = (tile.zoom, name)
            sums = self.groups.setdefault(group, Sums.empty(len(self.options.triangulators)))
            sums.tiles += tile.times if len(own.polygons) else 0
            sums.dropped += tile.times * len(own.dropped)
            sums.repaired += tile.times * len(own.repaired)
            for kind, notes in (("dropped", own.dropped), ("repaired", own.repaired)):
                for reason, count in counted_notes(kind, notes).items():
                    self.counts[reason] += tile.times * count
            self.extents.add(extent)
            self.waiting.append(_Some(group, own.polygons, tile.times))
        if sum(len(some.polygons) for some in self.waiting) >= AT_A_TIME:
            self.count()

    def count(self) -> None:
        """Triangulate what waits by each triangulator, and count it."""
        if any(len(some.polygons) for some in self.waiting):
            self._count()
        self.waiting = []

    def _count(self) -> None:
        names = self.options.triangulators
        sizes = [len(some.polygons) for some in self.waiting]
        given = np.concatenate([some.polygons for some in self.waiting])
        times = np.repeat([some.times for some in self.waiting], sizes)
        side = self.options.chosen.pixels
        # No polygon reaches further over the edge than a side.
        margin = -(-side // MARGIN_STEP_PX) * MARGIN_STEP_PX
        window = np.array([margin, margin, margin + side - 1, margin + side - 1], np.int64)
        pieces, owners, _ = on_pixels(given, 1.0, margin)
        table, failed = measured(pieces, owners, len(given), names, window, self.threads)
        drawn = np.isin(np.arange(len(given)), owners)
        kept = ~failed.any(axis=0) & drawn
        self.counts["dropped", "thinner than the grid of 1/256 px"] += int(times[~drawn].sum())
        for name, bad in zip(names, failed, strict=True):
            self.counts["failed", name] += int(times[bad].sum())
        of = np.repeat(np.arange(len(self.waiting)), sizes)
        for group in dict.fromkeys(some.group for some in self.waiting):
            among = np.isin(of, [k for k, some in enumerate(self.waiting) if some.group == group])
            own = among & kept
            self.groups[group].add(sums_of(table[:, own], given[own], times[own]))
            self.groups[group].dropped += int(times[among & ~drawn].sum())


def _write(part: Part, options: TileOptions, place: Path, code: str, threads: int | None) -> Done:
    assert part.rows is not None
    found = _Found(options, threads)
    for tile in read_tiles(part.path, part.rows, options.chosen):
        found.add(tile)
    found.count()
    found.counts += Counter()  # a count of none is none
    sums = whole(found.groups, len(options.triangulators))
    notes = rounding(found.extents, options.chosen.pixels)
    done = done_of(part, asdict(options), code, sums, found.counts, notes)
    more = {"damaged": found.damaged, "known": sorted(found.known)}
    save(place, done, found.groups, more)
    return done


def _cut(path: str, options: Mapping[str, Any]) -> Slices:
    zooms = options["chosen"]["zooms"]
    return cut_tiles(path, None if zooms is None else (zooms[0], zooms[1]))


def archives(pattern: str) -> list[Path]:
    """Return the archives that a name or a pattern stands for; raises UsageError if none is."""
    return [Path(pattern).absolute()] if is_folder(pattern) else files(pattern)


TILE_COUNTING = Kind(
    "counting", ".npz", count_tiles, read_counted, unit="tiles", cut=_cut, files=archives
)


def also_found(folder: Path, keys: Iterable[str]) -> tuple[list[tuple[str, str]], list[str]]:
    """Return the tiles of parts that are damaged, and why; and the names of all layers."""
    found = [groups_of(folder / f"{key}.npz")[1] for key in keys]
    damaged = [(name, why) for each in found for name, why in each["damaged"]]
    return damaged, sorted({name for each in found for name in each["known"]})

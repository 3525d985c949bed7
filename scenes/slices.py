"""Slices of files and of archives of map tiles; several machines can read slices in parallel.

A slice of GeoParquet is a range of rows, if possible of full row groups; of a file that GDAL can
read from the middle, a range of features; of map tiles, a range of tile numbers within a zoom.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenes.files import read_chunks
from scenes.readers import guard
from scenes.readers.geoparquet import find_geometry_column, import_parquet
from scenes.readers.guard import check_path
from scenes.readers.reader import Source, choose_reader
from scenes.readers.tile_archives import TilePosition, TileRun, open_archive
from scenes.scene import SceneError
from scenes.spec import convert_arguments, parse_name, path_exists
from scenes.tiles import PIXELS, TileContent, check_pixels, read_tile

MIN_ROWS, MAX_ROWS = 20_000, 50_000  # of a slice, if the file's row groups permit both
RANDOM_ACCESS = (".gpkg", ".fgb", ".shp")  # files in which GDAL skips features without reading

_COMPARISON = re.compile(
    r'^\s*("?)([\w.]+)\1\s*(<=|>=|<|>|=)\s*([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*$'
)


@dataclass(frozen=True)
class Slices:
    """The slices of a file.

    identity : 16 hexadecimal digits that change with the file's content
    rows : range of rows (first, stop) of each slice; None for the complete file
    sizes : number of rows of each slice; 0 if unknown
    pruned : number of rows that are in no slice, because no such row can meet the condition
    """

    identity: str
    rows: list[tuple[int, int] | None]
    sizes: list[int]
    pruned: int = 0


def cut_file(path: str, layer: str | None = None, where: str | None = None) -> Slices:
    """Return slices of `MIN_ROWS` to `MAX_ROWS` rows; reads the file's footer or header only.

    Row groups of GeoParquet are skipped if their statistics exclude a match of `where`.
    """
    file = check_path(path)
    reader = choose_reader(file)
    if reader.function == "scenes.readers.geoparquet:read":
        with guard.raise_scene_errors(path, reader.kind):
            return _cut_parquet(Source(file, layer), where)
    identity = compute_identity(file)
    if file.suffix.lower() not in RANDOM_ACCESS or where is not None:
        return Slices(identity, [None], [0])
    with guard.raise_scene_errors(path, reader.kind):
        import pyogrio

        from scenes.readers.vector import choose_layer

        name, _ = choose_layer(Source(file, layer))
        count = pyogrio.read_info(file, layer=name, force_feature_count=True)["features"]
    ranges = [(start, min(start + MAX_ROWS, count)) for start in range(0, count, MAX_ROWS)]
    return Slices(identity, [*ranges], [last - first for first, last in ranges])


def _cut_parquet(source: Source, where: str | None) -> Slices:
    parquet = import_parquet(source)
    file = source.path
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 8))
        tail = stream.read()
        if tail[-4:] != b"PAR1":
            raise guard.make_truncation_error(file, "no PAR1 at the end")
        footer = int.from_bytes(tail[:4], "little")
        stream.seek(-8 - footer, 2)
        identity = compute_identity(file, stream.read())
    metadata = parquet.read_metadata(file)
    find_geometry_column(source, metadata.schema.to_arrow_schema())
    parsed_comparisons = parse_comparisons(where)
    rows: list[tuple[int, int]] = []
    start = pruned = 0
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        end = start + group.num_rows
        if not _may_group_match(group, parsed_comparisons):
            pruned += group.num_rows
        elif (
            rows
            and rows[-1][1] == start
            and min(start - rows[-1][0], group.num_rows) < MIN_ROWS
            and end - rows[-1][0] <= MAX_ROWS
        ):
            rows[-1] = (rows[-1][0], end)
        elif group.num_rows:
            pieces = -(-group.num_rows // MAX_ROWS)
            bounds = np.linspace(start, end, pieces + 1).astype(int).tolist()
            rows += list(pairwise(bounds))
        start = end
    return Slices(identity, [*rows], [last - first for first, last in rows], pruned)


def has_degrees(file: Path, layer: str | None = None) -> bool:
    """Whether a file's first features are in longitude and latitude; False if unreadable."""
    with suppress(SceneError):
        return next(read_chunks(str(file), layer=layer, attributes=False)).projection is not None
    return False


def parse_comparisons(where: str | None) -> list[tuple[str, str, float]]:
    """Return (column, comparison, number) for each comparison of a conjunction; [] for other forms.

    >>> parse_comparisons("bbox.xmin > 24.5 AND height = 3 AND name LIKE 'A'")
    []
    >>> parse_comparisons("bbox.xmin > 24.5 and height = 3")
    [('bbox.xmin', '>', 24.5), ('height', '=', 3.0)]
    """
    parsed = []
    for clause in re.split(r"\band\b", where or "", flags=re.IGNORECASE):
        match = _COMPARISON.match(clause)
        if match is None:
            return []
        parsed.append((match[2], match[3], float(match[4])))
    return parsed


def _may_group_match(group: Any, parsed_comparisons: list[tuple[str, str, float]]) -> bool:
    """Whether a row that meets all comparisons may exist in a row group, by its statistics."""
    columns = {group.column(i).path_in_schema: i for i in range(group.num_columns)}
    for name, comparison, value in parsed_comparisons:
        statistics = group.column(columns[name]).statistics if name in columns else None
        if statistics is None or not statistics.has_min_max:
            continue
        low, high = statistics.min, statistics.max
        if not (isinstance(low, (int, float)) and isinstance(high, (int, float))):
            continue
        may_match = {
            "<": low < value,
            "<=": low <= value,
            ">": high > value,
            ">=": high >= value,
            "=": low <= value <= high,
        }
        if not may_match[comparison]:
            return False
    return True


def compute_identity(file: Path, footer: bytes | None = None) -> str:
    """Return a digest of a file's or folder's name, size, modification time and content.

    The content is `footer`, by default both ends of a file and of the files that belong to it, or a
    list of files.
    """
    digest = hashlib.sha256()
    parts = [file]
    if file.suffix.lower() == ".shp":  # attributes, reference system and encoding
        suffixes = (".dbf", ".prj", ".cpg", ".DBF", ".PRJ", ".CPG")
        parts += [part for part in map(file.with_suffix, suffixes) if part.is_file()]
    for part in parts:
        status = part.stat()
        text = f"{part.name}\0{status.st_size}\0{int(status.st_mtime)}\0"
        digest.update(text.encode())
    log = file.with_name(f"{file.name}-wal")
    if footer is not None:
        digest.update(footer)
    elif file.is_dir():
        files = ((entry, entry.stat()) for entry in sorted(file.rglob("*")) if entry.is_file())
        lines = (f"{entry.relative_to(file)} {s.st_size} {int(s.st_mtime)}" for entry, s in files)
        digest.update("\n".join(lines).encode())
    else:
        for part in (*parts, log) if log.is_file() else parts:
            digest.update(b"".join(guard.read_both_ends(part)))
    return digest.hexdigest()[:16]


MAX_TILES, MAX_BYTES = 4096, 2**21  # tiles, and stored bytes, of a slice of several tiles
_TILE = re.compile(r"\.mvt(\.gz)?$", re.IGNORECASE)
_ARCHIVE = re.compile(r"\.(pmtiles|mbtiles)$", re.IGNORECASE)


@dataclass(frozen=True)
class TileSelection:
    """Zooms (first, last) and layers of an archive, each None for all, and a tile's side in px."""

    zooms: tuple[int, int] | None = None
    layers: tuple[str, ...] | None = None
    pixels: int = PIXELS


def parse_tile_selection(text: str) -> tuple[str, TileSelection] | None:
    """Return the path or pattern of map tiles, and the selection; None for other files.

    >>> parse_tile_selection("berlin.pmtiles:zoom=12-16,layers=water")
    ('berlin.pmtiles', TileSelection(zooms=(12, 16), layers=('water',), pixels=512))
    >>> parse_tile_selection("berlin.gpkg") is None
    True
    """
    name, parameters = parse_name(text)
    has_archives = any(_ARCHIVE.search(entry.name) for entry in [Path(name), *_list_folder(name)])
    has_tile_options = not {"zoom", "layers", "pixels"}.isdisjoint(parameters)
    if not (has_tile_options or has_archives or _TILE.search(name) or is_tile_folder(name)):
        return None
    return name, _build_selection(**convert_arguments(name, _build_selection, parameters))


def _build_selection(
    *, zoom: str | None = None, layers: str | None = None, pixels: int = PIXELS
) -> TileSelection:
    """Return the selection for parameters as text: zoom "14" or "12-16", layers "area,water"."""
    check_pixels(pixels)
    names = None if layers is None else tuple(layers.split(","))
    if zoom is None:
        return TileSelection(None, names, pixels)
    match = re.fullmatch(r"(\d{1,2})(?:-(\d{1,2}))?", zoom)
    first, last = map(int, (match[1], match[2] or match[1])) if match else (1, 0)
    if first > last:
        raise SceneError(f"zoom={zoom} is invalid: give zoom=14 or zoom=12-16")
    return TileSelection((first, last), names, pixels)


def is_tile_folder(name: str) -> bool:
    """Whether a path is a folder that contains tiles, or folders of zooms."""
    return any(
        _TILE.search(entry.name) or (entry.name.isdecimal() and entry.is_dir())
        for entry in _list_folder(name)
    )


def _list_folder(name: str) -> list[Path]:
    return list(Path(name).iterdir()) if path_exists(name) and Path(name).is_dir() else []


def cut_tiles(path: str, zooms: tuple[int, int] | None) -> Slices:
    """Return the slices of an archive: ranges of tile numbers, and their numbers of runs."""
    file = check_path(path)
    rows: list[tuple[int, int] | None] = []
    sizes: list[int] = []
    with guard.raise_scene_errors(path, "map tiles"):
        archive = open_archive(file)
        for zoom in archive.select_zooms(path, zooms):
            for first, last, size in _cut_tile_runs(archive.list_tile_runs(zoom)):
                rows.append((first, last))
                sizes.append(size)
    if not rows:
        raise SceneError(f"{path} holds no tile of the requested zooms: give another zoom")
    return Slices(compute_identity(file), rows, sizes)


def _cut_tile_runs(runs: Iterable[TileRun]) -> Iterator[tuple[int, int, int]]:
    """Yield (first tile, stop tile, number of runs of equal tiles) of each slice of a zoom."""
    first = last = tiles = size = 0
    for run in runs:
        if tiles and (tiles == MAX_TILES or size + run.size > MAX_BYTES):
            yield first, last, tiles
            tiles = size = 0
        if not tiles:
            first = run.first
        last, tiles, size = run.first + run.repeats, tiles + 1, size + run.size
    if tiles:
        yield first, last, tiles


class Tile(NamedTuple):
    """A tile that was read, its zoom or None, and the number of consecutive equal tiles."""

    name: str
    zoom: int | None
    repeats: int
    content: TileContent

    @property
    def damage(self) -> str:
        """The reasons why the tile, or some of its layers, cannot be read, or ""."""
        layers = (
            f"layer {name}".strip() + f" {reason}"
            for name, reason in self.content.unreadable_layers
        )
        return "; ".join(filter(None, (*layers, self.content.damage)))


def read_tiles(path: str, numbers: tuple[int, int], selection: TileSelection) -> Iterator[Tile]:
    """Yield the tiles with numbers in range(*numbers); unreadable layers are skipped and noted."""
    with guard.raise_scene_errors(path, "map tiles"):
        archive = open_archive(check_path(path))
        for run in archive.list_tile_runs(archive.get_zoom(numbers[0]), *numbers):
            name = archive.get_tile_key(run.first)
            zoom = name.zoom if archive.zooms and isinstance(name, TilePosition) else None
            content = read_tile(archive, name, selection.layers, selection.pixels)
            yield Tile(str(name), zoom, run.repeats, content)

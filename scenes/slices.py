"""Cuts files into slices of rows that can be read apart from each other, by different machines.

A slice is a run of row groups of a GeoParquet file, or a part of one that is too large, or a run of
features of a file that GDAL can read from the middle. Everything else is one slice.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio

from scenes.files import read_chunks
from scenes.readers import damage
from scenes.readers.geoparquet import geometry_column, pyarrow_parquet
from scenes.readers.opening import existing
from scenes.readers.reader import Source, reader_of
from scenes.readers.vector import layer_of
from scenes.scene import SceneError

LEAST, MOST = 20_000, 50_000
"""Rows of a slice: fewer are joined with their neighbours, more are cut, where the file allows."""

RANDOM = (".gpkg", ".fgb", ".shp")
"""Suffixes of files that GDAL reads from the middle without reading what comes before."""

_EDGE = 65_536
_COMPARISON = re.compile(
    r'^\s*("?)([\w.]+)\1\s*(<=|>=|<|>|=)\s*([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*$'
)
_TESTS: dict[str, Callable[[float, float, float], bool]] = {
    "<": lambda low, _, value: low < value,
    "<=": lambda low, _, value: low <= value,
    ">": lambda _, high, value: high > value,
    ">=": lambda _, high, value: high >= value,
    "=": lambda low, high, value: low <= value <= high,
}
"""Whether a range (low, high) holds anything that compares so with the value."""


@dataclass(frozen=True)
class Slices:
    """A file in slices.

    identity : 16 hexadecimal digits that change with the file's content
    rows : the first row and the one after the last of each slice; None stands for the whole file
    sizes : how many rows each slice has; 0 where that is not known before it is read
    pruned : rows of slices that are left out because no row of theirs can meet the condition
    """

    identity: str
    rows: list[tuple[int, int] | None]
    sizes: list[int]
    pruned: int = 0


def cut(path: str, layer: str | None = None, where: str | None = None) -> Slices:
    """Cut a file into slices of `LEAST` to `MOST` rows; reads its footer or header alone.

    Where `where` is a conjunction of comparisons of a column with a number, such as
    `bbox.xmin > 24.5 AND bbox.xmax < 25`, row groups of a GeoParquet file whose statistics exclude
    it are left out. Raises SceneError if the file is missing or cannot be read.
    """
    file = existing(path)
    reader = reader_of(file)
    if reader.function == "scenes.readers.geoparquet:read":
        with damage.clear_errors(path, reader.kind):
            return _of_parquet(Source(file, layer), where)
    sliced = file.suffix.lower() in RANDOM and where is None
    identity = identity_of(file, edges(file))
    if not sliced:
        return Slices(identity, [None], [0])
    with damage.clear_errors(path, reader.kind):
        name, _ = layer_of(Source(file, layer))
        count = pyogrio.read_info(file, layer=name, force_feature_count=True)["features"]
    whole = [(start, min(start + MOST, count)) for start in range(0, count, MOST)]
    return Slices(identity, [*whole], [last - first for first, last in whole])


def _of_parquet(source: Source, where: str | None) -> Slices:
    parquet = pyarrow_parquet(source)
    file = source.path
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 8))
        end = stream.read()
        if end[-4:] != b"PAR1":
            raise SceneError(
                f"{file} cannot be read as GeoParquet: it does not end as such a file does "
                "(it was cut off: write or copy it again)"
            )
        footer = int.from_bytes(end[:4], "little")
        stream.seek(-8 - footer, 2)
        identity = identity_of(file, stream.read())
    metadata = parquet.read_metadata(file)
    geometry_column(source, metadata.schema.to_arrow_schema())
    wanted = comparisons(where)
    rows: list[tuple[int, int]] = []
    start = pruned = 0
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        end = start + group.num_rows
        if not _may_match(group, wanted):
            pruned += group.num_rows
        elif rows and rows[-1][1] == start and _joined(rows[-1], group.num_rows):
            rows[-1] = (rows[-1][0], end)
        elif group.num_rows:
            pieces = -(-group.num_rows // MOST)
            bounds = np.linspace(start, end, pieces + 1).astype(int).tolist()
            rows += list(pairwise(bounds))
        start = end
    return Slices(identity, [*rows], [last - first for first, last in rows], pruned)


def _joined(before: tuple[int, int], more: int) -> bool:
    """Whether a row group of `more` rows becomes a part of the slice before it."""
    size = before[1] - before[0]
    return min(size, more) < LEAST and size + more <= MOST


def in_degrees(file: Path) -> bool:
    """Whether a file's coordinates are longitude and latitude, by its first features.

    False where it cannot be read, which whoever reads all of it says.
    """
    try:
        first = next(read_chunks(str(file), size=1))
    except (SceneError, StopIteration):
        return False
    return first.projection is not None


def comparisons(where: str | None) -> list[tuple[str, str, float]]:
    """The (column, comparison, number) that every row which meets the condition meets, too.

    Of a condition that says more than `AND` between comparisons, nothing is taken for sure.

    >>> comparisons("bbox.xmin > 24.5 AND height = 3 AND name LIKE 'A'")
    []
    >>> comparisons("bbox.xmin > 24.5 and height = 3")
    [('bbox.xmin', '>', 24.5), ('height', '=', 3.0)]
    """
    found = []
    for clause in re.split(r"\band\b", where or "", flags=re.IGNORECASE):
        match = _COMPARISON.match(clause)
        if match is None:
            return []
        found.append((match[2], match[3], float(match[4])))
    return found


def _may_match(group: Any, wanted: list[tuple[str, str, float]]) -> bool:
    """Whether a row group's statistics allow for a row that meets all comparisons."""
    if not wanted:
        return True
    columns = {group.column(i).path_in_schema: i for i in range(group.num_columns)}
    for name, comparison, value in wanted:
        if name not in columns:
            continue
        statistics = group.column(columns[name]).statistics
        if statistics is None or not statistics.has_min_max:
            continue
        low, high = statistics.min, statistics.max
        numbers = all(isinstance(each, (int, float)) for each in (low, high))
        if numbers and not _TESTS[comparison](low, high, value):
            return False
    return True


def edges(file: Path) -> bytes:
    """The first and the last bytes of a file, and of SQLite's log beside it; a folder's names."""
    if file.is_dir():
        return "\n".join(sorted(each.name for each in file.iterdir())).encode()
    log = file.with_name(f"{file.name}-wal")
    return _ends(file) + (_ends(log) if log.is_file() else b"")


def _ends(file: Path) -> bytes:
    with file.open("rb") as stream:
        head = stream.read(_EDGE)
        stream.seek(max(0, file.stat().st_size - _EDGE))
        return head + stream.read()


def identity_of(file: Path, content: bytes) -> str:
    """A digest of a file's name, size, time of change and of what of its content was read."""
    about = file.stat()
    digest = hashlib.sha256(f"{file.name}\0{about.st_size}\0{int(about.st_mtime)}\0".encode())
    digest.update(content)
    return digest.hexdigest()[:16]

"""Properties of GeoJSON that GDAL does not report: sequences of lines, and reference systems.

GDAL silently skips invalid lines of a GeoJSON sequence, and takes an unknown reference system for
longitude and latitude.
"""

import json
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from scenes.cleaning.projection import find_system
from scenes.readers.guard import MAX_LINE_CHARACTERS, number_lines, read_both_ends
from scenes.readers.reader import RawChunk
from scenes.scene import Note, SceneError

_GEOMETRIES = ("Point", "LineString", "Polygon", "GeometryCollection")
_KINDS = ("Feature", *_GEOMETRIES, *(f"Multi{kind}" for kind in _GEOMETRIES[:3]))
_SEQUENCES = (".geojsonl", ".geojsons", ".ndgeojson", ".ndjson", ".jsonl", ".nljson")
_DEGREES_CRS = "EPSG:4326"


def find_crs(path: Path, crs: str | None) -> str | None:
    """Return the reference system of a file, given the system `crs` that GDAL reports.

    GeoJSON of 2008 may state a system in its member `crs`, before or after the features; null means
    no system. For a name that GDAL does not know, GDAL reports longitude and latitude. TopoJSON
    has no reference system; as in GeoJSON, coordinates are longitude and latitude.
    """
    is_json = path.suffix.lower() in (".geojson", ".json", ".topojson") and path.is_file()
    if not is_json or crs not in (None, _DEGREES_CRS):
        return crs
    head, tail = read_both_ends(path)
    if crs is None:
        return _DEGREES_CRS if re.search(rb'"type"\s*:\s*"Topology"', head + tail) else None
    around = head.partition(b'"features"')[0] + tail.rpartition(b"]")[2]
    member = r'"crs"\s*:\s*(?:\{.*?"(?:name|href)"\s*:\s*)?(null|"[^"]*")'
    match = re.search(member, around.decode("utf-8", "replace"), re.DOTALL)
    if match is None:
        return crs
    name: str | None = json.loads(match[1])
    return name if find_system(name) is None else crs


def is_sequence(path: Path) -> bool:
    """Whether a file is a GeoJSON sequence, one object per line, by suffix or first line."""
    if path.suffix.lower() not in (".json", ".geojson") or not path.is_file():
        return path.suffix.lower() in _SEQUENCES
    with path.open("rb") as stream:
        first, more = stream.readline(MAX_LINE_CHARACTERS).strip(), stream.read(4096).strip()
    if first.startswith((b"\x1e", b"\xef\xbb\xbf\x1e")):
        return True
    if re.search(rb'"type"\s*:\s*"(FeatureCollection|Topology|CityJSON)"', first[:4096]):
        return False
    try:
        return bool(more) and isinstance(json.loads(first), dict)
    except (ValueError, RecursionError):
        return False


def find_skipped_lines(
    path: Path, count: int, failures: int, *, is_complete: bool, size: int
) -> Iterator[RawChunk]:
    """Yield chunks without geometries, with notes on the lines that GDAL skipped.

    Raises SceneError if GDAL skipped lines that are valid.

    count : number of features that were read
    failures : number of failures that GDAL reported; GDAL may have skipped more lines
    is_complete : True if all features were requested; then each line should be a feature
    size : maximum number of notes in a chunk
    """
    lines = sum(1 for _, line in number_lines(path) if not line.isspace()) if is_complete else 0
    if not failures and count >= lines:
        return
    skipped = _find_invalid_lines(path)
    while notes := list(islice(skipped, size)):
        count += len(notes)
        yield RawChunk([], [], dropped=notes)
    if count < lines:
        raise SceneError(
            f"{path} has {lines} features, but GDAL reads only some of them: write the file "
            "again, without a byte order mark"
        )


def _find_invalid_lines(path: Path) -> Iterator[Note]:
    """Yield a note on each line that is not JSON, or not a feature or geometry."""
    for number, line in number_lines(path):
        text = line.strip("\x1e\ufeff \t\r\n")
        try:
            if text and json.loads(text)["type"] not in _KINDS:
                raise KeyError
        except (ValueError, RecursionError):
            yield f"line {number}", "is not JSON"
        except (KeyError, TypeError):
            yield f"line {number}", "is JSON, but not a feature"

"""Geometries as WKT, EWKT, WKB and hexadecimal WKB: parsing, and readers of files of these."""

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.readers.gdal import linearize
from scenes.readers.guard import (
    MAX_DEPTH,
    check_last_line,
    is_wkb_too_deep,
    is_wkt_too_deep,
    number_lines,
)
from scenes.readers.reader import RawChunk, Source
from scenes.scene import Note

_DEEP = f"is nested more than {MAX_DEPTH} levels deep"
UNPARSABLE = "geometry cannot be parsed"
CURVED = "has curves; replaced by chords of 4 degrees"
_SRID = re.compile(r"\s*SRID\s*=\s*(\d+)\s*;\s*", re.IGNORECASE)
_GEOMETRY_START = re.compile(
    r"\s*\"?\s*(SRID|POLYGON|MULTI|GEOM|[0-9A-F]{10}|\w{1,20}\s*$)", re.IGNORECASE
)
"""Beginning of a line that is meant as a geometry, even if the line is truncated."""


def parse_wkb(
    values: Sequence[bytes | None] | NDArray[Any], labels: Sequence[str]
) -> tuple[NDArray[Any], list[Note], list[Note]]:
    """Return geometries (None if unparsable), notes on unparsable values, and notes on repairs.

    values : (E)WKB or None; labels : names of the values in notes. A repair replaces curves by
    straight edges, or closes open rings.

    >>> parse_wkb([None, shapely.Point(1, 2).wkb], ["a", "b"])[0].tolist()
    [None, <POINT (1 2)>]
    """
    deep = [value is not None and is_wkb_too_deep(value) for value in values]
    flat = [None if nested else value for value, nested in zip(values, deep, strict=True)]
    try:
        geometries = shapely.from_wkb(np.array([*flat, None], dtype=object), on_invalid="ignore")
    except NotImplementedError:  # raised if any geometry has curves
        geometries = np.array([*map(_parse_geometry, flat), None], dtype=object)
    geometries = geometries[:-1]
    dropped: list[Note] = []
    repaired: list[Note] = []
    for i in np.flatnonzero(shapely.is_missing(geometries)).tolist():
        if not values[i]:
            continue
        geometries[i], change = (None, _DEEP) if deep[i] else _repair_geometry(values[i])
        (dropped if geometries[i] is None else repaired).append((labels[i], change))
    return geometries, dropped, [note for note in repaired if note[1]]


def parse_wkt(text: str) -> tuple[Any | None, str]:
    """Return the geometry of WKT and a note on its repair, or "".

    If the text cannot be parsed, return None and the reason.
    """
    if is_wkt_too_deep(text):
        return None, _DEEP
    geometry = _parse_geometry(text)
    return (geometry, "") if geometry is not None else _repair_geometry(text)


def _parse_geometry(source: str | bytes | None) -> Any | None:
    """Return the geometry of WKT or WKB, or None if it is invalid or has curves."""
    parse = shapely.from_wkt if isinstance(source, str) else shapely.from_wkb
    try:
        return parse(source, on_invalid="ignore")
    except NotImplementedError:
        return None


def _repair_geometry(source: Any) -> tuple[Any | None, str]:
    """Return the geometry of WKT or WKB that GEOS rejects, and a note on its repair.

    If the input cannot be repaired, return None and the reason.
    """
    parse = shapely.from_wkt if isinstance(source, str) else shapely.from_wkb
    is_curved = False
    try:
        geometry = parse(source, on_invalid="fix")
    except NotImplementedError:
        geometry, is_curved = None, True
    if geometry is not None:
        return geometry, "has an open ring; closed"
    straight = linearize(source)
    geometry = None if straight is None else shapely.from_wkb(straight, on_invalid="ignore")
    if geometry is not None:
        return geometry, CURVED if is_curved else ""
    return None, f"{UNPARSABLE}: curves" if is_curved else UNPARSABLE


def read_text(source: Source, size: int) -> Iterator[RawChunk]:
    """Yield the geometries of a text file: one per line, or a single geometry over several lines.

    Lines that begin with `#` are comments. The SRID of the first geometry is the file's reference
    system; lines with another SRID are skipped, with a note.
    """
    single = _parse_single(source)
    if single is not None:
        yield single
        return
    check_last_line(source.path, _is_complete_line)
    numbered = number_lines(source.path)
    crs, is_first = None, True
    while chunk := list(islice(numbered, size)):
        raw = _parse_lines(chunk, crs, is_first)
        crs, is_first = raw.crs, is_first and not len(raw.geometries)
        yield raw


def _parse_single(source: Source) -> RawChunk | None:
    """Return a chunk with the single geometry of a file, or None.

    None if the file is larger than 10 MB, has one line, or as a whole is not one geometry.
    """
    if source.path.stat().st_size > 10_000_000:
        return None
    text = source.path.read_text(encoding="utf-8-sig", errors="replace").strip()
    if "\n" not in text:
        return None
    label = "geometry 1"
    geometry, crs, change = _parse_line(" ".join(text.split()))
    if geometry is None:
        return None
    return RawChunk([geometry], [label], crs=crs, repaired=[(label, change)] if change else [])


def _is_complete_line(line: bytes) -> bool:
    """Whether a line is a complete geometry, or not meant as a geometry at all."""
    text = line.decode("utf-8", "replace")
    return _GEOMETRY_START.match(text) is None or _parse_line(text)[0] is not None


def _parse_lines(chunk: list[tuple[int, str]], crs: str | None, is_first: bool) -> RawChunk:
    """Return the geometries of lines, given as (number, text).

    crs : the file's reference system, if known; is_first : True if the first geometry determines
    `crs`
    """
    geometries: list[Any] = []
    labels: list[str] = []
    dropped: list[Note] = []
    repaired: list[Note] = []
    for number, line in chunk:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        label = f"line {number}"
        geometry, srid, change = _parse_line(line)
        if geometry is None:
            dropped.append((label, change))
            continue
        if is_first and crs is None:
            crs = srid
        if srid not in (None, crs):
            dropped.append((label, f"is in {srid}, previous lines in {crs or 'none'}"))
            continue
        geometries.append(geometry)
        labels.append(label)
        repaired += [(label, change)] if change else []
    return RawChunk(geometries, labels, crs=crs, dropped=dropped, repaired=repaired)


def _parse_line(text: str) -> tuple[Any | None, str | None, str]:
    """Return geometry, reference system and a note on the repair of WKT, EWKT or hexadecimal WKB.

    The note is "" without a repair. For text that cannot be parsed the geometry is None, and the
    third value is the reason.
    """
    match = _SRID.match(text)
    crs = f"EPSG:{match[1]}" if match else None
    body = text[match.end() :] if match else text
    body = body.strip().strip('"')
    if re.fullmatch(r"(?:[0-9A-Fa-f]{2})+", body):
        (geometry,), dropped, repaired = parse_wkb([bytes.fromhex(body)], [""])
        change = next((note for _, note in (*dropped, *repaired)), "")
    else:
        geometry, change = (None, "") if "\0" in body else parse_wkt(body)
    if geometry is None:
        is_explained = change not in ("", UNPARSABLE)
        return None, None, change if is_explained else "is not WKT or hexadecimal WKB"
    return geometry, crs or _find_embedded_crs(geometry), change


def read_binary(source: Source, size: int) -> Iterator[RawChunk]:  # noqa: ARG001 - one geometry
    """Yield the parts of the geometry in a file of (E)WKB, as one chunk."""
    (geometry,), dropped, repaired = parse_wkb([source.path.read_bytes()], ["the geometry"])
    if geometry is None:
        raise ValueError(dropped[0][1] if dropped else "empty file")
    parts = shapely.get_parts(geometry)
    labels = [f"geometry {i}" for i in range(len(parts))]
    crs = _find_embedded_crs(geometry)
    yield RawChunk(np.asarray(parts, dtype=object), labels, crs=crs, repaired=repaired)


def _find_embedded_crs(geometry: Any) -> str | None:
    """Return the reference system of a geometry's SRID, or None without an SRID."""
    srid = shapely.get_srid(geometry)
    return f"EPSG:{srid}" if srid > 0 else None

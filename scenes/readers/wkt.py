"""Geometries as WKT, EWKT, WKB and hexadecimal WKB: parsing, and readers of files of these."""

import re
import struct
from collections.abc import Iterator, Sequence
from itertools import accumulate, islice
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.readers.gdal import linearize, split_srid
from scenes.readers.guard import check_last_line, number_lines
from scenes.readers.reader import RawChunk, Source
from scenes.scene import Note

MAX_DEPTH = 100  # nesting of a geometry that is parsed, because GEOS recurses

_POINT, _LINE, _POLYGON, _ARC = 1, 2, 3, 8
# Geometry types in WKB that contain geometries: multi-points to collections, and curves.
_CONTAINERS = (4, 5, 6, 7, 9, 10, 11, 12)
_DEEP = f"is nested more than {MAX_DEPTH} levels deep"
UNPARSABLE = "geometry cannot be parsed"
CURVED = "has curves; replaced by chords of 4 degrees"
_SRID = re.compile(r"\s*SRID\s*=\s*(\d+)\s*;\s*", re.IGNORECASE)
_GEOMETRY_START = re.compile(
    r"\s*\"?\s*(SRID|POLYGON|MULTI|GEOM|[0-9A-F]{10}|\w{1,20}\s*$)", re.IGNORECASE
)
"""Beginning of a line that is meant as a geometry, even if the line is truncated."""


def is_wkt_too_deep(text: str) -> bool:
    """Whether WKT is nested deeper than `MAX_DEPTH`: GEOS recurses and could overflow the stack.

    >>> is_wkt_too_deep("POLYGON ((0 0, 1 0, 1 1, 0 0))"), is_wkt_too_deep("(" * 101)
    (False, True)
    """
    if text.count("(") <= MAX_DEPTH:
        return False
    steps = ((match[0] == "(") - (match[0] == ")") for match in re.finditer(r"[()]", text))
    return max(accumulate(steps)) > MAX_DEPTH


def is_wkb_too_deep(wkb: bytes) -> bool:
    """Whether (E)WKB is nested deeper than `MAX_DEPTH`; False for bytes that are not WKB.

    >>> level = bytes.fromhex("010700000001000000")
    >>> point = bytes.fromhex("0101000000") + bytes(16)
    >>> is_wkb_too_deep(99 * level), is_wkb_too_deep(101 * level + point)
    (False, True)
    """
    if len(wkb) <= 9 * MAX_DEPTH:  # too short: each level of nesting has at least 9 bytes
        return False
    order, offset = "<", 0
    unread = [1]  # number of geometries to read at each level
    try:
        while unread:
            if unread[-1] == 0:
                unread.pop()
                continue
            unread[-1] -= 1
            order = {0: ">", 1: "<"}.get(wkb[offset], order)
            number = struct.Struct(order + "I").unpack_from
            (code,) = number(wkb, offset + 1)
            offset += 9 if code & 0x20000000 else 5  # byte order, type, and an SRID if flagged
            flat, kind = divmod(code & 0xFFFF, 1000)
            has_height = bool(code & 0x80000000) or flat in (1, 3)
            has_measure = bool(code & 0x40000000) or flat in (2, 3)
            point = 8 * (2 + has_height + has_measure)
            if kind == _POINT:
                offset += point
                continue
            (count,) = number(wkb, offset)
            offset += 4
            if kind in _CONTAINERS:
                if count and len(unread) > MAX_DEPTH:
                    return True
                unread.append(count)
            elif kind == _POLYGON:
                for _ in range(count):
                    offset += 4 + point * number(wkb, offset)[0]
            elif kind in (_LINE, _ARC):
                offset += point * count
            else:
                return False
    except (struct.error, IndexError):  # not WKB, or truncated
        pass
    return False


def parse_wkb(
    values: Sequence[bytes | None] | NDArray[Any], labels: Sequence[str]
) -> tuple[NDArray[Any], list[Note], list[Note]]:
    """Return geometries (None if unparsable), notes on unparsable values, and notes on repairs.

    values : (E)WKB or None. A repair replaces curves by straight edges, or closes open rings.

    >>> parse_wkb([None, shapely.Point(1, 2).wkb], ["a", "b"])[0].tolist()
    [None, <POINT (1 2)>]
    """
    deep = [value is not None and is_wkb_too_deep(value) for value in values]
    flat = [None if nested else value for value, nested in zip(values, deep, strict=True)]
    try:
        geometries = shapely.from_wkb(np.array([*flat, None], dtype=object), on_invalid="ignore")
    except NotImplementedError:  # raised if any geometry has curves: parse each below
        geometries = np.full(len(flat) + 1, None)
    geometries = geometries[:-1]
    dropped: list[Note] = []
    repaired: list[Note] = []
    for i in np.flatnonzero(shapely.is_missing(geometries)).tolist():
        if not values[i]:
            continue
        geometries[i], change = (None, _DEEP) if deep[i] else _parse_geometry(values[i])
        (dropped if geometries[i] is None else repaired).append((labels[i], change))
    return geometries, dropped, [note for note in repaired if note[1]]


def _parse_geometry(source: Any) -> tuple[Any | None, str]:
    """Return the geometry of WKT or WKB and a note on its repair or "", or None and the reason."""
    parse = shapely.from_wkt if isinstance(source, str) else shapely.from_wkb
    is_curved = False
    try:
        if (geometry := parse(source, on_invalid="ignore")) is not None:
            return geometry, ""
        if (geometry := parse(source, on_invalid="fix")) is not None:
            return geometry, "has an open ring; closed"
    except NotImplementedError:
        is_curved = True
    straight = linearize(source)
    geometry = None if straight is None else shapely.from_wkb(straight, on_invalid="ignore")
    if geometry is not None:
        if not isinstance(source, str):
            geometry = shapely.set_srid(geometry, split_srid(source)[1])
        return geometry, CURVED if is_curved else ""
    return None, f"{UNPARSABLE}: curves" if is_curved else UNPARSABLE


def read_text(source: Source, size: int) -> Iterator[RawChunk]:
    """Yield the geometries of a text file: one per line, or a single geometry over several lines.

    The SRID of the first geometry is the file's; lines with another are skipped, with a note.
    """
    single = _parse_single(source)
    if single is not None:
        yield single
        return
    check_last_line(source.path, _is_complete_line)
    numbered = number_lines(source.path)
    crs: str | None = None
    is_first = True
    while chunk := list(islice(numbered, size)):
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
            if is_first:
                crs, is_first = srid, False
            if srid not in (None, crs):
                dropped.append((label, f"is in {srid}, previous lines in {crs or 'none'}"))
                continue
            geometries.append(geometry)
            labels.append(label)
            repaired += [(label, change)] if change else []
        yield RawChunk(geometries, labels, crs=crs, dropped=dropped, repaired=repaired)


def _parse_single(source: Source) -> RawChunk | None:
    """Return the single geometry of a file of several lines and at most 10 MB, or None."""
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


def _parse_line(text: str) -> tuple[Any | None, str | None, str]:
    """Return geometry, crs and a note on the repair of a line.

    If the line cannot be parsed, the geometry is None, and the note is the reason.
    """
    match = _SRID.match(text)
    crs = f"EPSG:{match[1]}" if match else None
    body = text[match.end() :] if match else text
    body = body.strip().strip('"')
    if re.fullmatch(r"(?:[0-9A-Fa-f]{2})+", body):
        (geometry,), dropped, repaired = parse_wkb([bytes.fromhex(body)], [""])
        change = next((note for _, note in (*dropped, *repaired)), "")
    elif "\0" in body:
        geometry, change = None, ""
    else:
        geometry, change = (None, _DEEP) if is_wkt_too_deep(body) else _parse_geometry(body)
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
    srid = shapely.get_srid(geometry)
    return f"EPSG:{srid}" if srid > 0 else None

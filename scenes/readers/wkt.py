"""Text and binary geometries without a container: WKT, EWKT, hexadecimal WKB, WKB."""

import re
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
import shapely

from scenes.readers.guard import DEEPEST, numbered_lines, refuse_unended, text_too_deep, too_deep
from scenes.readers.reader import Raw, Source
from scenes.scene import Note

_SRID = re.compile(r"\s*SRID\s*=\s*(\d+)\s*;\s*", re.IGNORECASE)
_BEGUN = re.compile(r"\s*\"?\s*(SRID|POLYGON|MULTI|GEOM|[0-9A-F]{10}|\w{1,20}\s*$)", re.IGNORECASE)
"""How a line begins that is meant as a geometry, of whose first word some letters may be there."""


def read_text(source: Source, size: int) -> Iterator[Raw]:
    """One geometry per line, or one over several lines; `#` begins a comment.

    The first SRID is the file's; a line with another one is named and left out.
    """
    whole = _single(source)
    if whole is not None:
        yield whole
        return
    refuse_unended(source.path, _ended)
    numbered = numbered_lines(source.path)
    crs, first = None, True
    while chunk := list(islice(numbered, size)):
        raw = _lines(chunk, crs, first)
        crs, first = raw.crs, first and not len(raw.geometries)
        yield raw


def _single(source: Source) -> Raw | None:
    """The file as one geometry, if it is small and has not one geometry per line."""
    if source.path.stat().st_size > 10_000_000:
        return None
    text = source.path.read_text(encoding="utf-8-sig", errors="replace").strip()
    if "\n" not in text:
        return None
    geometry, crs = _parsed(" ".join(text.split()))
    return None if geometry is None else Raw([geometry], ["geometry 1"], crs=crs)


def _ended(line: bytes) -> bool:
    """Whether a line is a geometry, or does not begin as one."""
    text = line.decode("utf-8", "replace")
    return _BEGUN.match(text) is None or _parsed(text)[0] is not None


def _lines(chunk: list[tuple[int, str]], crs: str | None, first: bool) -> Raw:
    """A chunk; `crs` is the file's so far, which the first geometries may give."""
    geometries: list[Any] = []
    labels: list[str] = []
    dropped: list[Note] = []
    for number, line in chunk:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        geometry, found = _parsed(line)
        if geometry is None:
            dropped.append((f"line {number}", "is not a geometry in WKT or hexadecimal WKB"))
            continue
        if first and crs is None:
            crs = found
        if found not in (None, crs):
            dropped.append((f"line {number}", f"is in {found}, lines before it in {crs or 'none'}"))
            continue
        geometries.append(geometry)
        labels.append(f"line {number}")
    return Raw(geometries, labels, crs=crs, dropped=dropped)


def _parsed(text: str) -> tuple[Any | None, str | None]:
    """Geometry and reference system of WKT, EWKT or hexadecimal WKB; None, None for others."""
    match = _SRID.match(text)
    crs = f"EPSG:{match[1]}" if match else None
    body = text[match.end() :] if match else text
    body = body.strip().strip('"')
    if "\0" in body or text_too_deep(body):
        return None, None
    if re.fullmatch(r"(?:[0-9A-Fa-f]{2})+", body):
        wkb = bytes.fromhex(body)
        geometry = None if too_deep(wkb) else shapely.from_wkb(wkb, on_invalid="ignore")
    else:
        geometry = shapely.from_wkt(body, on_invalid="ignore")
    return (None, None) if geometry is None else (geometry, crs or _embedded(geometry))


def read_binary(source: Source, size: int) -> Iterator[Raw]:  # noqa: ARG001 - one geometry
    """One geometry in (E)WKB."""
    wkb = source.path.read_bytes()
    if too_deep(wkb):
        raise ValueError(f"it is nested more than {DEEPEST} levels deep")
    geometry = shapely.from_wkb(wkb)
    parts = shapely.get_parts(geometry)
    labels = [f"geometry {i}" for i in range(len(parts))]
    yield Raw(np.asarray(parts, dtype=object), labels, crs=_embedded(geometry))


def _embedded(geometry: Any) -> str | None:
    srid = shapely.get_srid(geometry)
    return f"EPSG:{srid}" if srid > 0 else None

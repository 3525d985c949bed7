"""Text and binary geometries without a container: WKT, EWKT, hexadecimal WKB, WKB."""

import re
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
import shapely

from scenes.readers.guard import check_last_line, numbered_lines
from scenes.readers.reader import Raw, Source
from scenes.readers.wkb import UNPARSABLE, parse_wkb, parse_wkt
from scenes.scene import Note

_SRID = re.compile(r"\s*SRID\s*=\s*(\d+)\s*;\s*", re.IGNORECASE)
_BEGUN = re.compile(r"\s*\"?\s*(SRID|POLYGON|MULTI|GEOM|[0-9A-F]{10}|\w{1,20}\s*$)", re.IGNORECASE)
"""How a line begins that is meant as a geometry, of whose first word some letters may be there."""


def read_text(source: Source, size: int) -> Iterator[Raw]:
    """Yield one geometry per line, or one over several lines; `#` begins a comment.

    The first SRID is the file's; a line with another one is named and skipped.
    """
    single = _parse_single(source)
    if single is not None:
        yield single
        return
    check_last_line(source.path, _is_ended)
    numbered = numbered_lines(source.path)
    crs, is_first = None, True
    while chunk := list(islice(numbered, size)):
        raw = _parse_lines(chunk, crs, is_first)
        crs, is_first = raw.crs, is_first and not len(raw.geometries)
        yield raw


def _parse_single(source: Source) -> Raw | None:
    """Return the file as one geometry, or None if it is large or has one geometry per line."""
    if source.path.stat().st_size > 10_000_000:
        return None
    text = source.path.read_text(encoding="utf-8-sig", errors="replace").strip()
    if "\n" not in text:
        return None
    label = "geometry 1"
    geometry, crs, change = _parse_line(" ".join(text.split()))
    if geometry is None:
        return None
    return Raw([geometry], [label], crs=crs, repaired=[(label, change)] if change else [])


def _is_ended(line: bytes) -> bool:
    """Whether a line is a geometry, or does not begin as one."""
    text = line.decode("utf-8", "replace")
    return _BEGUN.match(text) is None or _parse_line(text)[0] is not None


def _parse_lines(chunk: list[tuple[int, str]], crs: str | None, is_first: bool) -> Raw:
    """Return a chunk of lines; `crs` is the file's so far, which the first geometry may define."""
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
            dropped.append((label, f"is in {srid}, lines before it in {crs or 'none'}"))
            continue
        geometries.append(geometry)
        labels.append(label)
        repaired += [(label, change)] if change else []
    return Raw(geometries, labels, crs=crs, dropped=dropped, repaired=repaired)


def _parse_line(text: str) -> tuple[Any | None, str | None, str]:
    """Return geometry, reference system and change of WKT, EWKT or hexadecimal WKB.

    If the geometry is None, the third value is the reason.
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
        is_known = change not in ("", UNPARSABLE)
        return None, None, change if is_known else "is not a geometry in WKT or hexadecimal WKB"
    return geometry, crs or _embedded_crs(geometry), change


def read_binary(source: Source, size: int) -> Iterator[Raw]:  # noqa: ARG001 - one geometry
    """Yield the parts of one geometry in (E)WKB."""
    (geometry,), dropped, repaired = parse_wkb([source.path.read_bytes()], ["the geometry"])
    if geometry is None:
        raise ValueError(f"it {dropped[0][1]}" if dropped else "it is empty")
    parts = shapely.get_parts(geometry)
    labels = [f"geometry {i}" for i in range(len(parts))]
    crs = _embedded_crs(geometry)
    yield Raw(np.asarray(parts, dtype=object), labels, crs=crs, repaired=repaired)


def _embedded_crs(geometry: Any) -> str | None:
    srid = shapely.get_srid(geometry)
    return f"EPSG:{srid}" if srid > 0 else None

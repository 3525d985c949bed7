"""Text and binary geometries without a container: WKT, EWKT, hexadecimal WKB, WKB."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
import shapely

from scenes.readers.lines import numbered_lines
from scenes.readers.reader import Raw, Source
from scenes.scene import Note

_SRID = re.compile(r"\s*SRID\s*=\s*(\d+)\s*;\s*", re.IGNORECASE)


def read_text(source: Source, size: int) -> Iterator[Raw]:
    """One geometry per line, or one over several lines; `#` begins a comment."""
    whole = _single(source)
    if whole is not None:
        yield whole
        return
    numbered = numbered_lines(source.path)
    while chunk := list(islice(numbered, size)):
        yield _lines(chunk)


def _single(source: Source) -> Raw | None:
    """The file as one geometry, if it is small and has not one geometry per line."""
    if source.path.stat().st_size > 10_000_000:
        return None
    text = source.path.read_text(encoding="utf-8", errors="replace").strip()
    if "\n" not in text:
        return None
    geometry, crs = _parsed(" ".join(text.split()))
    return None if geometry is None else Raw([geometry], ["geometry 1"], crs=crs)


def _lines(chunk: list[tuple[int, str]]) -> Raw:
    geometries: list[Any] = []
    labels: list[str] = []
    dropped: list[Note] = []
    crs = None
    for number, line in chunk:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        geometry, found = _parsed(line)
        if geometry is None:
            dropped.append((f"line {number}", "is not a geometry in WKT or hexadecimal WKB"))
            continue
        crs = crs or found
        geometries.append(geometry)
        labels.append(f"line {number}")
    return Raw(geometries, labels, crs=crs, dropped=dropped)


def _parsed(text: str) -> tuple[Any | None, str | None]:
    """Geometry and reference system of WKT, EWKT or hexadecimal WKB; None, None for others."""
    match = _SRID.match(text)
    crs = f"EPSG:{match[1]}" if match else None
    body = text[match.end() :] if match else text
    body = body.strip().strip('"')
    if "\0" in body:
        return None, None
    parse = shapely.from_wkb if re.fullmatch(r"[0-9A-Fa-f]+", body) else shapely.from_wkt
    geometry = parse(body, on_invalid="ignore")
    return (None, None) if geometry is None else (geometry, crs or _embedded(geometry))


def read_binary(source: Source, size: int) -> Iterator[Raw]:  # noqa: ARG001 - one geometry
    """One geometry in (E)WKB."""
    geometry = shapely.from_wkb(source.path.read_bytes())
    parts = shapely.get_parts(geometry)
    labels = [f"geometry {i}" for i in range(len(parts))]
    yield Raw(np.asarray(parts, dtype=object), labels, crs=_embedded(geometry))


def _embedded(geometry: Any) -> str | None:
    srid = shapely.get_srid(geometry)
    return f"EPSG:{srid}" if srid > 0 else None

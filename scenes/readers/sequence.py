"""Lines of a GeoJSON sequence that give no feature: GDAL leaves them out without a word."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from scenes.readers.opening import numbered_lines
from scenes.readers.reader import Raw
from scenes.scene import Note

_GEOMETRIES = ("Point", "LineString", "Polygon", "GeometryCollection")
_KINDS = ("Feature", *_GEOMETRIES, *(f"Multi{kind}" for kind in _GEOMETRIES[:3]))


def lost(path: Path, read: int, heard: int, *, all_wanted: bool, size: int) -> Iterator[Raw]:
    """Chunks without geometry, whose notes name the lines that gave no feature.

    read : features that came of the file
    heard : failures that GDAL reported; it reports fewer than there are
    all_wanted : whether no condition left features out, so that their number can be compared
    """
    if not heard and not (all_wanted and read < _lines(path)):
        return
    unread = _unread(path)
    while notes := list(islice(unread, size)):
        yield Raw([], [], dropped=notes)


def _lines(path: Path) -> int:
    """Lines that hold something; where each one has an end, without decoding them."""
    return sum(1 for _, line in numbered_lines(path) if not line.isspace())


def _unread(path: Path) -> Iterator[Note]:
    for number, line in numbered_lines(path):
        text = line.strip("\x1e\ufeff \t\r\n")
        if not text:
            continue
        try:
            kind = json.loads(text)["type"]
        except (ValueError, RecursionError):
            yield f"line {number}", "is not JSON"
        except (KeyError, TypeError):
            yield f"line {number}", "is JSON, but not a feature"
        else:
            if kind not in _KINDS:
                yield f"line {number}", "is JSON, but not a feature"

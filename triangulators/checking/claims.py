"""A certificate with its polygon as plain data, for a file that any program can check.

What the fields mean is in docs/reference/files.md; harness/export/check_evidence.py checks them and
shares no code with this package.
"""

import json
import math
from collections.abc import Callable
from itertools import chain
from typing import Any

import numpy as np
import shapely

from triangulators.checking.evidence import Certificate, Evidence, Refused
from triangulators.polygon import rings_of

FORMAT = "raster-harness evidence 1"
_ABOUT = {"format", "criterion", "rings", "triangles", "cost", "lower_bound", "gap", "proven"}
_FIELDS = _ABOUT | {"scale", "factor", "bits", "edges", "potentials", "lift"}


def as_claim(
    polygon: shapely.Polygon, triangles: np.ndarray, criterion: str, certificate: Certificate
) -> dict[str, Any]:
    """Return what a certificate says of triangles (m, 3) of a polygon, for JSON.

    Coordinates are doubles; everything that is compared is a whole number. Without evidence the
    claim is not proven, and `potentials` is None.
    """
    points, ends = rings_of(polygon)
    claim: dict[str, Any] = {
        "format": FORMAT,
        "criterion": criterion,
        "rings": [ring.tolist() for ring in np.split(points, ends[:-1])],
        "triangles": np.asarray(triangles).tolist(),
        "cost": certificate.cost,
        "lower_bound": certificate.lower_bound if certificate.evidence else None,
        "gap": certificate.gap if certificate.evidence else None,
        "proven": certificate.proven,
        "potentials": None,
    }
    evidence = certificate.evidence
    if evidence is not None:
        claim |= {
            "scale": evidence.scale,
            "factor": evidence.factor,
            "bits": evidence.bits,
            "edges": evidence.edges.tolist(),
            "potentials": evidence.potentials.tolist(),
            "lift": int(evidence.lift),
        }
    return claim


def from_claim(line: str) -> tuple[shapely.Polygon, np.ndarray, str, Certificate]:
    """Return polygon, triangles (m, 3), criterion and certificate of a claim with evidence.

    line: a claim as JSON. Raises `Refused` unless each field is there once, no other is, and all
    values are of their type: what an array would round, cut or read from text is another claim.
    """
    try:
        claim = json.loads(line, object_pairs_hook=_named_once)
        if not isinstance(claim, dict) or claim.get("format") != FORMAT or set(claim) != _FIELDS:
            raise TypeError(f"a claim has the format {FORMAT} and its fields, no others")
        rings = [_rows(ring, 2, _double) for ring in claim["rings"]]
        evidence = Evidence(
            _double(claim["scale"]),
            _whole(claim["factor"]),
            _whole(claim["bits"]),
            _rows(claim["edges"], 2, _whole),
            _array(claim["potentials"]),
            _whole(claim["lift"]),
        )
        triangles = _rows(claim["triangles"], 3, _whole)
        cost, low, gap = (_double(claim[name]) for name in ("cost", "lower_bound", "gap"))
        if type(claim["proven"]) is not bool or type(claim["criterion"]) is not str:
            raise TypeError("proven is true or false, and a criterion has a name")
        # Closed here: shapely would take a last vertex that repeats the first for the closing one.
        closed = [np.concatenate((ring, ring[:1])) for ring in rings]
        polygon = shapely.Polygon(closed[0], closed[1:])
    except (LookupError, OverflowError, RecursionError, TypeError, ValueError) as error:
        raise Refused(f"this is no claim: {error}") from error
    except shapely.errors.GEOSException as error:
        raise Refused(f"this is no polygon: {error}") from error
    certificate = Certificate(cost, low, gap, claim["proven"], evidence)
    return polygon, triangles, claim["criterion"], certificate


def _named_once(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of an object of JSON, none of which is given twice."""
    if len(dict(fields)) < len(fields):
        raise TypeError("a field is given twice")
    return dict(fields)


def _rows(rows: Any, width: int, of: Callable[[Any], Any]) -> np.ndarray:
    """Return a list of lists of `width` numbers as an array (n, width)."""
    if type(rows) is not list or any(type(row) is not list or len(row) != width for row in rows):
        raise TypeError(f"{rows!r:.40} is no list of {width} numbers each")
    kind = np.float64 if of is _double else np.int64
    values = [of(value) for value in chain.from_iterable(rows)]
    return np.array(values, dtype=kind).reshape(-1, width)


def _double(value: Any) -> float:
    """Return a number that is a double, as it is."""
    if type(value) not in (int, float) or value != float(value) or math.isinf(value):
        raise TypeError(f"{value!r:.40} is no double")
    return float(value)


def _whole(value: Any) -> int:
    if type(value) is not int:
        raise TypeError(f"{value!r:.40} is no whole number")
    return value


def _array(values: Any) -> np.ndarray:
    if type(values) is not list:
        raise TypeError(f"{values!r:.40} is no list")
    return np.array(list(map(_whole, values)), dtype=np.int64)

"""What `certify` returns, the evidence that `checker` checks, and both as plain data in a file.

What a file's fields mean is in docs/reference/files.md; harness/export/check_evidence.py checks
them and shares no code with this package.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np
import shapely

from triangulators.errors import TriangulationError
from triangulators.polygon import rings_of

FORMAT = "raster-harness evidence 1"
_ABOUT = {"format", "criterion", "rings", "triangles", "cost", "lower_bound", "gap", "proven"}
_FIELDS = _ABOUT | {"scale", "factor", "bits", "edges", "potentials", "lift"}


class Refused(TriangulationError):  # noqa: N818 - says what became of the certificate
    """A certificate that does not hold; the message says where."""


@dataclass(frozen=True)
class Evidence:
    """Why no triangulation weighs less than a bound; see `checker` for what follows from it.

    The weight of a triangle, its lowest corner first, is factor * floor(scale * cost) plus the
    noise of its edges: for an edge a < b the upper `bits` bits of splitmix64's mix of
    a * 0x9E3779B97F4A7C15 + b * 0xD1B54A32D192ED03. What scale, factor and bits must be follows
    from the polygon, the criterion and the triangulation (see `units`). edges (e, 2): a < b;
    potentials (e,) int64, run from a to b; lift: what is added for every triangle.
    """

    scale: float
    factor: int
    bits: int
    edges: np.ndarray
    potentials: np.ndarray
    lift: int

    @property
    def units(self) -> tuple[float, int, int]:
        """Scale, factor and bits."""
        return self.scale, self.factor, self.bits


@dataclass(frozen=True)
class Certificate:
    """How far a triangulation may be from the optimum.

    cost: the criterion's sum over the triangulation; lower_bound: no triangulation of the polygon
    costs less; gap: (cost - lower_bound) / |cost|; proven: whether the triangulation is optimal.
    Where costs are whole on a grid (half-perimeter and overdraw of coordinates that are
    whole or have few binary places), optimal means exactly that, in whole numbers, and nothing is
    proven that is not. Where they are real numbers, as the criterion's function computes them in
    doubles, it means that nothing costs less by a larger share than `error`. evidence: what a
    checker needs; None where there is no bound.
    """

    cost: float
    lower_bound: float
    gap: float
    proven: bool
    evidence: Evidence | None = field(default=None, repr=False, compare=False)

    @property
    def error(self) -> float:
        """The relative error to which the triangulation is known to be optimal; 0 is exactly."""
        return self.gap if self.proven else math.inf


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
    return np.array(values, dtype=kind).reshape(len(rows), width)


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

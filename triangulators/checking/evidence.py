"""The certificate of `certify`, the evidence for `checker`, and both as plain data for a file.

docs/reference/files.md documents the file's fields; harness/export/check_evidence.py checks them
and shares no code with this package.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from triangulators.errors import TriangulationError
from triangulators.polygon import rings_of

FORMAT = "raster-harness evidence 1"


class CertificateError(TriangulationError):
    """A certificate is invalid; the message is the reason."""


@dataclass(frozen=True)
class Evidence:
    """Evidence that no triangulation weighs less than a bound (see `checker`).

    The weight of a triangle, its lowest vertex first, is factor * floor(scale * cost) plus the
    noise of the edges: for an edge a < b the upper `bits` bits of splitmix64's mix of
    a * 0x9E3779B97F4A7C15 + b * 0xD1B54A32D192ED03. The polygon, the criterion and the
    triangulation determine scale, factor and bits (see `units`). edges (e, 2): pairs a < b;
    potentials (e,) int64: in the direction from a to b; lift: added for every triangle.
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
    """The distance of a triangulation from the optimum, with evidence.

    Attributes
    ----------
    cost : float
        The criterion's sum over the triangulation.
    lower_bound : float
        No triangulation of the polygon costs less.
    gap : float
        (cost - lower_bound) / abs(cost).
    proven : bool
        True if the triangulation is proven optimal. For costs that are integers on a grid
        (half-perimeter and overdraw of coordinates that are integers or have few binary places)
        optimal is meant exactly. For real costs, computed in doubles, it means that no
        triangulation is cheaper by more than `gap`.
    evidence : Evidence or None
        The input of a checker; None if there is no bound.
    """

    cost: float
    lower_bound: float
    gap: float
    proven: bool
    evidence: Evidence | None = field(default=None, repr=False, compare=False)


def as_claim(
    polygon: shapely.Polygon, triangles: np.ndarray, criterion: str, certificate: Certificate
) -> dict[str, Any]:
    """Return a certificate of triangles (m, 3) of a polygon as plain data for JSON.

    Coordinates are doubles; all numbers that are compared are integers. Without evidence the claim
    is not proven, and `potentials` is None.
    """
    points, ring_offsets = rings_of(polygon)
    claim: dict[str, Any] = {
        "format": FORMAT,
        "criterion": criterion,
        "rings": [ring.tolist() for ring in np.split(points, ring_offsets[1:-1])],
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

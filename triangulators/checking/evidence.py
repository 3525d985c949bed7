"""What `certify` returns, the evidence that `checker` checks, and both as plain data for a file.

What a file's fields mean is in docs/reference/files.md; harness/export/check_evidence.py checks
them and shares no code with this package.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from triangulators.errors import TriangulationError
from triangulators.polygon import rings_of

FORMAT = "raster-harness evidence 1"


class CertificateError(TriangulationError):
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
    doubles, it means that nothing costs less by a larger share than `gap`. evidence: what a
    checker needs; None where there is no bound.
    """

    cost: float
    lower_bound: float
    gap: float
    proven: bool
    evidence: Evidence | None = field(default=None, repr=False, compare=False)


def as_claim(
    polygon: shapely.Polygon, triangles: np.ndarray, criterion: str, certificate: Certificate
) -> dict[str, Any]:
    """Return what a certificate says of triangles (m, 3) of a polygon, for JSON.

    Coordinates are doubles; everything that is compared is a whole number. Without evidence the
    claim is not proven, and `potentials` is None.
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

"""The certificate that `certify` returns, its evidence, and both as plain data for a file.

docs/reference/files.md documents the file's fields. harness/export/check_evidence.py checks such
files and shares no code with this package.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from triangulators.errors import TriangulationError
from triangulators.polygon import rings_of

FORMAT = "raster-harness evidence 1"


class CertificateError(TriangulationError):
    """The evidence of a certificate is invalid; the message is the reason."""


@dataclass(frozen=True)
class Evidence:
    """Evidence that no triangulation weighs less than a bound (see `checker`).

    The weight of a triangle is factor * floor(scale * cost) plus the noise of its three edges. The
    cost is computed with the vertex of the lowest index first. The noise of an edge a < b is the
    upper `bits` bits of splitmix64's mix of a * 0x9E3779B97F4A7C15 + b * 0xD1B54A32D192ED03. The
    polygon, the criterion and the triangulation determine scale, factor and bits (see `units`).
    """

    scale: float
    factor: int
    bits: int
    edges: np.ndarray  # (e, 2): pairs of sites a < b
    potentials: np.ndarray  # (e,) int64: of each edge in the direction from a to b
    lift: int  # added to the three potentials of every triangle

    @property
    def weight_parameters(self) -> tuple[float, int, int]:
        """Scale, factor and bits, by which a triangle's weight is computed from the cost."""
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
        True if the triangulation is proven optimal. If costs are integers on a grid (half-perimeter
        and overdraw, of coordinates that are integers or have few binary places), no triangulation
        costs less. If costs are real numbers, computed in doubles, no triangulation is cheaper by
        more than `gap`.
    evidence : Evidence or None
        The input of a checker; None if there is no bound, or if `certify` was called without
        evidence.
    """

    cost: float
    lower_bound: float
    gap: float
    proven: bool
    evidence: Evidence | None = field(default=None, repr=False, compare=False)


def make_claim(
    polygon: shapely.Polygon, triangles: np.ndarray, criterion: str, certificate: Certificate
) -> dict[str, Any]:
    """Return a certificate of triangles (m, 3) as data for JSON; without evidence, no bounds."""
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

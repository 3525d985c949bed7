"""A certificate with its polygon as plain data, for a file that any program can check.

What the fields mean is in docs/reference/files.md; scripts/check_evidence.py checks them and shares
no code with this package.
"""

from typing import Any

import numpy as np
import shapely

from triangulators.checking.evidence import Branch, Certificate, Evidence, Leaf
from triangulators.polygon import rings_of

FORMAT = "raster-harness evidence 1"


def as_claim(
    polygon: shapely.Polygon, triangles: np.ndarray, criterion: str, certificate: Certificate
) -> dict[str, Any]:
    """Return what a certificate says of triangles (m, 3) of a polygon, for JSON.

    Coordinates are doubles; everything that is compared is a whole number. Without evidence the
    claim is not proven, and `root` is None.
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
        "root": None,
    }
    evidence = certificate.evidence
    if evidence is not None:
        claim |= {
            "scale": evidence.scale,
            "factor": evidence.factor,
            "bits": evidence.bits,
            "edges": evidence.edges.tolist(),
            "excluded": evidence.excluded.tolist(),
            "root": _plain(evidence.root),
        }
    return claim


def from_claim(claim: dict[str, Any]) -> tuple[shapely.Polygon, np.ndarray, Certificate]:
    """Return the polygon, the triangles (m, 3) and the certificate of a claim with evidence."""
    polygon = shapely.Polygon(claim["rings"][0], claim["rings"][1:])
    evidence = Evidence(
        claim["scale"],
        claim["factor"],
        claim["bits"],
        np.array(claim["edges"]),
        np.array(claim["excluded"], dtype=None if claim["excluded"] else np.int32),
        _node(claim["root"]),
    )
    said = (claim["cost"], claim["lower_bound"], claim["gap"], claim["proven"])
    return polygon, np.array(claim["triangles"], dtype=np.int32), Certificate(*said, evidence)


def _plain(node: Leaf | Branch) -> dict[str, Any]:
    if isinstance(node, Leaf):
        return {"potentials": node.potentials.tolist(), "lift": int(node.lift)}
    a, b = (int(v) for v in node.edge)
    return {"edge": [a, b], "without": _plain(node.without), "within": _plain(node.within)}


def _node(node: dict[str, Any]) -> Leaf | Branch:
    if "edge" in node:
        a, b = node["edge"]
        return Branch((a, b), _node(node["without"]), _node(node["within"]))
    return Leaf(np.array(node["potentials"]), node["lift"])

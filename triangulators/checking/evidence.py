"""What `certify` returns, and the evidence that `checker` checks."""

from dataclasses import dataclass, field

import numpy as np

from triangulators.errors import TriangulationError


class Refused(TriangulationError):  # noqa: N818 - says what became of the certificate
    """A certificate that does not hold; the message says where."""


@dataclass(frozen=True)
class Leaf:
    """Potentials (e,) int64 of the evidence's edges, from a to b, and a lift of every triangle."""

    potentials: np.ndarray
    lift: int


@dataclass(frozen=True)
class Branch:
    """Two cases: triangulations without a diagonal (a, b), and those with it."""

    edge: tuple[int, int]
    without: "Leaf | Branch"
    within: "Leaf | Branch"


@dataclass(frozen=True)
class Evidence:
    """Why no triangulation weighs less than a bound; see `checker` for what follows from it.

    The weight of a triangle, its lowest corner first, is factor * floor(scale * cost) plus the
    noise of its edges: for an edge a < b the upper `bits` bits of splitmix64's mix of
    a * 0x9E3779B97F4A7C15 + b * 0xD1B54A32D192ED03. edges (e, 2): a < b; excluded (k,): numbers of
    those that are in no optimum, in the order in which that is seen.
    """

    scale: float
    factor: int
    bits: int
    edges: np.ndarray
    excluded: np.ndarray
    root: Leaf | Branch


@dataclass(frozen=True)
class Certificate:
    """How far a triangulation may be from the optimum.

    cost: the criterion's sum over the triangulation; lower_bound: no triangulation of the polygon
    costs less; gap: (cost - lower_bound) / |cost|, 0 where both are 0; proven: whether the
    triangulation is optimal, exactly where costs are whole in units of the grid (half-perimeter,
    overdraw), otherwise up to rounding at the tenth digit. evidence: what a checker needs; None
    where a table over all sub-polygons is the proof.
    """

    cost: float
    lower_bound: float
    gap: float
    proven: bool
    evidence: Evidence | None = field(default=None, repr=False, compare=False)

"""What `certify` returns, and the evidence that `checker` checks."""

import math
from dataclasses import dataclass, field

import numpy as np

from triangulators.errors import TriangulationError


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

"""A criterion: a cost per triangle, as weights of features or as a compiled function."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from triangulators.errors import ArgumentError

FEATURES = (
    "triangles",
    "area",
    "half_perimeter",
    "bbox_area",
    "edge_length",
    "shape",
    "beauty",
    "expected_quads",
    "expected_blocks",
    "expected_setups",
)
"""Features of a triangle (see `features`), in the order of weights."""

MAX_WEIGHT = 1e200
"""Upper bound of a weight's size; sums of larger ones overflow."""


@dataclass(frozen=True)
class Criterion:
    """A cost per triangle, to be summed over a triangulation.

    Parameters
    ----------
    name : str
        The name that `find` accepts, including weights.
    description, label, symbol, unit : str
        Texts for tables and plots.
    weights : tuple of float
        Coefficients of `FEATURES`.
    function : callable or None
        A Numba function of three points (six numbers), which replaces the weights.
    normalise : callable or None
        Returns other weights for (weights, area of the polygon, number of triangles).
    parameters : bool
        True for a family, whose weights the user chooses; `predict` omits it.
    placed : bool
        True if the cost depends on the position on the pixel grid; `predict` omits it.

    Raises
    ------
    ArgumentError
        If a weight is not a number or is beyond 1e200.
    """

    name: str
    description: str
    weights: tuple[float, ...] = (0.0,) * len(FEATURES)
    function: Callable[..., float] | None = None
    normalise: Callable[[np.ndarray, float, int], np.ndarray] | None = None
    label: str = ""
    symbol: str = ""
    unit: str = "1"
    parameters: bool = False
    placed: bool = False

    def __post_init__(self) -> None:
        for weight in self.weights:
            if math.isnan(weight):
                raise ArgumentError(f"criterion {self.name}: a weight is not a number (nan)")
            if abs(weight) > MAX_WEIGHT:
                raise ArgumentError(
                    f"criterion {self.name}: weight {weight:g} is beyond {MAX_WEIGHT:g}, where "
                    "sums overflow; divide all weights by the largest"
                )

    @property
    def column(self) -> str:
        """The name with underscores, for keys of records and columns of files."""
        return self.name.replace("-", "_")

    def weights_for(self, polygon_area: float, triangles: int) -> np.ndarray:
        """Return the weights (k,) of `FEATURES` for a polygon's area and number of triangles."""
        weights = np.array(self.weights, dtype=np.float64)
        if self.normalise is None:
            return weights
        return self.normalise(weights, polygon_area, max(triangles, 1))

    def total(self, points: np.ndarray, triangles: np.ndarray) -> float:
        """Return the sum over triangles (m, 3), indices of points (n, 2)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        if len(triangles) == 0:
            return 0.0
        if self.function is not None:
            costs = [self.function(*points[row].ravel().tolist()) for row in triangles]
            return math.fsum(costs)
        from triangulators.criteria.features import feature_sums

        sums = feature_sums(points, np.ascontiguousarray(triangles, dtype=np.int32))
        return float(np.dot(self.weights_for(float(sums[1]), len(triangles)), sums))


def weighted_sum(
    name: str,
    description: str,
    label: str,
    symbol: str,
    unit: str,
    **coefficients: float,
) -> Criterion:
    """Return a weighted sum of features; coefficients default to 0."""
    weights = tuple(float(coefficients.get(feature, 0.0)) for feature in FEATURES)
    return Criterion(name, description, weights, label=label, symbol=symbol, unit=unit)

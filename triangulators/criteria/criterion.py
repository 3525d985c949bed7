"""Criteria: weighted sums of features or user functions; the families `mixed` and `calibrated`."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from triangulators.criteria.features import sum_features
from triangulators.errors import ArgumentError

FEATURES = (  # of a triangle (see `features`), in the order of weights
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

WEIGHTS_MARK = "="  # separator between a criterion's name and its weights
WEIGHTS_SEPARATOR = "/"  # separator between weights; not a comma, which separates names in a list
BYTES_PER_TRIANGLE = 24.0  # three vertices of two 4-byte coordinates; M in the paper
WORST_SHAPE = 240.0  # maximum of "shape" in degrees: |60 - 180| + 60 + 60, of a flat triangle

# Features that a device's fitted time per triangle may depend on.
CALIBRATED_FEATURES = tuple(name for name in FEATURES if name not in ("edge_length", "beauty"))

MAX_WEIGHT = 1e200  # upper bound of a weight's size; sums of larger weights overflow


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
        Coefficients of `FEATURES`, in that order.
    function : callable or None
        A Numba function of three points (six numbers), which replaces the weights.
    normalise : callable or None
        Function of (weights, area of the polygon, number of triangles) that returns the weights for
        that polygon; None if the weights are the same for all polygons.
    is_family : bool
        True for a family, whose weights the user chooses; `predict` omits it.
    depends_on_position : bool
        True if the cost depends on the position on the pixel grid; `predict` omits the criterion.

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
    is_family: bool = False
    depends_on_position: bool = False

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
        """Return the criterion's sum over triangles (m, 3), which index points (n, 2)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        if len(triangles) == 0:
            return 0.0
        if self.function is not None:
            costs = [self.function(*points[row].ravel().tolist()) for row in triangles]
            return math.fsum(costs)
        sums = sum_features(points, np.ascontiguousarray(triangles, dtype=np.int32))
        return float(np.dot(self.weights_for(float(sums[1]), len(triangles)), sums))


CriterionLike: TypeAlias = Criterion | str | Callable[..., float]
"""A criterion, its name, or a Numba function of three points (six numbers)."""


def make_weighted_criterion(
    name: str, description: str, label: str, symbol: str, unit: str, **coefficients: float
) -> Criterion:
    """Return a criterion that is a weighted sum of features."""
    weights = tuple(float(coefficients.get(feature, 0.0)) for feature in FEATURES)
    return Criterion(name, description, weights, label=label, symbol=symbol, unit=unit)


def _normalise_per_polygon(weights: np.ndarray, polygon_area: float, triangles: int) -> np.ndarray:
    result = weights / triangles
    areas = [FEATURES.index("area"), FEATURES.index("bbox_area")]
    result[areas] = weights[areas] / polygon_area
    return result


def mixed(alpha: float = 1.0, beta: float = 1.0, gamma: float = 1.0) -> Criterion:
    """Return the paper's mixture, F = alpha A / S + beta D / (240 T) + gamma C / (24 T).

    A is overdraw, D shape deviation, C complexity. A is divided by the polygon's area S, D by the
    number of triangles T times 240 degrees, the largest deviation of a triangle, and C by T times
    the 24 bytes of a triangle. So the last term is the constant gamma.

    Parameters
    ----------
    alpha, beta, gamma
        Weights; finite, not negative, not all 0.

    Returns
    -------
    Criterion
        Named "mixed=alpha/beta/gamma", or "mixed" if all three are 1.

    Raises
    ------
    ArgumentError
        If a weight is invalid.

    Examples
    --------
    >>> mixed(1.0, 0.5, 0.0).name
    'mixed=1/0.5/0'
    """
    weights = (alpha, beta, gamma)
    name = "mixed" if weights == (1, 1, 1) else f"mixed{WEIGHTS_MARK}{write_weights(weights)}"
    problem = _find_weights_problem(dict(zip(MIXED_WEIGHTS, weights, strict=True)))
    if problem:
        raise _make_weights_error(name, problem)
    linear = make_weighted_criterion(
        name,
        "alpha*A/S + beta*D/(240 T) + gamma*C/(24 T); mixed=1/0.5/0 gives the weights",
        "mixture",
        "F",
        "1",
        triangles=gamma,
        area=-alpha,
        bbox_area=alpha,
        shape=beta / WORST_SHAPE,
    )
    return replace(linear, normalise=_normalise_per_polygon, is_family=True)


MIXED_WEIGHTS = ("alpha", "beta", "gamma")  # names of the weights of `mixed`, in order


def _find_weights_problem(weights: Mapping[str, float]) -> str | None:
    for name, weight in weights.items():
        if not math.isfinite(weight):
            return f"{name} is {weight:g}"
        if weight < 0.0:
            return f"{name} is negative"
        if weight > MAX_WEIGHT:
            return f"{name} is beyond {MAX_WEIGHT:g}, where sums overflow"
    return None if any(weights.values()) else "all weights are 0"


def _make_weights_error(name: str, problem: str) -> ArgumentError:
    return ArgumentError(
        f"criterion {name!r}: {problem}; give mixed=alpha/beta/gamma, "
        "3 finite numbers, not negative and not all 0"
    )


def calibrated(coefficients: Mapping[str, float]) -> Criterion:
    """Return the criterion that is a triangle's drawing time, as fitted on a device.

    Parameters
    ----------
    coefficients
        Weights of features in `CALIBRATED_FEATURES`, by name; 0 for features not given.

    Returns
    -------
    Criterion
        Named "calibrated", in the coefficients' unit of time.

    Raises
    ------
    ArgumentError
        If a feature is unknown, or a coefficient is not a number or beyond 1e200.
    """
    unknown = sorted(set(coefficients) - set(CALIBRATED_FEATURES))
    if unknown:
        raise ArgumentError(
            f"criterion calibrated: unknown coefficients {unknown}; "
            f"choose from {', '.join(CALIBRATED_FEATURES)}"
        )
    description = "time of drawing a triangle, by features at the rates fitted on a device"
    linear = make_weighted_criterion(
        "calibrated", description, "calibrated time", "", "s", **coefficients
    )
    return replace(linear, is_family=True)


def read_weights(text: str) -> dict[str, float]:
    """Return weights of `mixed` by name, from text such as "1/0.5/0" with exactly three numbers."""
    try:
        weights = [float(part) for part in text.split(WEIGHTS_SEPARATOR)]
        return dict(zip(MIXED_WEIGHTS, weights, strict=True))
    except ValueError as error:
        problem = f"{text!r} is not three numbers"
        raise _make_weights_error(f"mixed{WEIGHTS_MARK}{text}", problem) from error


def write_weights(values: tuple[float, ...]) -> str:
    """Format weights for `read_weights`, in the shortest form: 1, not 1.0."""
    # Adding zero turns -0.0 into 0.0, so that both have the same text.
    return WEIGHTS_SEPARATOR.join(repr(float(value) + 0.0).removesuffix(".0") for value in values)

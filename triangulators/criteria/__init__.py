"""Criteria: predicted costs of a triangle, computed from its coordinates.

A criterion sums a cost per triangle over a triangulation. Every built-in criterion is a weighted
sum of `FEATURES`; a user's criterion is a Numba function of three points given as six numbers, as
the features are. The name of `mixed` can contain its weights: "mixed=1/0.5/0" is alpha 1, beta 0.5
and gamma 0.

Units are those of the coordinates: pixels for a frame.

features   compiled features of one triangle; exact quads on the pixel grid
cost       a criterion as compiled code takes it
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from triangulators.errors import ArgumentError, UnknownNameError, suggest

__all__ = ["CRITERIA", "Criterion", "calibrated", "find", "mixed", "names", "predict", "predicted"]

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

FEATURES_KEPT = ("triangles", "area", "bbox_area", "expected_setups")
"""Features that are no criterion by themselves, but that fits of a device's time need."""

MARK = "="
"""Separates a criterion's name from its weights."""

BETWEEN = "/"
"""Separates weights; a comma separates the names in a list."""

BYTES_PER_TRIANGLE = 24.0  # three vertices of two 4-byte coordinates: the paper's M
WORST_SHAPE = 240.0  # degrees; a triangle flattened to angles 180, 0, 0

MAX_WEIGHT = 1e200
"""Upper bound of a weight's size; sums of larger ones overflow."""


def exact_quads_of(*points: float) -> float:
    """Call the compiled `features.exact_quads`, imported on the first call."""
    from triangulators.criteria.features import exact_quads

    return float(exact_quads(*points))


@dataclass(frozen=True)
class Criterion:
    """A cost per triangle, to be summed over a triangulation.

    Parameters
    ----------
    name : str
        As `find` takes it, weights included.
    description, label, symbol, unit : str
        As tables and plots show it.
    weights : tuple of float
        Coefficients of `FEATURES`.
    function : callable or None
        A Numba function of three points (six numbers), which replaces the weights.
    normalise : callable or None
        Returns other weights for (weights, area of the polygon, number of triangles).
    parameters : bool
        True for a family, whose weights the user gives; `predict` leaves it out.
    placed : bool
        True if the cost depends on the position on the pixel grid; `predict` leaves it out.

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


CALIBRATED = (
    "triangles",
    "area",
    "half_perimeter",
    "bbox_area",
    "shape",
    "expected_quads",
    "expected_blocks",
    "expected_setups",
)
"""Features that a device's fitted cost can use."""


def _linear(
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


def _per_polygon(weights: np.ndarray, polygon_area: float, triangles: int) -> np.ndarray:
    result = weights / triangles
    areas = [FEATURES.index("area"), FEATURES.index("bbox_area")]
    result[areas] = weights[areas] / polygon_area
    return result


def mixed(alpha: float = 1.0, beta: float = 1.0, gamma: float = 1.0) -> Criterion:
    """Return the paper's mixture, F = alpha A / S + beta D / (240 T) + gamma C / (24 T).

    A is divided by the polygon's area S, D by the number of triangles T times the 240 degrees that
    a triangle deviates at most, and C by T times the 24 bytes of a triangle. C adds the constant
    gamma.

    Parameters
    ----------
    alpha, beta, gamma
        Weights; finite, none negative, at least one positive.

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
    name = "mixed" if weights == (1, 1, 1) else f"mixed{MARK}{write_weights(weights)}"
    problem = _problem_of_weights(dict(zip(MIXED_WEIGHTS, weights, strict=True)))
    if problem:
        raise _invalid_weights(name, problem)
    linear = _linear(
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
    return replace(linear, normalise=_per_polygon, parameters=True)


MIXED_WEIGHTS = ("alpha", "beta", "gamma")


def _problem_of_weights(weights: Mapping[str, float]) -> str | None:
    """Return why a mixture's weights are invalid, or None if they are valid."""
    for name, weight in weights.items():
        if not math.isfinite(weight):
            return f"{name} is {weight:g}"
        if weight < 0.0:
            return f"{name} is negative"
        if weight > MAX_WEIGHT:
            return f"{name} is beyond {MAX_WEIGHT:g}, where sums overflow"
    return None if any(weights.values()) else "all weights are 0"


def _invalid_weights(name: str, problem: str) -> ArgumentError:
    return ArgumentError(
        f"criterion {name!r}: {problem}; give mixed{MARK}{BETWEEN.join(MIXED_WEIGHTS)}, "
        "3 finite numbers, none negative and one above zero"
    )


def calibrated(coefficients: Mapping[str, float]) -> Criterion:
    """Return a device's fitted cost.

    Parameters
    ----------
    coefficients
        Weights of some of the features `CALIBRATED`, by name.

    Raises
    ------
    ArgumentError
        If a feature is unknown, or a coefficient is not a number or beyond 1e200.
    """
    unknown = sorted(set(coefficients) - set(CALIBRATED))
    if unknown:
        raise ArgumentError(
            f"criterion calibrated: unknown coefficients {unknown}; "
            f"choose from {', '.join(CALIBRATED)}"
        )
    description = "T, S, H, w*h, D, Q, P and R at the rates fitted on a device"
    linear = _linear("calibrated", description, "calibrated time", "", "s", **coefficients)
    return replace(linear, parameters=True)


CRITERIA: dict[str, Criterion] = {
    criterion.name: criterion
    for criterion in (
        _linear(
            "overdraw",
            "bounding-box area minus triangle area",
            "the paper's overdraw",
            "A",
            "px^2",
            bbox_area=1,
            area=-1,
        ),
        _linear(
            "half-perimeter",
            "bounding-box width plus height",
            "half-perimeter",
            "H",
            "px",
            half_perimeter=1,
        ),
        _linear(
            "expected-quads",
            "2x2 pixel quads to shade, the mean over all positions on the grid",
            "expected quads",
            "Q",
            "quads",
            expected_quads=1,
        ),
        _linear(
            "expected-blocks",
            "4x4 pixel blocks touched, the mean over all positions on the grid",
            "expected 4x4 blocks",
            "P",
            "blocks",
            expected_blocks=1,
        ),
        _linear("edge-length", "perimeter", "edge length", "E", "px", edge_length=1),
        _linear(
            "shape",
            "deviation of the angles from 60 degrees",
            "the paper's shape deviation",
            "D",
            "degrees",
            shape=1,
        ),
        _linear(
            "beauty",
            "area over perimeter, negative: its sum is what Blender's Beauty makes large",
            "negative beauty",
            "B",
            "px",
            beauty=-1,
        ),
        _linear(
            "complexity",
            "24 bytes a triangle",
            "the paper's complexity",
            "C",
            "bytes",
            triangles=BYTES_PER_TRIANGLE,
        ),
        Criterion(
            "exact-quads",
            "2x2 pixel quads shaded where the triangle lies on the pixel grid: counted",
            function=exact_quads_of,
            label="exact quads",
            unit="quads",
            placed=True,
        ),
        mixed(),
        calibrated({"triangles": 1.0, "area": 1.0, "half_perimeter": 1.0}),
    )
}
FLIP_TESTS = ("l1", "euclidean", "delaunay")
"""Flip tests next to the criteria: a diagonal's L1 length, its Euclidean length, the angles."""


def names() -> list[str]:
    """Return the names of the criteria."""
    return list(CRITERIA)


def find(name: str | Criterion | Callable[..., float], **parameters: Any) -> Criterion:
    """Return a criterion by name, or made from a user's Numba function.

    Parameters
    ----------
    name
        A name, for `mixed` optionally with weights ("mixed=1/0.5/0"); a Numba function of three
        points (six numbers); or a `Criterion`, which is returned.
    **parameters
        `alpha`, `beta` and `gamma` of "mixed", or `coefficients` of "calibrated".

    Raises
    ------
    UnknownNameError
        If there is no such criterion.
    ArgumentError
        If weights are invalid, given twice, or not taken by the criterion.

    Examples
    --------
    >>> find("mixed=1.0/.5/0").name
    'mixed=1/0.5/0'
    """
    if not isinstance(name, str):
        return _as_criterion(name, parameters)
    plain, mark, weights = name.partition(MARK)
    if plain not in CRITERIA:
        raise UnknownNameError(f"unknown criterion {name!r}; {suggest(plain, CRITERIA)}")
    if mark:
        if plain != "mixed":
            raise ArgumentError(
                f"criterion {plain!r} takes no weights (got {weights!r}); mixed does"
            )
        if parameters:
            given = ", ".join(sorted(parameters))
            raise ArgumentError(
                f"criterion {name!r}: weights given twice (in the name and as {given}); "
                "give one of the two"
            )
        return mixed(**read_weights(weights))
    families: dict[str, Callable[..., Criterion]] = {"mixed": mixed, "calibrated": calibrated}
    if plain not in families and parameters:
        given = ", ".join(sorted(parameters))
        raise ArgumentError(f"criterion {plain!r} takes no parameters (got {given})")
    return families[plain](**parameters) if parameters else CRITERIA[plain]


def _as_criterion(given: Any, parameters: Mapping[str, Any]) -> Criterion:
    """Return a criterion that is given as an object or as a function, which take no parameters."""
    if not (isinstance(given, Criterion) or callable(given)):
        raise ArgumentError(
            f"criterion: expected a name, a Criterion or a function, got {type(given).__name__}"
        )
    name: str = getattr(given, "name", "") or getattr(given, "__name__", "custom")
    if parameters:
        names = ", ".join(sorted(parameters))
        raise ArgumentError(f"criterion {name!r} takes no parameters (got {names})")
    if isinstance(given, Criterion):
        return given
    return Criterion(name, "user's function", function=given)


def predicted() -> list[Criterion]:
    """Return the criteria that `predict` sums, in the order in which they are shown."""
    return [
        criterion
        for criterion in CRITERIA.values()
        if not (criterion.parameters or criterion.placed)
    ]


def predict(points: np.ndarray, triangles: np.ndarray) -> dict[str, float]:
    """Sum every criterion over a triangulation.

    Parameters
    ----------
    points
        (n, 2) float64.
    triangles
        (m, 3) indices of points.

    Returns
    -------
    dict
        Sums of the features `FEATURES_KEPT`, then of each criterion of `predicted` under its
        `column`; in the criterion's unit if coordinates are pixels.

    Examples
    --------
    >>> square = np.array([(0, 0), (2, 0), (2, 2), (0, 2)])
    >>> sums = predict(square, np.array([(0, 1, 2), (0, 2, 3)]))
    >>> sums["half_perimeter"], sums["overdraw"]
    (8.0, 4.0)
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    triangles = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1, 3)
    from triangulators.criteria.features import feature_sums

    sums = feature_sums(points, triangles)[None]
    return {name: float(column[0]) for name, column in _criterion_sums(sums).items()}


def predict_many(
    coords: np.ndarray,
    vertex_offsets: np.ndarray,
    triangles: np.ndarray,
    triangle_offsets: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return what `predict` does for each of p polygons, as columns (p,); arrays as in a batch."""
    from triangulators.criteria.features import feature_sums_of_many

    sums = feature_sums_of_many(coords, vertex_offsets, triangles, triangle_offsets)
    return _criterion_sums(sums)


def _criterion_sums(sums: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns (p,) of `predict` from sums of `FEATURES` (p, k)."""
    columns = {name: sums[:, FEATURES.index(name)] for name in FEATURES_KEPT}
    for criterion in predicted():
        columns[criterion.column] = sums @ np.array(criterion.weights)
    return columns


def read_weights(text: str) -> dict[str, float]:
    """Return the weights of `mixed` by name that a text such as `1/0.5/0` gives.

    Raises `ArgumentError` unless there are three numbers; `mixed` checks their values.
    """
    try:
        weights = [float(part) for part in text.split(BETWEEN)]
        return dict(zip(MIXED_WEIGHTS, weights, strict=True))
    except ValueError as error:
        problem = f"{text!r} is not three numbers"
        raise _invalid_weights(f"mixed{MARK}{text}", problem) from error


def write_weights(values: tuple[float, ...]) -> str:
    """Return weights as `read_weights` takes them, each in its shortest form: 1, not 1.0."""
    # Adding zero turns -0.0 into 0.0.
    return BETWEEN.join(repr(float(value) + 0.0).removesuffix(".0") for value in values)

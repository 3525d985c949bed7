"""Criteria: what a triangle is predicted to cost, from its coordinates alone.

A criterion sums a per-triangle cost over a triangulation. Every built-in one is a weighted sum of
`features`; a user's own criterion is a Numba function of the same form as a feature, of three
points given as six numbers. A criterion's name may hold its weights: `mixed=1/0.5/0` is alpha 1,
beta 0.5, gamma 0.

Units are those of the coordinates: pixels for a frame.

features   what one triangle is made of, compiled; quads that it shades in one place on the grid
cost       a criterion as compiled code takes it
"""

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from triangulators.errors import UnknownName

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
"""What one triangle is made of (see `features`), in the order that weights have."""

FEATURES_KEPT = ("triangles", "area", "bbox_area", "expected_setups")
"""Features that are no criterion by themselves, and that fits of a device's time need."""

MARK = "="
"""Between a criterion's name and its weights."""

BETWEEN = "/"
"""Between weights; a comma separates the names in a list."""

BYTES_PER_TRIANGLE = 24.0  # three vertices of two 4-byte coordinates: the paper's M
WORST_SHAPE = 240.0  # degrees; a triangle flattened to angles 180, 0, 0

MOST_WEIGHT = 1e200
"""Largest weight of a feature."""


def exact_quads_of(*points: float) -> float:
    """Call `features.exact_quads`, which is compiled: the catalogue is read without it."""
    from triangulators.criteria.features import exact_quads

    return float(exact_quads(*points))


@dataclass(frozen=True)
class Criterion:
    """A cost per triangle, to be summed over a triangulation.

    `label`, `symbol` and `unit` are how tables and plots show it. `weights` are coefficients of
    `FEATURES`; `function`, if given, is a Numba function of three points (six numbers) and takes
    their place. `normalise` turns weights into others once the polygon's area and number of
    triangles are known. `parameters` says that it is a family, whose value depends on weights that
    a user gives, and `placed` that it is counted on the pixel grid, where the polygon lies: neither
    is among what `predict` returns.
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
        wrong = [weight for weight in self.weights if not abs(weight) <= MOST_WEIGHT]
        if wrong:
            raise UnknownName(
                f"criterion {self.name}: the weight {wrong[0]:g} is beyond {MOST_WEIGHT:g}, where "
                "sums overflow: divide all weights by the largest"
            )

    @property
    def column(self) -> str:
        """Its name where hyphens cannot stand: keys of records and columns of files."""
        return self.name.replace("-", "_")

    def weights_for(self, polygon_area: float, triangles: int) -> np.ndarray:
        """Return the (k,) weights of `FEATURES` for a polygon of this area and triangle count."""
        weights = np.array(self.weights, dtype=np.float64)
        if self.normalise is None:
            return weights
        return self.normalise(weights, polygon_area, max(triangles, 1))

    def total(self, points: np.ndarray, triangles: np.ndarray) -> float:
        """Return the criterion of one triangulation."""
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
"""Features that a device's time may be made of."""


def _linear(
    name: str,
    description: str,
    label: str,
    symbol: str,
    unit: str,
    **coefficients: float,
) -> Criterion:
    """Return a weighted sum of features; what is not named has no weight."""
    weights = tuple(float(coefficients.get(feature, 0.0)) for feature in FEATURES)
    return Criterion(name, description, weights, label=label, symbol=symbol, unit=unit)


def _per_polygon(weights: np.ndarray, polygon_area: float, triangles: int) -> np.ndarray:
    result = weights / triangles
    areas = [FEATURES.index("area"), FEATURES.index("bbox_area")]
    result[areas] = weights[areas] / polygon_area
    return result


def mixed(alpha: float = 1.0, beta: float = 1.0, gamma: float = 1.0) -> Criterion:
    """F = alpha A / S + beta D / (240 T) + gamma C / (24 T), the paper's mixture.

    Each term is made comparable by its scale: A by the polygon's area S, D by the 240 degrees a
    triangle can deviate at most, C by 24 bytes a triangle. So C adds the constant gamma.
    It is called `mixed=alpha/beta/gamma`, and `mixed` where all three are 1.
    """
    weights = (alpha, beta, gamma)
    linear = _linear(
        "mixed" if weights == (1, 1, 1) else f"mixed{MARK}{write_weights(weights)}",
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


def calibrated(coefficients: Mapping[str, float]) -> Criterion:
    """A device's fitted cost: coefficients of some of `CALIBRATED`. Raises `ValueError`."""
    unknown = sorted(set(coefficients) - set(CALIBRATED))
    if unknown:
        raise ValueError(
            f"calibrated: unknown coefficients {unknown}; expected some of {list(CALIBRATED)}"
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
"""What flips may lessen beside a criterion: a diagonal's L1 or Euclidean length, or the angles."""


def names() -> list[str]:
    """Return the names of the criteria."""
    return list(CRITERIA)


def find(name: str | Criterion | Callable[..., float], **parameters: Any) -> Criterion:
    """Return a criterion by name, or made of a user's Numba function of three points.

    The name of `mixed` may hold its weights, `mixed=1/0.5/0` (see `weights`). parameters: alpha,
    beta, gamma for `mixed`; coefficients for `calibrated`. The criterion's own name is the one way
    to write it. Raises `UnknownName`, also for weights that cannot be used.

        >>> find("mixed=1.0/.5/0").name
        'mixed=1/0.5/0'
    """
    if isinstance(name, Criterion):
        return name
    if callable(name):
        return Criterion(getattr(name, "__name__", "custom"), "user's function", function=name)
    plain, mark, weights = name.partition(MARK)
    if plain not in CRITERIA:
        near = difflib.get_close_matches(plain, CRITERIA, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise UnknownName(f"unknown criterion {name!r}{hint} (known: {', '.join(CRITERIA)})")
    criterion = CRITERIA[plain]
    if mark:
        if plain != "mixed":
            raise UnknownName(f"criterion {plain!r} takes no weights, got {weights!r}; mixed does")
        if parameters:
            raise TypeError(f"criterion {name!r} has its weights already, got {sorted(parameters)}")
        criterion = mixed(**read_weights(plain, weights, ("alpha", "beta", "gamma")))
    elif plain == "mixed":
        criterion = mixed(**parameters)
    elif plain == "calibrated" and parameters:
        criterion = calibrated(**parameters)
    elif parameters:
        raise TypeError(f"criterion {plain!r} takes no parameters, got {sorted(parameters)}")
    return criterion


def predicted() -> list[Criterion]:
    """Return the criteria that `predict` sums, in the order in which they are shown."""
    return [each for each in CRITERIA.values() if not (each.parameters or each.placed)]


def predict(points: np.ndarray, triangles: np.ndarray) -> dict[str, float]:
    """Sum every criterion over a triangulation.

    points: (n, 2) float64; triangles: (m, 3) indices into them. Keys: `FEATURES_KEPT`, then the
    `column` of each criterion of `predicted`, in its unit where coordinates are pixels.

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


def read_weights(criterion: str, text: str, names: tuple[str, ...]) -> dict[str, float]:
    """Return the weights called `names` that `text` gives a criterion, such as `1/0.5/0`.

    Raises `UnknownName` unless there are as many figures as names, each finite and not negative,
    one of them positive.
    """
    try:
        values = [float(part) for part in text.split(BETWEEN)]
    except ValueError:
        values = []
    if len(values) != len(names) or not (0.0 < sum(values) < math.inf and min(values) >= 0.0):
        raise UnknownName(
            f"criterion '{criterion}{MARK}{text}': give {criterion}{MARK}{BETWEEN.join(names)}, "
            f"{len(names)} finite numbers, none negative and one above zero"
        )
    return dict(zip(names, values, strict=True))


def write_weights(values: tuple[float, ...]) -> str:
    """Return weights as `read_weights` takes them, each in its shortest form: 1, not 1.0."""
    # Adding zero turns -0.0 into 0.0.
    return BETWEEN.join(repr(float(value) + 0.0).removesuffix(".0") for value in values)

"""Criteria: predicted costs of a triangle, computed from its coordinates.

A criterion is a weighted sum of `FEATURES`, except "exact-quads" and a user's criterion, which is a
Numba function of three points (six numbers). Units follow from the unit of the coordinates.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from triangulators.criteria.criterion import (
    BYTES_PER_TRIANGLE,
    FEATURES,
    WEIGHTS_MARK,
    Criterion,
    calibrated,
    make_weighted_criterion,
    mixed,
    read_weights,
)
from triangulators.criteria.features import exact_quads, sum_features, sum_features_of_many
from triangulators.errors import ArgumentError, UnknownNameError, suggest

__all__ = [
    "CRITERIA",
    "Criterion",
    "calibrated",
    "find",
    "list_predicted",
    "mixed",
    "names",
    "predict",
]

AUXILIARY_FEATURES = ("triangles", "area", "bbox_area", "expected_setups")  # summed by `predict`


def count_exact_quads(*points: float) -> float:
    """Return `features.exact_quads` of three points (six numbers); not a kernel, so picklable."""
    return float(exact_quads(*points))


CRITERIA: dict[str, Criterion] = {
    criterion.name: criterion
    for criterion in (
        make_weighted_criterion(
            "overdraw",
            "bounding-box area minus triangle area",
            "the paper's overdraw",
            "A",
            "px^2",
            bbox_area=1,
            area=-1,
        ),
        make_weighted_criterion(
            "half-perimeter",
            "bounding-box width plus height",
            "half-perimeter",
            "H",
            "px",
            half_perimeter=1,
        ),
        make_weighted_criterion(
            "expected-quads",
            "2x2 pixel quads to shade, averaged over all positions on the grid",
            "expected quads",
            "Q",
            "quads",
            expected_quads=1,
        ),
        make_weighted_criterion(
            "expected-blocks",
            "4x4 pixel blocks touched, averaged over all positions on the grid",
            "expected 4x4 blocks",
            "P",
            "blocks",
            expected_blocks=1,
        ),
        make_weighted_criterion(
            "edge-length", "perimeter", "edge length", "E", "px", edge_length=1
        ),
        make_weighted_criterion(
            "shape",
            "deviation of the angles from 60 degrees",
            "the paper's shape deviation",
            "D",
            "degrees",
            shape=1,
        ),
        make_weighted_criterion(
            "beauty",
            "negative area over perimeter; Blender's Beauty maximises area over perimeter",
            "negative beauty",
            "B",
            "px",
            beauty=-1,
        ),
        make_weighted_criterion(
            "complexity",
            "24 bytes per triangle",
            "the paper's complexity",
            "C",
            "bytes",
            triangles=BYTES_PER_TRIANGLE,
        ),
        Criterion(
            "exact-quads",
            "2x2 pixel quads shaded at the triangle's position on the pixel grid, counted",
            function=count_exact_quads,
            label="exact quads",
            unit="quads",
            depends_on_position=True,
        ),
        mixed(),
        calibrated({"triangles": 1.0, "area": 1.0, "half_perimeter": 1.0}),
    )
}
# Tests of the triangulator "flips": shorter in the L1 metric, shorter in the L2 metric, Delaunay.
FLIP_TESTS = ("l1", "euclidean", "delaunay")


def names() -> list[str]:
    """Return the names of the criteria.

    Returns
    -------
    list of str
        In the order of lists and tables.
    """
    return list(CRITERIA)


def find(name: str | Criterion | Callable[..., float], **parameters: Any) -> Criterion:
    """Return the criterion that a name or a user's Numba function stands for.

    Parameters
    ----------
    name
        A name, for `mixed` optionally with weights ("mixed=1/0.5/0"); a Numba function of three
        points (six numbers); or a `Criterion`, which is returned.
    **parameters
        `alpha`, `beta` and `gamma` of "mixed", or `coefficients` of "calibrated".

    Returns
    -------
    Criterion
        With a name that `find` accepts, unless it is a user's function.

    Raises
    ------
    UnknownNameError
        If there is no such criterion.
    ArgumentError
        If weights are invalid or given twice, or if the criterion has no weights.

    Examples
    --------
    >>> find("mixed=1.0/.5/0").name
    'mixed=1/0.5/0'
    """
    if not isinstance(name, str):
        return _make_criterion(name, parameters)
    plain, has_weights, weights = name.partition(WEIGHTS_MARK)
    if plain not in CRITERIA:
        raise UnknownNameError(f"unknown criterion {name!r}; {suggest(plain, CRITERIA)}")
    if has_weights:
        if plain != "mixed":
            raise ArgumentError(
                f"criterion {plain!r} takes no weights (got {weights!r}); mixed does"
            )
        if parameters:
            names = ", ".join(sorted(parameters))
            raise ArgumentError(
                f"criterion {name!r}: weights given twice (in the name and as {names}); "
                "give only one"
            )
        return mixed(**read_weights(weights))
    families: dict[str, Callable[..., Criterion]] = {"mixed": mixed, "calibrated": calibrated}
    if plain not in families and parameters:
        names = ", ".join(sorted(parameters))
        raise ArgumentError(f"criterion {plain!r} takes no parameters (got {names}); mixed does")
    return families[plain](**parameters) if parameters else CRITERIA[plain]


def _make_criterion(criterion: Any, parameters: Mapping[str, Any]) -> Criterion:
    if not (isinstance(criterion, Criterion) or callable(criterion)):
        raise ArgumentError(
            f"criterion: expected a name, a Criterion or a function, got {type(criterion).__name__}"
        )
    name: str = getattr(criterion, "name", "") or getattr(criterion, "__name__", "custom")
    if parameters:
        names = ", ".join(sorted(parameters))
        raise ArgumentError(f"criterion {name!r} takes no parameters (got {names})")
    if isinstance(criterion, Criterion):
        return criterion
    return Criterion(name, "user's function", function=criterion)


def list_predicted() -> list[Criterion]:
    """Return the criteria that `predict` sums.

    Returns
    -------
    list of Criterion
        In the order of columns and tables.
    """
    return [
        criterion
        for criterion in CRITERIA.values()
        if not (criterion.is_family or criterion.depends_on_position)
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
        Sums of `AUXILIARY_FEATURES`, then of each criterion of `list_predicted` under its
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
    sums = sum_features(points, triangles)[None]
    return {name: float(column[0]) for name, column in _combine_features(sums).items()}


def predict_many(
    coords: np.ndarray,
    vertex_offsets: np.ndarray,
    triangles: np.ndarray,
    triangle_offsets: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the sums of `predict` for p polygons, as columns (p,) by name; arrays: see `Batch`."""
    sums = sum_features_of_many(coords, vertex_offsets, triangles, triangle_offsets)
    return _combine_features(sums)


def _combine_features(sums: np.ndarray) -> dict[str, np.ndarray]:
    columns = {name: sums[:, FEATURES.index(name)] for name in AUXILIARY_FEATURES}
    for criterion in list_predicted():
        columns[criterion.column] = sums @ np.array(criterion.weights)
    return columns

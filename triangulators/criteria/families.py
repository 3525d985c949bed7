"""Families of criteria with weights of the user: `mixed` and `calibrated`.

The name of a mixture can contain its weights: "mixed=1/0.5/0" is alpha 1, beta 0.5 and gamma 0.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from triangulators.criteria.criterion import FEATURES, MAX_WEIGHT, Criterion, weighted_sum
from triangulators.errors import ArgumentError

WEIGHTS_MARK = "="
"""Separates a criterion's name from its weights."""

WEIGHTS_SEPARATOR = "/"
"""Separates weights; a comma separates the names in a list."""

BYTES_PER_TRIANGLE = 24.0  # three vertices of two 4-byte coordinates: the paper's M
WORST_SHAPE = 240.0  # degrees; a triangle flattened to angles 180, 0, 0

CALIBRATED_FEATURES = (
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
    name = "mixed" if weights == (1, 1, 1) else f"mixed{WEIGHTS_MARK}{write_weights(weights)}"
    problem = _problem_of_weights(dict(zip(MIXED_WEIGHTS, weights, strict=True)))
    if problem:
        raise _invalid_weights(name, problem)
    linear = weighted_sum(
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
    """Return why the weights of `mixed` are invalid, or None if they are valid."""
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
        f"criterion {name!r}: {problem}; give mixed=alpha/beta/gamma, "
        "3 finite numbers, none negative and one above zero"
    )


def calibrated(coefficients: Mapping[str, float]) -> Criterion:
    """Return a device's fitted cost.

    Parameters
    ----------
    coefficients
        Weights of some of the features `CALIBRATED_FEATURES`, by name.

    Returns
    -------
    Criterion
        In the coefficients' unit of time.

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
    description = "T, S, H, w*h, D, Q, P and R at the rates fitted on a device"
    linear = weighted_sum("calibrated", description, "calibrated time", "", "s", **coefficients)
    return replace(linear, parameters=True)


def read_weights(text: str) -> dict[str, float]:
    """Parse weights of `mixed` such as "1/0.5/0"; return them by name.

    Raises `ArgumentError` unless there are three numbers; `mixed` checks their values.
    """
    try:
        weights = [float(part) for part in text.split(WEIGHTS_SEPARATOR)]
        return dict(zip(MIXED_WEIGHTS, weights, strict=True))
    except ValueError as error:
        problem = f"{text!r} is not three numbers"
        raise _invalid_weights(f"mixed{WEIGHTS_MARK}{text}", problem) from error


def write_weights(values: tuple[float, ...]) -> str:
    """Format weights for `read_weights`, each in its shortest form: 1, not 1.0."""
    # Adding zero turns -0.0 into 0.0.
    return WEIGHTS_SEPARATOR.join(repr(float(value) + 0.0).removesuffix(".0") for value in values)

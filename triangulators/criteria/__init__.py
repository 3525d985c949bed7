"""Criteria: what a triangle is predicted to cost, and costs in the form that compiled code takes.

catalogue      the criteria by name
features       what one triangle is made of, which every built-in criterion weighs
quads          quads that a triangle shades in one place on the pixel grid
weights        the weights in a criterion's name
cost           a criterion as compiled code takes it
"""

from triangulators.criteria.catalogue import (
    CALIBRATED,
    CRITERIA,
    FEATURES_KEPT,
    Criterion,
    calibrated,
    find,
    mixed,
    names,
    predict,
    predicted,
)
from triangulators.criteria.weights import FEATURES

__all__ = [
    "CALIBRATED",
    "CRITERIA",
    "FEATURES",
    "FEATURES_KEPT",
    "Criterion",
    "calibrated",
    "find",
    "mixed",
    "names",
    "predict",
    "predicted",
]

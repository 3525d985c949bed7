"""What weights are of, and how a criterion's name has them.

`mixed=1/0.5/0` is alpha 1, beta 0.5, gamma 0. Apart from the features' compiled code.
"""

import math

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

MARK = "="
"""Between a criterion's name and its weights."""

BETWEEN = "/"
"""Between weights; a comma separates the names in a list."""


def read_weights(criterion: str, text: str, names: tuple[str, ...]) -> dict[str, float]:
    """Return the weights called `names` that `text` gives a criterion, such as `1/0.5/0`.

    Raises `UnknownName` unless there are as many figures as names, each finite and not negative,
    one of them positive.
    """
    given = f"criterion '{criterion}{MARK}{text}'"
    form = f"{criterion}{MARK}{BETWEEN.join(names)}"
    parts = text.split(BETWEEN)
    if len(parts) != len(names):
        raise UnknownName(f"{given}: give {len(names)} weights, {form}, not {len(parts)}")
    try:
        values = [float(part) for part in parts]
    except ValueError:
        raise UnknownName(f"{given}: the weights of {form} are numbers") from None
    if not all(math.isfinite(value) and value >= 0.0 for value in values):
        raise UnknownName(f"{given}: the weights of {form} are finite and not negative")
    if not any(values):
        raise UnknownName(f"{given}: one of the weights of {form} must be above zero")
    return dict(zip(names, values, strict=True))


def write_weights(values: tuple[float, ...]) -> str:
    """Return weights as `read_weights` takes them, each in its shortest form: 1, not 1.0."""
    # Adding zero turns -0.0 into 0.0.
    return BETWEEN.join(repr(float(value) + 0.0).removesuffix(".0") for value in values)

"""Names of the features, in the order that weights have, apart from their compiled code."""

FEATURES = (
    "triangles",
    "area",
    "half_perimeter",
    "bbox_area",
    "edge_length",
    "shape",
    "rotated_bbox_area",
    "expected_quads",
    "expected_blocks",
    "expected_setups",
)

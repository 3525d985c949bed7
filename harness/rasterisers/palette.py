"""Colours that tell polygons apart, the same from every rasteriser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def colours(polygons: NDArray[np.int32]) -> NDArray[np.uint32]:
    """Return an opaque colour for each polygon number, little-endian RGBA in (m,) uint32."""
    mixed = (polygons.astype(np.uint32) + np.uint32(1)) * np.uint32(2654435761)
    return (mixed >> np.uint32(8)) | np.uint32(0xFF404040)

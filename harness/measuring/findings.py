"""What measuring a scene brings to light, in the order in which it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.stored.folder import Record

Columns = Mapping[str, NDArray[Any]]
"""Figures of each polygon, (p,) each."""


@dataclass(frozen=True)
class Framed:
    """A view's frame was made."""

    frame: Frame

    def facts(self) -> dict[str, Any]:
        """Return what snapping to the grid did to the scene, JSON-ready."""
        frame, view = self.frame, self.frame.view
        return {
            "resolution": view.resolution,
            "rotation": view.rotation,
            "fit": view.fit,
            "scale": frame.scale,
            "polygons": len(frame.source),
            "vertices": len(frame.points),
            "dropped": [list(entry) for entry in frame.dropped],
            "repaired": [list(entry) for entry in frame.repaired],
        }


@dataclass(frozen=True)
class Triangulated:
    """A frame was triangulated; `triangles` (m, 3) by triangulator, rows of `frame.points`."""

    frame: Frame
    triangles: dict[str, NDArray[np.int32]]


@dataclass(frozen=True)
class Counted:
    """A case was counted, and is to be timed; `record` is the finished one but for its time."""

    record: Record
    columns: Columns | None


@dataclass(frozen=True)
class Finished:
    """A case was measured, skipped or failed; `columns` only where no `Counted` had them."""

    record: Record
    columns: Columns | None = None


Finding = Framed | Triangulated | Counted | Finished

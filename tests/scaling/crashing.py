"""Work whose process ends at a footprint that is far away."""

import ctypes
from pathlib import Path
from typing import Any

from harness.export import export
from harness.scaling.dataset import FilePart, PartResult
from harness.scaling.triangulated import Triangulating

FAR = 100_000.0


class CrashingOnFar(Triangulating):
    """A footprint east of `FAR` ends the process as a fault in C would."""

    def make(self, part: FilePart, place: Path, threads: int | None) -> PartResult:
        triangulate = export.triangulate_many

        def triangulate_or_crash(polygons: Any, *more: Any, **how: Any) -> Any:
            if (polygons.coords[:, 0] > FAR).any():
                ctypes.string_at(0)
            return triangulate(polygons, *more, **how)

        export.triangulate_many = triangulate_or_crash
        try:
            return super().make(part, place, threads)
        finally:
            export.triangulate_many = triangulate

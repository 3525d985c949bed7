"""Triangulation that crashes at a distant footprint."""

import ctypes
from pathlib import Path
from typing import Any

from harness.export import export
from harness.scaling.dataset import FilePart, PartResult
from harness.scaling.triangulated import Triangulating

FAR = 100_000.0


class CrashingOnFar(Triangulating):
    """Triangulate, or end the process at a footprint east of `FAR`, like a fault in C."""

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        triangulate = export.triangulate_many

        def triangulate_or_crash(polygons: Any, *more: Any, **keywords: Any) -> Any:
            if (polygons.coords[:, 0] > FAR).any():
                ctypes.string_at(0)
            return triangulate(polygons, *more, **keywords)

        export.triangulate_many = triangulate_or_crash
        try:
            return super().write_part(part, path, threads)
        finally:
            export.triangulate_many = triangulate

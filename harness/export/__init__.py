"""Triangles for other programs: glTF, OBJ, PLY, STL, NPZ, GeoJSON, GeoParquet."""

from harness.cache import Cache, CacheInfo, default_path
from harness.export.export import FORMATS, Report, export_file

__all__ = ["FORMATS", "Cache", "CacheInfo", "Report", "default_path", "export_file"]

"""Triangles for other programs: glTF, OBJ, PLY, STL, NPZ, GeoJSON, GeoParquet."""

from harness.export.export import FORMATS, Report, export_file
from harness.triangulating.database import DatabaseInfo, ModelDatabase, default_path

__all__ = ["FORMATS", "DatabaseInfo", "ModelDatabase", "Report", "default_path", "export_file"]

"""Triangles for other programs: glTF, OBJ, NPZ, GeoJSON, GeoParquet."""

from harness.export.export import FORMATS, Report, export_file

__all__ = ["FORMATS", "Report", "export_file"]

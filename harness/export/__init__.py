"""Triangles for other programs: glTF, OBJ, NPZ, GeoJSON, GeoParquet."""

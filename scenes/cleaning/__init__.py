"""Any geometries in, valid polygons out: validity, map projection, layout, fill rules."""

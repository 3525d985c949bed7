"""Map tiles, each a view of its own: archives, the vector tile format, scenes of polygons."""

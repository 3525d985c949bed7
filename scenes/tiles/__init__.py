"""Map tiles, each a separate view: archives, the vector tile format, scenes of polygons."""

"""Triangulators by name, and verified triangulations of a frame's polygons."""

"""Compiled kernels, their cache on disk, and basic operations, independent of polygons."""

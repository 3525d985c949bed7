"""Millions of polygons at once: ragged arrays, threads, and the device that is faster."""

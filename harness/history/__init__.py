"""Follows each metric over many runs, which stay plain folders, and marks where it changed."""

"""Follows each metric over many runs, which stay plain folders, and marks where it changed."""

from harness.history.series import Series, find_runs, read_series

__all__ = ["Series", "find_runs", "read_series"]

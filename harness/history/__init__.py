"""Follows each metric over many runs, which stay plain folders, and marks where it changed."""

from harness.history.choosing import Choice, matching, worth_showing
from harness.history.series import Series, find_runs, read_series

__all__ = ["Choice", "Series", "find_runs", "matching", "read_series", "worth_showing"]

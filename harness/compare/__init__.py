"""Compares two runs and says what changed: for a person, for a machine, and as a CI gate."""

from harness.compare.comparison import compare_runs, no_baseline
from harness.compare.model import Comparison
from harness.compare.settings import Settings

__all__ = ["Comparison", "Settings", "compare_runs", "no_baseline"]

"""Compares two runs and says what changed: for a person, for a machine, and as a CI gate."""

from harness.compare.comparison import compare_runs, no_baseline
from harness.compare.gate_settings import Settings
from harness.compare.model import Comparison

__all__ = ["Comparison", "Settings", "compare_runs", "no_baseline"]

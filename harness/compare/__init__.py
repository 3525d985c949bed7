"""Comparison of two runs, as text, as JSON, and as a gate for CI."""

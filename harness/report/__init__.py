"""The report of a run or a study: one HTML file that needs nothing else, not even a network."""

from harness.report.page import write_report

__all__ = ["write_report"]

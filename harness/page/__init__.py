"""A page that measures: a run's frames and triangulations, drawn by whatever browser opens it."""

from harness.page.page import write_page, write_profile_page
from harness.page.result import import_result

__all__ = ["import_result", "write_page", "write_profile_page"]

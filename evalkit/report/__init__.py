"""The HTML report of one capture, and the comparison of all methods on it."""

from evalkit.report.compare import compare_methods
from evalkit.report.page import write_pictures, write_report

__all__ = ["compare_methods", "write_pictures", "write_report"]

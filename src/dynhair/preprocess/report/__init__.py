"""The page that shows what preprocessing made of a recording, and what is doubtful in it."""

from dynhair.preprocess.report.page import write_report

__all__ = ["write_report"]

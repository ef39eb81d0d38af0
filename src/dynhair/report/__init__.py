"""What comparisons found: tables as the paper lays them out, plots, pictures, videos, and a blind study of users."""

from dynhair.report.answers import StudySummary, sum_user_study
from dynhair.report.writing import write_report

__all__ = ["StudySummary", "sum_user_study", "write_report"]

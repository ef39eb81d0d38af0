"""Validation of captures: every file is read, and what is wrong is listed with how to mend it."""

from dynhair.capture.check.findings import Finding, print_findings
from dynhair.capture.check.run import check_capture, run_check
from dynhair.capture.check.sheet import contact_sheet

__all__ = ["Finding", "check_capture", "contact_sheet", "print_findings", "run_check"]

"""One self-contained page about one or more runs, and its figures as files."""

from rigctl.report.write import Report, write_report

__all__ = ["Report", "write_report"]

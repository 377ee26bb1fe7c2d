"""The report: ``report.html`` for people, ``metrics.json`` for programs, figures as SVG."""

from ._html import check_report_folder, write_report
from ._summary import summary, verdict
from ._text import report_lines

__all__ = ["check_report_folder", "report_lines", "summary", "verdict", "write_report"]

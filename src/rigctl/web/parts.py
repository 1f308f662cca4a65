"""The parts of the page, in the order of the navigation: to add one, write its module and name it here."""

from __future__ import annotations

from rigctl.web import docs, live, procedure, report, runs, workbench
from rigctl.web.server_state import PagePart

PARTS: tuple[PagePart, ...] = (runs.PART, live.PART, workbench.PART, procedure.PART, report.PART, docs.PART)

"""The page's sections, one file each; `SECTIONS` is their order on the page.

A section of another part of rigctl (a comparison, a diagnosis) is a `Section` passed to `write_report`; it is
made in the same way as these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rigctl.report.run_data import RunData
from rigctl.report.section import Section
from rigctl.report.sections import campaign, events, measures, outcome, overview, provenance, records

#: each returns its section of the runs, or None if there is nothing to show in it
SECTIONS: tuple[Callable[[Sequence[RunData]], Section | None], ...] = (
    outcome.build,
    campaign.build,
    records.build,
    measures.build,
    overview.build,
    events.build,
    provenance.build,
)

"""What was measured: a run's folder while it is written, and afterwards.

`RunWriter` records, `open_run` reads; the catalogue is `find_run`, `list_runs`, `verify`,
`annotate`, `exclude` and `query`.
"""

from rigctl.dataset.catalogue import RunSummary, find_run, list_runs
from rigctl.dataset.curate import annotate, exclude, include
from rigctl.dataset.header import RunHeader, Source, calibrations_of, current_versions, source_of_rig
from rigctl.dataset.run import Record, Run, Switch, open_run
from rigctl.dataset.run_id import new_run_id
from rigctl.dataset.sql import QueryResult, query
from rigctl.dataset.verification import Condition, Verification, verify
from rigctl.dataset.writer import RunWriter

__all__ = [
    "Condition",
    "QueryResult",
    "Record",
    "Run",
    "RunHeader",
    "RunSummary",
    "RunWriter",
    "Source",
    "Switch",
    "Verification",
    "annotate",
    "calibrations_of",
    "current_versions",
    "exclude",
    "find_run",
    "include",
    "list_runs",
    "new_run_id",
    "open_run",
    "query",
    "source_of_rig",
    "verify",
]

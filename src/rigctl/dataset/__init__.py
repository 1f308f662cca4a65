"""What was measured: a run's folder while it is written, and afterwards.

`RunWriter` records, `open_run` reads; `find_run` and `list_runs` are the catalogue.
"""

from rigctl.dataset.catalogue import RunSummary, find_run, list_runs
from rigctl.dataset.header import RunHeader, Source, calibrations_of, current_versions, source_of_rig
from rigctl.dataset.run import Record, Run, Switch, open_run
from rigctl.dataset.run_id import new_run_id
from rigctl.dataset.writer import RunWriter

__all__ = [
    "Record",
    "Run",
    "RunHeader",
    "RunSummary",
    "RunWriter",
    "Source",
    "Switch",
    "calibrations_of",
    "current_versions",
    "find_run",
    "list_runs",
    "new_run_id",
    "open_run",
    "source_of_rig",
]

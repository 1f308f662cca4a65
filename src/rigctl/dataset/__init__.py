"""The dataset: a run's folder while it is written, and afterwards.

`RunWriter` records, `open_run` reads; the catalogue is `find_run`, `list_runs`, `verify`,
`annotate`, `exclude` and `query`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.dataset.catalogue import RunSummary as RunSummary
    from rigctl.dataset.catalogue import find_run as find_run
    from rigctl.dataset.catalogue import list_runs as list_runs
    from rigctl.dataset.curate import annotate as annotate
    from rigctl.dataset.curate import exclude as exclude
    from rigctl.dataset.curate import include as include
    from rigctl.dataset.recording.header import RunHeader as RunHeader
    from rigctl.dataset.recording.header import Source as Source
    from rigctl.dataset.recording.header import calibrations_of as calibrations_of
    from rigctl.dataset.recording.header import current_versions as current_versions
    from rigctl.dataset.recording.header import source_of_rig as source_of_rig
    from rigctl.dataset.recording.writer import RunWriter as RunWriter
    from rigctl.dataset.run import Record as Record
    from rigctl.dataset.run import Run as Run
    from rigctl.dataset.run import Switch as Switch
    from rigctl.dataset.run import open_run as open_run
    from rigctl.dataset.run_id import new_run_id as new_run_id
    from rigctl.dataset.sql import QueryResult as QueryResult
    from rigctl.dataset.sql import query as query
    from rigctl.dataset.verification import Condition as Condition
    from rigctl.dataset.verification import Verification as Verification
    from rigctl.dataset.verification import verify as verify

#: module of each name; loaded on first use, since half of them do not need the rig file reader
_WHERE = {
    "catalogue": (
        "RunSummary",
        "find_run",
        "list_runs",
    ),
    "curate": (
        "annotate",
        "exclude",
        "include",
    ),
    "recording.header": (
        "RunHeader",
        "Source",
        "calibrations_of",
        "current_versions",
        "source_of_rig",
    ),
    "run": (
        "Record",
        "Run",
        "Switch",
        "open_run",
    ),
    "run_id": ("new_run_id",),
    "sql": (
        "QueryResult",
        "query",
    ),
    "verification": (
        "Condition",
        "Verification",
        "verify",
    ),
    "recording.writer": ("RunWriter",),
}
_MODULES = {name: module for module, names in _WHERE.items() for name in names}

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


if not TYPE_CHECKING:  # lets a type checker report an unknown name

    def __getattr__(name: str) -> Any:
        """Load a public name on its first use."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        return value

"""The catalogue of runs: search, paging, notes, exclusions, and the content of a run.

In: requests of the page. Out: a sorted page of runs, one run in full, or the comparison of some. Sorting
and searching are left to the index of the catalogue: a project may have 100 000 runs, and the page shows
fifty. Conditions are the SQL of `rigctl runs list --where`, with a limit on the time they may take.

A run is named by its id only. On the command line a path is accepted too; in a request it could lead to
any folder of the computer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.errors import RigctlError
from rigctl.web.project_files import plain_id
from rigctl.web.request_handling import PageRequest, get, post
from rigctl.web.server_state import PagePart, Site

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

#: runs on one page
_MOST: Final = 500
#: s that a condition may take
_PATIENCE: Final = 10.0
#: records that are listed of a run
_MOST_RECORDS: Final = 2000


def routes(site: Site) -> Sequence[BaseRoute]:
    """The routes of the page."""
    catalogue = Catalogue(site)
    return (
        get("/api/runs", catalogue.page),
        get("/api/runs/difference", catalogue.difference),
        get("/api/runs/overlay", catalogue.overlay),
        get("/api/runs/{run}", catalogue.show),
        post("/api/runs/{run}/notes", catalogue.annotate),
        post("/api/runs/{run}/exclude", catalogue.exclude),
    )


class Catalogue:
    """The runs of one project, for a page."""

    def __init__(self, site: Site) -> None:
        self._site = site

    def page(self, request: PageRequest) -> dict[str, Any]:
        """A sorted page of the runs."""
        from rigctl.dataset.catalogue import page_of_runs

        self._site.require_project()
        listing = page_of_runs(
            self._site.project.runs,
            where=request.text("where", "").strip() or None,
            search=request.text("search", ""),
            sort=request.text("sort", "started"),
            descending=request.text("order", "down") != "up",
            first=request.whole("first", 0, 0, 1 << 40),
            count=request.whole("count", 50, 1, _MOST),
            seconds=_PATIENCE,
        )
        document = {"runs": [asdict(run) for run in listing.runs], "found": listing.found, "all": listing.all}
        return document | {"store": self._site.project.store}

    def show(self, request: PageRequest) -> dict[str, Any]:
        """One run: procedure, bench, operator, records and notes."""
        from rigctl.dataset.catalogue import status_of
        from rigctl.dataset.run_json import read_info

        folder = self._folder(request)
        info = read_info(folder)
        state = status_of(folder, info)
        records = [] if state in ("running", "unclosed") else _records(folder)
        names = ("id", "reason", "operator", "started", "duration", "clock", "seed", "rows", "device", "test")
        return {
            **{name: info.get(name) for name in names},
            "status": state,
            "unconfirmed": info.get("unconfirmed"),
            "procedure": info["procedure"].get("name"),
            "procedure_path": info["procedure"].get("path"),
            "rig": info["rig"].get("name"),
            "backend": info["backend"],
            "measures": info.get("measures", []),
            "annotations": info.get("annotations", []),
            "folder": folder,
            "records": records[:_MOST_RECORDS],
            "left_out": max(len(records) - _MOST_RECORDS, 0),
        }

    def annotate(self, request: PageRequest) -> dict[str, Any]:
        """Add a note to a run or a record of it."""
        from rigctl.dataset import annotate

        text = request.text("text").strip()
        if not text:
            raise RigctlError("a note needs a text")
        folder = self._folder(request)
        annotate(folder, text, record=_record(request.body.get("record")))
        return {"run": folder.name}

    def exclude(self, request: PageRequest) -> dict[str, Any]:
        """Exclude a record from analysis, or include it again; with a reason."""
        from rigctl.dataset import exclude, include

        reason = request.text("reason").strip()
        if not reason:
            raise RigctlError("a reason is needed: it is kept with the record")
        record = _record(request.body.get("record"))
        if record is None:
            raise RigctlError("record: a whole number is needed")
        folder = self._folder(request)
        (include if request.body.get("undo") is True else exclude)(folder, [record], reason)
        return {"run": folder.name}

    def difference(self, request: PageRequest) -> dict[str, Any]:
        """The difference between two campaigns, condition by condition."""
        from rigctl.dataset import open_run
        from rigctl.web.difference import difference

        self._site.require_project()
        first, second = (open_run(plain_id(request.text(name)), self._runs) for name in ("first", "second"))
        return difference(first, second)

    def overlay(self, request: PageRequest) -> dict[str, Any]:
        """Several runs over each other, as picked: one quantity over another, or over time."""
        from rigctl.dataset import open_run
        from rigctl.web.overlay import overlay

        self._site.require_project()
        runs = [open_run(plain_id(one), self._runs) for one in request.text("runs").split(",")]
        return overlay(runs, request.text("y", ""), request.text("x", ""))

    @property
    def _runs(self) -> Path:
        return self._site.project.runs

    def _folder(self, request: PageRequest) -> Path:
        from rigctl.dataset import find_run

        self._site.require_project()
        return find_run(plain_id(request.text("run")), self._runs)


def _record(given: object) -> int | None:
    if given is None:
        return None
    if not isinstance(given, int) or isinstance(given, bool):
        raise RigctlError("record: a whole number is needed", value=str(given))
    return given


def _records(folder: Path) -> list[dict[str, Any]]:
    """The rows of the table of records, in display units."""
    from rigctl.dataset import open_run

    run = open_run(folder)
    frame, units = run.records, run.record_units
    plain = {"record", "name", "path", "rate", "start", "end", "outcome", "excluded", "rows", "session"}
    values = [name for name in frame.columns if name not in plain]
    rows = []
    for row in frame.to_dict("records"):
        cells = [
            {"name": name, "value": row[name], "unit": units.get(name, "")}
            for name in values
            if row[name] is not None and row[name] == row[name]
        ]
        rows.append({name: row[name] for name in plain & set(frame.columns)} | {"values": cells})
    return rows


PART = PagePart("runs", "Runs", "What was measured: found, sorted, annotated, compared.", routes)

"""The routes of the workbench's page, and the socket of its sliders.

In: requests of buttons. Out: what may be chosen, or a job in the background (`rigctl.web.jobs`) with the
command that does the same, for copying: every action of the page is a command, so that a model's history
can be repeated by somebody without the page.

Analyses use the model in its file. Only sliders have another way, the socket, which connects the page
with a process of its own: a fault in machine code then ends one page, and neither the server nor a run.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.command_line import DataOptions, command
from rigctl.errors import RigctlError, unknown_name
from rigctl.web.project_files import plain_id, project_path
from rigctl.web.request_handling import PageRequest, get, post
from rigctl.web.server_state import Site
from rigctl.workbench.commands import Subject

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

#: the newest runs are offered; others are found on the page of runs
_MOST_RUNS: Final = 200
_VERBS: Final = ("compare", "diagnose", "design", "discover", "fit", "add", "remove", "improve")
_YAML: Final = frozenset({".yaml", ".yml"})
_MEASURED: Final = frozenset({".csv", ".gz", ".xlsx", ".parquet", ".tdms", ".mf4", ".mat"})
#: the name of each job
_NAMES: Final = {
    "compare": "Compare",
    "diagnose": "Diagnose",
    "design": "Next experiment",
    "discover": "Discover",
    "fit": "Fit",
    "add": "Add",
    "remove": "Remove",
    "improve": "Diagnose and add",
}


def workbench_routes(site: Site) -> Sequence[BaseRoute]:
    """The workbench's part of the server."""
    from starlette.routing import WebSocketRoute

    from rigctl.web.workbench.socket import session_endpoint

    return (
        get("/api/workbench/choices", lambda _: choices(site)),
        get("/api/workbench/history", lambda request: history(site, request)),
        post("/api/workbench/work", lambda request: begin(site, request)),
        post("/api/workbench/import", lambda request: bring_in(site, request)),
        post("/api/workbench/approve", lambda request: approve(site, request)),
        post("/api/workbench/procedure", lambda request: write_procedure(site, request)),
        WebSocketRoute("/api/workbench/session", session_endpoint(site)),
    )


def choices(site: Site) -> dict[str, Any]:
    """The runs and the models that may be chosen."""
    from rigctl.dataset import list_runs

    root = site.require_project()
    listed = list_runs(site.project.runs)
    runs = [one for one in listed if one.records][-_MOST_RUNS:][::-1]
    return {
        "runs": [
            {
                "id": one.id,
                "procedure": one.procedure or one.source,
                "started": one.started,
                "records": one.records,
                "status": one.status,
                "rig": one.rig,
            }
            for one in runs
        ],
        "more": len(listed) > len(runs),
        "models": [
            {"path": path.relative_to(root).as_posix(), "rig": _rig_of(path)}
            for path in _files(root / "models", _YAML)
        ],
        "rigs": [path.relative_to(root).as_posix() for path in _files(root / "rigs", _YAML)],
        "files": [
            path.relative_to(root).as_posix()
            for folder in (root, root / "data")
            for path in _files(folder, _MEASURED)
        ],
    }


def _files(folder: Path, endings: Collection[str]) -> list[Path]:
    """The files of a folder with one of these endings, by name."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in endings and path.is_file())


def _rig_of(path: Path) -> str:
    """The name of a model's bench; "" if the file does not state it, or cannot be read."""
    from rigctl.model import load_model

    try:
        rig = load_model(path).rig
    except RigctlError:
        return ""
    return rig.name if rig is not None else ""


def history(site: Site, request: PageRequest) -> dict[str, Any]:
    """The answer of ``rigctl model history M``."""
    from rigctl.files.version_suffix import split_version
    from rigctl.model import current_version, versions
    from rigctl.model.history.document import history_document

    head = split_version(project_path(site.require_project(), request.text("model")))[0]
    return history_document(versions(head), current_version(head))


def subject_of(site: Site, request: PageRequest) -> Subject:
    """The subject of the request, as typed on the command line.

    Raises
    ------
    RigctlError
        no run is chosen, or something is not the project's.
    """
    runs = [plain_id(run) for run in request.texts("runs")]
    if not runs:
        raise RigctlError("choose a run")
    project_path(site.require_project(), request.text("model"))
    choice = DataOptions(
        request.text("only", "") or None, request.text("hold_out", "") or None, tuple(request.texts("assume"))
    )
    return Subject(tuple(runs), request.text("model"), choice)


def begin(site: Site, request: PageRequest) -> dict[str, Any]:
    """Start the job of a button."""
    from rigctl.web.workbench import work

    verb, subject, effect = request.text("verb"), subject_of(site, request), request.text("effect", "")
    beside = request.text("beside", "") if verb == "compare" else ""
    if beside:
        project_path(site.project.root, beside)
    if verb not in _VERBS:
        raise unknown_name("work", verb, _VERBS)
    given = {
        "runs": list(subject.runs),
        "model": subject.model,
        "hold_out": subject.choice.hold_out,
        "only": subject.choice.only,
        "assume": list(subject.choice.assume),
        "effect": effect,
        "beside": beside,
    }
    name = f"{_NAMES[verb]} {effect}".strip()
    return site.jobs.start(
        name, command_of(verb, subject, effect, beside), getattr(work, verb), given
    ).document()


def command_of(verb: str, subject: Subject, effect: str = "", beside: str = "") -> str:
    """The command of a button; `beside` is another version to compare with."""
    if beside:
        words = [verb, *subject.runs, "--model", beside, "--model", subject.model]
        return command(words, subject.choice)
    if verb in ("fit", "add", "remove"):
        return subject.change(verb, *([effect] if effect else []))
    if verb == "improve":
        return subject.analysis("diagnose", "--apply")
    return subject.analysis(verb)


def approve(site: Site, request: PageRequest) -> dict[str, Any]:
    """Carry out a designed procedure on the simulated bench; the page of procedures does so on a real one."""
    from rigctl.web.workbench import work

    root = site.require_project()
    file = _free_name(root / "procedures")
    effects = request.texts("effects")
    written = file.relative_to(root).as_posix()
    words = ["simulate", written, *(word for one in effects for word in ("--with", one)), "--speed", "max"]
    given = {
        "procedure": request.text("procedure"),
        "file": file.as_posix(),
        "effects": effects,
        "seed": request.whole("seed", 0, 0, 2**31 - 1),
    }
    return site.jobs.start("Simulated bench", command(words), work.approve, given).document()


def bring_in(site: Site, request: PageRequest) -> dict[str, Any]:
    """Make a run of a file of the project: ``rigctl import FILE``."""
    from rigctl.web.workbench import work

    root, written, rig = site.require_project(), request.text("file"), request.text("rig", "")
    path = project_path(
        root, written, hint="Copy the file into the project's folder; 'rigctl import' takes it from anywhere"
    )
    assume = request.texts("assume")
    words = [
        "import",
        written,
        *(["--rig", rig] if rig else []),
        *(w for one in assume for w in ("--assume", one)),
    ]
    given = {"file": str(path), "rig": rig, "assume": assume}
    return site.jobs.start(f"Import {path.name}", command(words), work.bring_in, given).document()


def write_procedure(site: Site, request: PageRequest) -> dict[str, Any]:
    """Keep a designed procedure in the project, for the real bench, without starting it."""
    from rigctl.files.write import write_new

    root = site.require_project()
    file = _free_name(root / "procedures")
    file.parent.mkdir(exist_ok=True)
    write_new(file, request.text("procedure").encode("utf-8"))
    return {"file": file.relative_to(root).as_posix()}


def _free_name(folder: Path) -> Path:
    number = 1
    while (folder / f"next-{number}.yaml").exists():
        number += 1
    return folder / f"next-{number}.yaml"

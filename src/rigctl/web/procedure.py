"""A procedure: its text with errors marked, its plan, and its start, simulated or on the real bench.

In: requests of the page. Out: files of the project, the plan of a text or its errors, and the id of a run
that has been started. Checking expands the text as `rigctl check` does, without saving it.

A run is the command that a user would type, in a process and a process group of its own: it goes on when
the server ends, and a Ctrl-C for the server does not reach it. A click alone starts no real bench: its
name must be typed, which is checked here too, so that a manipulated page moves nothing.
"""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Final

from rigctl.child_process import module_command
from rigctl.command_line import command
from rigctl.errors import ExitCode, RigctlError, SeveralErrors
from rigctl.files.regular import read_text
from rigctl.web.project_files import project_file, project_files, project_path
from rigctl.web.request_handling import PageRequest, get, post
from rigctl.web.server_state import PagePart, Site

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

    from rigctl.plan import Plan

_FOLDER: Final = "procedures"
#: s for a run to start; after that it is no longer waited for
_BEGINS_WITHIN: Final = 30.0
_SPEEDS: Final = ("1x", "10x", "max")


def routes(site: Site) -> Sequence[BaseRoute]:
    """The routes of the page."""
    procedures = Procedures(site)
    return (
        get("/api/procedure", procedures.files),
        get("/api/procedure/file", procedures.read),
        get("/api/procedure/completion", lambda _: completion()),
        post("/api/procedure/check", procedures.check),
        post("/api/procedure/save", procedures.save),
        post("/api/procedure/start", procedures.start),
    )


class Procedures:
    """The procedures of one project."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._saving = threading.Lock()

    def files(self, request: PageRequest) -> dict[str, Any]:
        """The procedure files of the project."""
        return {"files": project_files(self._site.require_project(), _FOLDER)}

    def read(self, request: PageRequest) -> dict[str, Any]:
        """A file's text."""
        path = project_file(self._site.require_project(), request.text("path"))
        try:
            text = read_text(path)
        except UnicodeDecodeError as problem:
            raise RigctlError("the file is not UTF-8 text", value=request.text("path")) from problem
        return {"path": request.text("path"), "text": text, "sha256": _hash(text)}

    def check(self, request: PageRequest) -> dict[str, Any]:
        """The plan of a text, or its errors with their locations."""
        from datetime import UTC, datetime

        from rigctl.plan.identity import settled
        from rigctl.planning import preview
        from rigctl.planning.document import as_document
        from rigctl.planning.lost_devices import refuse_needed
        from rigctl.planning.rates import refuse_rates

        root = self._site.require_project()
        try:
            plan = _plan(project_path(root, request.text("path")), request.text("text"))
            refuse_rates(plan)
            refuse_needed(plan)
            forecast = preview(plan)
            warnings = plan.rig.warnings(datetime.now(UTC).date())
        except RigctlError as error:
            each = error.errors if isinstance(error, SeveralErrors) else (error,)
            return {"errors": [one.as_dict() for one in each], "plan": None}
        identity = plan.procedure.identity
        return {
            "errors": [],
            "plan": as_document(forecast, warnings),
            "backend": plan.rig.kind,
            "demands": settled(identity, {})[1],
        }

    def save(self, request: PageRequest) -> dict[str, Any]:
        """Write a text to the file it was read from, unless that has been changed meanwhile."""
        from rigctl.files.write import write_text

        root = self._site.require_project()
        path, text = self._writable(root, request.text("path")), request.text("text")
        with self._saving:  # if two windows save at once, the second is refused
            current = read_text(path, errors="replace") if path.is_file() else None
            known = request.text("sha256", "")
            if current is not None and _hash(current) != known:
                raise RigctlError(
                    "the file has changed since it was read",
                    value=request.text("path"),
                    hint="Copy your text, read the file again, and put it in there",
                    exit_code=ExitCode.FAILED,
                )
            write_text(path, text)
        return {"path": request.text("path"), "sha256": _hash(text)}

    def start(self, request: PageRequest) -> dict[str, Any]:
        """Start a run in a separate process, which continues even if this server ends.

        Starting the real bench requires typing its name: a click alone moves nothing.
        """
        root = self._site.require_project()
        path = project_file(root, request.text("path"))
        file = path.relative_to(root.resolve()).as_posix()
        plan = _plan(path, read_text(path))
        if request.text("bench") == "simulated":
            speed = request.text("speed", "1x")
            if speed not in _SPEEDS:
                raise RigctlError("not a speed", value=speed, expected=", ".join(_SPEEDS))
            words = ["simulate", file, "--speed", speed]
            if request.body.get("seed") is not None:
                words += ["--seed", str(request.whole("seed", 0, 0, 1 << 31))]
        else:
            if request.text("rig", "").strip() != plan.rig.name:
                raise RigctlError(
                    "the real bench is asked for by its name",
                    expected=f"'{plan.rig.name}', typed as it stands",
                )
            words = ["run", file, "--answer-in-browser"]
        for name in ("operator", "serial_number", "part"):
            if value := request.text(name, "").strip():
                words += [f"--{name.replace('_', '-')}={value}"]
        return {"run": self._begin(words), "command": command(words)}

    def _begin(self, words: Sequence[str]) -> str:
        """The id of the run that a command of these words has started.

        Raises
        ------
        RigctlError
            it has ended without starting one; says why.
        """
        from tempfile import TemporaryFile

        errors = TemporaryFile(dir=self._site.jobs.scratch)  # noqa: SIM115 - closed by the thread below
        # a Ctrl-C that ends the server must not end the run
        group = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        alone: dict[str, Any] = {"creationflags": group} if group else {"start_new_session": True}
        process = subprocess.Popen(  # noqa: S603 - this program, no shell
            module_command("rigctl", *words),
            cwd=self._site.project.root,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            **alone,
        )
        run_process = _RunProcess(process, errors)
        threading.Thread(target=run_process.wait, name="run", daemon=True).start()
        give_up = monotonic() + _BEGINS_WITHIN
        while monotonic() < give_up:
            ended = process.poll() is not None
            if (run := self._run_of(process.pid)) is not None:
                return run
            if ended:
                raise RigctlError(run_process.last_words(), exit_code=ExitCode.FAILED)
            sleep(0.05)
        raise RigctlError(
            f"the run has not started within {_BEGINS_WITHIN:g} s",
            hint="It may still start; the page Live then shows it",
            exit_code=ExitCode.FAILED,
        )

    def _run_of(self, pid: int) -> str | None:
        from rigctl.dataset.catalogue import newest_folders
        from rigctl.dataset.recording.writer_lock import read_state

        if not self._site.project.runs.is_dir():
            return None
        for folder in reversed(newest_folders(self._site.project.runs, 5)):
            state = read_state(folder)
            if state is not None and state.fields.get("pid") == pid and state.fresh:
                return folder.name
        return None

    def _writable(self, root: Path, name: str) -> Path:
        """A file in the folder of procedures, which may be new."""
        path, home = project_path(root, name), (root / _FOLDER).resolve()
        if path.suffix != ".yaml" or not path.is_relative_to(home) or path.is_dir():
            raise RigctlError(
                "a procedure is kept under procedures/", value=name, expected="procedures/NAME.yaml"
            )
        return path


@dataclass
class _RunProcess:
    """A process that was started, and its error messages."""

    process: subprocess.Popen[bytes]
    errors: Any
    output: str = ""

    def __post_init__(self) -> None:
        self._over = threading.Event()

    def wait(self) -> None:
        """Reap the process at its end."""
        self.process.wait()
        with suppress(OSError, ValueError):
            self.errors.seek(0)
            self.output = self.errors.read(100_000).decode("utf-8", "replace")
            self.errors.close()
        self._over.set()

    def last_words(self) -> str:
        """The reason for its end."""
        self._over.wait(2.0)
        lines = [line.removeprefix("rigctl: ") for line in self.output.splitlines() if line.strip()]
        return "\n".join(lines[-5:]) or "the run's program has ended without a message"


def _plan(path: Path, text: str) -> Plan:
    from rigctl.procedure import expand, parse_procedure
    from rigctl.rig import load_rig

    read = parse_procedure(text, path)
    return expand(read, load_rig(read.rig_path), {})


def _hash(text: str) -> str:
    from hashlib import sha256

    return sha256(text.encode("utf-8")).hexdigest()


@lru_cache(maxsize=1)
def completion() -> dict[str, Any]:
    """Completions for an editor, from the schema of procedures: steps, and the fields of each key."""
    from rigctl.files.schema import json_schema
    from rigctl.procedure import ProcedureFile

    schema = json_schema(ProcedureFile, title="procedure")
    parts: dict[str, Any] = schema["$defs"]
    steps: dict[str, str] = {}
    fields: dict[str, dict[str, str]] = {"": _fields(schema)}
    beside: dict[str, dict[str, str]] = {}
    for name, part in parts.items():
        if not name.endswith("Step"):
            continue
        key = next((one for one in part.get("required", ()) if one != "do"), "do")
        steps[key] = str(part.get("description", ""))
        beside[key] = {field: about for field, about in _fields(part).items() if field != key}
        for target in _targets(part["properties"][key]):
            fields.setdefault(key, {}).update(_fields(parts[target]))
    for part in parts.values():
        for name, about in part.get("properties", {}).items():
            for target in _targets(about):
                if not target.endswith("Step"):
                    fields.setdefault(name, {}).update(_fields(parts[target]))
    for name, about in schema["properties"].items():
        for target in _targets(about):
            if not target.endswith("Step"):
                fields.setdefault(name, {}).update(_fields(parts[target]))
    return {"steps": steps, "fields": fields, "beside": beside}


def _fields(part: dict[str, Any]) -> dict[str, str]:
    return {name: str(about.get("description", "")) for name, about in part.get("properties", {}).items()}


def _targets(about: object) -> list[str]:
    """The alternatives of a schema for a value."""
    if isinstance(about, dict):
        targets = [str(about["$ref"]).rpartition("/")[2]] if "$ref" in about else []
        return targets + [one for name in ("anyOf", "oneOf", "allOf") for one in _targets(about.get(name))]
    if isinstance(about, list):
        return [one for each in about for one in _targets(each)]
    return []


PART = PagePart("procedure", "Procedure", "What a bench is to do, its plan, and its start.", routes)

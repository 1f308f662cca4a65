"""What takes long: each piece of work in a process of its own, watched, stopped, its result kept.

The work is a command of rigctl, or a function of a module that is given what it needs as plain values and a
`Report` to say how far it is. It begins with nothing of the server's: it opens runs and models itself, and
what it returns is made JSON.
"""

from __future__ import annotations

import multiprocessing
import shlex
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from time import monotonic
from typing import IO, Any, Final, Literal

from rigctl.errors import ExitCode, RigctlError

State = Literal["working", "done", "failed", "stopped", "died"]
#: at a time; each may use every core
_MOST_WORKING: Final = 3
#: results that are kept
_MOST_KEPT: Final = 50
#: s that a process has to end by itself once it is asked to
_GRACE: Final = 2.0


class Report:
    """The work's way to say how far it is."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def __call__(self, text: str, share: float | None = None, partial: Any = None) -> None:
        """Say what is being done.

        Parameters
        ----------
        share: of the work that is done, 0 to 1; None where that is not known.
        partial: what is known already, made JSON.
        """
        from rigctl.files.write import to_json

        self._pipe.send(("progress", text, share, None if partial is None else to_json(partial, indent=None)))


Work = Callable[..., Any]


@dataclass
class Job:
    """A piece of work; its fields change while it goes on.

    Parameters
    ----------
    name: what a person calls it.
    command: what does the same on the command line.
    state: ``died`` where its process ended without a word.
    text, share: how far it is.
    partial, result: what it has found, as JSON; None before.
    error: why it failed, as `RigctlError.as_dict` has it.
    """

    name: str
    command: str
    id: str = field(default_factory=lambda: token_hex(8))
    began: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    state: State = "working"
    text: str = ""
    share: float | None = None
    partial: str | None = None
    result: str | None = None
    error: dict[str, Any] | None = None
    since: float = field(default_factory=monotonic)
    seconds: float = 0.0

    def document(self) -> dict[str, Any]:
        """What a page is told of it."""
        import json

        told = {name: getattr(self, name) for name in ("id", "name", "command", "began", "state", "text")}
        return told | {
            "share": self.share,
            "error": self.error,
            "seconds": round(monotonic() - self.since if self.state == "working" else self.seconds, 1),
            "partial": json.loads(self.partial) if self.partial else None,
            "result": json.loads(self.result) if self.result else None,
        }


class Jobs:
    """The work of one server."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._jobs: dict[str, Job] = {}
        self._processes: dict[str, Any] = {}
        self._scratch: TemporaryDirectory[str] | None = None
        self._lock = threading.Lock()

    def start(self, name: str, command: str, work: Work, *arguments: Any) -> Job:
        """Begin a piece of work.

        Parameters
        ----------
        work: a function of a module, called with a `Report` and `arguments` in the project's folder.

        Raises
        ------
        RigctlError
            so much is being worked on that more would only be slower.
        """
        with self._lock:
            self._require_room()
            job = Job(name, command)
            context = multiprocessing.get_context("spawn")
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(
                target=_carry_out, args=(theirs, str(self._folder), work, arguments), name=f"rigctl {name}"
            )
            process.start()
            theirs.close()
            self._jobs[job.id], self._processes[job.id] = job, process
            self._forget()
        threading.Thread(target=self._watch, args=(job, ours), name=f"job {job.id}", daemon=True).start()
        return job

    def start_command(self, name: str, arguments: Sequence[str]) -> Job:
        """Begin a command of rigctl, whose answer is the result: ``--json`` is added to it.

        Raises
        ------
        RigctlError
            as `start`.
        """
        with self._lock:
            self._require_room()
            job = Job(name, "rigctl " + shlex.join(arguments))
            process = subprocess.Popen(  # noqa: S603 - this program, no shell
                [sys.executable, "-m", "rigctl", *arguments, "--json"],
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
            )
            self._jobs[job.id], self._processes[job.id] = job, _Command(process)
            self._forget()
        threading.Thread(
            target=self._watch_command, args=(job, process), name=f"job {job.id}", daemon=True
        ).start()
        return job

    @property
    def scratch(self) -> Path:
        """A folder of this user's alone for what work writes; removed when the server ends."""
        with self._lock:
            if self._scratch is None:
                self._scratch = TemporaryDirectory(prefix="rigctl-", ignore_cleanup_errors=True)
            return Path(self._scratch.name)

    def find(self, job_id: str) -> Job:
        """A piece of work by its id.

        Raises
        ------
        RigctlError
            there is none, or it has been forgotten.
        """
        job = self._jobs.get(job_id)
        if job is None:
            raise RigctlError("there is no such piece of work; the server may have been started anew")
        return job

    def all(self) -> list[Job]:
        """Every piece of work that is remembered, newest first."""
        return list(self._jobs.values())[::-1]

    def stop(self, job_id: str) -> Job:
        """End a piece of work, whatever it does; nothing happens to one that has ended."""
        job = self.find(job_id)
        with self._lock:
            if job.state == "working":
                job.state = "stopped"
        _end(self._processes.get(job_id))
        return job

    def close(self) -> None:
        """End all of them."""
        for job_id in list(self._processes):
            with suppress(RigctlError):
                self.stop(job_id)
        if self._scratch is not None:
            self._scratch.cleanup()

    def _require_room(self) -> None:
        if sum(job.state == "working" for job in self._jobs.values()) >= _MOST_WORKING:
            raise RigctlError(
                f"{_MOST_WORKING} pieces of work are in progress",
                hint="Wait for one of them, or stop it",
                exit_code=ExitCode.FAILED,
            )

    def _watch_command(self, job: Job, process: subprocess.Popen[str]) -> None:
        """Take what a command says until it ends."""
        assert process.stdout is not None  # noqa: S101 - opened as pipes
        assert process.stderr is not None  # noqa: S101
        said: list[str] = []

        def listen(lines: IO[str]) -> None:
            for line in lines:
                if line.strip():
                    said.append(line.strip())
                    job.text = said[-1]

        listener = threading.Thread(target=listen, args=(process.stderr,), daemon=True)
        listener.start()
        answer = process.stdout.read()
        code = process.wait()
        listener.join(_GRACE)
        for stream in (process.stdout, process.stderr):
            stream.close()
        with self._lock:
            job.seconds = monotonic() - job.since
            if job.state == "working":
                _settle(job, code, answer, said)
            self._processes.pop(job.id, None)

    def _watch(self, job: Job, pipe: Connection) -> None:
        """Take what a process says until it ends."""
        with suppress(EOFError, OSError):
            while True:
                self._take(job, pipe.recv())
        pipe.close()
        process = self._processes[job.id]
        process.join()
        with self._lock:
            job.seconds = monotonic() - job.since
            if job.state == "working":
                job.state, job.error = "died", _death(process.exitcode)
            self._processes.pop(job.id, None)

    def _take(self, job: Job, said: tuple[Any, ...]) -> None:
        with self._lock:
            if job.state != "working":
                return
            match said:
                case ("progress", text, share, partial):
                    job.text, job.share = text, share
                    job.partial = partial or job.partial
                case ("done", result):
                    job.state, job.result, job.share = "done", result, 1.0
                case ("failed", error):
                    job.state, job.error = "failed", error

    def _forget(self) -> None:
        ended = [job.id for job in self._jobs.values() if job.state != "working"]
        for job_id in ended[: max(len(self._jobs) - _MOST_KEPT, 0)]:
            del self._jobs[job_id]


class _Command:
    """A command with the methods of a process of `multiprocessing`."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.terminate, self.kill = process.terminate, process.kill

    def is_alive(self) -> bool:
        """Whether it goes on."""
        return self._process.poll() is None

    def join(self, timeout: float) -> None:
        """Wait for its end, so many s at most."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout)


def _settle(job: Job, code: int, answer: str, said: Sequence[str]) -> None:
    """What came of a command, from its exit code and its words."""
    import json

    try:
        found = json.loads(answer)
    except ValueError:
        found = None
    if isinstance(found, dict) and "error" in found:
        job.state, job.error = "failed", found["error"]
    elif isinstance(found, dict):
        job.state, job.result, job.share = "done", answer, 1.0
    elif code < 0 or not said:
        job.state, job.error = "died", _death(code)
    else:
        job.state, job.error = "failed", RigctlError(said[-1]).as_dict()


def _death(code: int | None) -> dict[str, Any]:
    return RigctlError(
        f"the process that worked on it has ended without a word (code {code})",
        hint="It may have run out of memory, or somebody has ended it; begin it again",
    ).as_dict()


def _end(process: Any) -> None:
    if process is None:
        return
    process.terminate()
    process.join(_GRACE)
    if process.is_alive():
        process.kill()


def _carry_out(pipe: Connection, folder: str, work: Work, arguments: tuple[Any, ...]) -> None:
    """The process: do the work and say what came of it."""
    import os
    import signal

    from rigctl.files.write import to_json

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's, which ends this process
    os.chdir(folder)
    try:
        pipe.send(("done", to_json(work(Report(pipe), *arguments), indent=None)))
    except RigctlError as error:
        pipe.send(("failed", error.as_dict()))
    except Exception as fault:  # noqa: BLE001 - said to whoever began it
        pipe.send(("failed", RigctlError(f"a fault of rigctl itself: {fault!r}").as_dict()))

"""Background jobs: each runs in a separate process, is monitored, can be stopped, and its result is kept.

A job is a command of rigctl, or a function of a module that is given plain values and a `Report` for its
progress. It shares no state with the server: it opens runs and models itself, and its result becomes JSON.

One thread for each job reads what its process says, until the process ends; under the lock it then
settles the state. A job is settled once: whoever stops it sets the state first, and what its process
still says is ignored. A process that ends without a result has died, which is said.
"""

from __future__ import annotations

import multiprocessing
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from multiprocessing.connection import Connection, wait
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from time import monotonic
from typing import IO, Any, Final, Literal

from rigctl.child_process import module_command
from rigctl.command_line import command
from rigctl.errors import ExitCode, RigctlError
from rigctl.json_values import parse_json

State = Literal["working", "done", "failed", "stopped", "died"]
#: most jobs at a time; each may use every core
_MOST_WORKING: Final = 3
#: results that are kept
_MOST_KEPT: Final = 50
#: s for a process to end after it has been asked to
_GRACE: Final = 2.0


class Report:
    """Reports the progress of a job."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def __call__(self, text: str, share: float | None = None, partial: Any = None) -> None:
        """Report the current activity.

        Parameters
        ----------
        share: completed share, 0 to 1; None if unknown.
        partial: the partial result, for JSON.
        """
        from rigctl.files.write import to_json

        self._pipe.send(("progress", text, share, None if partial is None else to_json(partial, indent=None)))


Work = Callable[..., Any]


@dataclass
class Job:
    """A job; its fields change while it runs.

    Parameters
    ----------
    name: for people.
    command: the equivalent command line.
    state: ``died`` if its process ended without a message.
    text, share: progress.
    partial, result: as JSON; None before.
    error: why it failed, as in `RigctlError.as_dict`.
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
        """Its state for a page."""
        import json

        fields = {name: getattr(self, name) for name in ("id", "name", "command", "began", "state", "text")}
        return fields | {
            "share": self.share,
            "error": self.error,
            "seconds": round(monotonic() - self.since if self.state == "working" else self.seconds, 1),
            "partial": json.loads(self.partial) if self.partial else None,
            "result": json.loads(self.result) if self.result else None,
        }


class Jobs:
    """The jobs of one server."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._jobs: dict[str, Job] = {}
        self._processes: dict[str, Any] = {}
        self._scratch: TemporaryDirectory[str] | None = None
        self._lock = threading.Lock()

    def start(self, name: str, command: str, work: Work, *arguments: Any) -> Job:
        """Start a job.

        Parameters
        ----------
        work: a function of a module, called with a `Report` and `arguments` in the project's folder.

        Raises
        ------
        RigctlError
            the maximum number of jobs is running.
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
        """Start a command of rigctl, whose answer is the result: ``--json`` is added to it.

        Raises
        ------
        RigctlError
            as `start`.
        """
        with self._lock:
            self._require_room()
            job = Job(name, command(arguments))
            process = subprocess.Popen(  # noqa: S603 - this program, no shell
                module_command("rigctl", *arguments, "--json"),
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
        """A private folder for files of jobs; removed when the server ends."""
        with self._lock:
            if self._scratch is None:
                self._scratch = TemporaryDirectory(prefix="rigctl-", ignore_cleanup_errors=True)
            return Path(self._scratch.name)

    def find(self, job_id: str) -> Job:
        """A job by its id.

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
        """All remembered jobs, newest first."""
        return list(self._jobs.values())[::-1]

    def stop(self, job_id: str) -> Job:
        """Terminate a job; has no effect on one that has ended."""
        job = self.find(job_id)
        with self._lock:
            if job.state == "working":
                # Before the process is ended, so that its end is not taken for a death.
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
        """Read the output of a command until it ends."""
        assert process.stdout is not None  # noqa: S101 - opened as pipes
        assert process.stderr is not None  # noqa: S101
        messages: deque[str] = deque(maxlen=1)  # only the last line is shown, and a job can write for days

        def listen(lines: IO[str]) -> None:
            for line in lines:
                if line.strip():
                    messages.append(line.strip())
                    job.text = messages[-1]

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
                _settle(job, code, answer, messages)
            self._processes.pop(job.id, None)

    def _watch(self, job: Job, pipe: Connection) -> None:
        """Read the messages of a process until it ends."""
        process = self._processes[job.id]
        with suppress(EOFError, OSError):
            # on Windows, the pipe of a process that is ended while it starts stays open
            while pipe in wait([pipe, process.sentinel]) or pipe.poll():
                self._take(job, pipe.recv())
        pipe.close()
        process.join()
        with self._lock:
            job.seconds = monotonic() - job.since
            if job.state == "working":
                job.state, job.error = "died", _death(process.exitcode)
            self._processes.pop(job.id, None)

    def _take(self, job: Job, message: tuple[Any, ...]) -> None:
        with self._lock:
            if job.state != "working":
                return
            match message:
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
    """A command with the interface of a `multiprocessing` process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.terminate, self.kill = process.terminate, process.kill

    def is_alive(self) -> bool:
        """Whether it is running."""
        return self._process.poll() is None

    def join(self, timeout: float) -> None:
        """Wait for its end, with a time limit in s."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout)


def _settle(job: Job, code: int, answer: str, messages: Sequence[str]) -> None:
    """Set the outcome of a command, from its exit code and its output."""

    try:
        result = parse_json(answer)
    except ValueError:
        result = None
    if isinstance(result, dict) and "error" in result:
        job.state, job.error = "failed", result["error"]
    elif isinstance(result, dict):
        job.state, job.result, job.share = "done", answer, 1.0
    elif code < 0 or not messages:
        job.state, job.error = "died", _death(code)
    else:
        job.state, job.error = "failed", RigctlError(messages[-1]).as_dict()


def _death(code: int | None) -> dict[str, Any]:
    return RigctlError(
        f"the process that worked on it has ended without a message (code {code})",
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
    """Entry point of the process: do the work and report the outcome."""
    import os
    import signal

    from rigctl.files.write import to_json

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's, which ends this process
    os.chdir(folder)
    try:
        pipe.send(("done", to_json(work(Report(pipe), *arguments), indent=None)))
    except RigctlError as error:
        pipe.send(("failed", error.as_dict()))
    except Exception as fault:  # noqa: BLE001 - reported to the page that started it
        pipe.send(("failed", RigctlError(f"a fault of rigctl itself: {fault!r}").as_dict()))

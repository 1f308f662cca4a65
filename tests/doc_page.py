"""Executes a page of the documentation: its commands, its Python and its files, in order.

A page is read as Markdown with four kinds of fenced block, and everything else is prose:

- ``console``: lines that begin with ``$ `` are commands, the others what they print on stdout, or after
  ``2>&1`` on stderr too. Of commands only ``rigctl …``, ``cd …`` and ``echo $?`` are known, joined by ``&&``.
  ``echo $?`` says the exit code of the command before it; one that is not followed by it must end with 0. A
  command that is shown with no output may print anything. ``...`` stands for anything that is left out.
- ``pycon``: an interpreter session, checked as a doctest.
- any other, when a comment stands directly before it: ``<!-- file: PATH -->``: the block is written to PATH.

Comments directly before a block change what is done with it:

- ``<!-- not run: WHY -->``: the block needs a bench, a person or endless time;
- ``<!-- figures vary -->``: every number of its output may be another one;
- ``<!-- figures vary, of twelve records -->``: and the shipped campaign, which a new project holds, is cut to
  twelve of its records before the commands of the page read it;
- ``<!-- killed in record N -->``: its command is killed as soon as that record is open;
- ``<!-- server: RIG -->``: the device of that rig file, or each of its devices, is served, at the address
  that the file names.
"""

from __future__ import annotations

import doctest
import io
import json
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_BLOCK = re.compile(
    r"(?:^<!-- (?P<note>[^\n]*?) -->\n\n?)?^```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
_RUN_ID = re.compile(r"\b\d{8}-\d{6}-[a-z0-9-]+")
#: records of the shipped campaign of a leaking valve that show on the page what all of them show
TWELVE_RECORDS = {"001", "004", "005", "008", "013", "016", "019", "020", "025", "027", "028", "030"}
#: the folder of a page's project, as the page shows it
HOME = "/home/ada"


@dataclass(frozen=True)
class Block:
    """A fenced block, the comment before it, and the line of the page at which it begins."""

    kind: str
    text: str
    note: str
    line: int


@dataclass(frozen=True)
class Step:
    """A command of a ``console`` block, its expected output, and its exit code."""

    command: str
    shown: str
    code: int


def blocks(page: str) -> Iterator[Block]:
    """The fenced blocks of a page."""
    for match in _BLOCK.finditer(page):
        yield Block(
            match["kind"], match["text"], match["note"] or "", page.count("\n", 0, match.start("kind")) + 1
        )


def cut_campaign(log: Path) -> None:
    """Keep twelve records of the shipped campaign of a leaking valve in this file."""
    heading, *lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if line.split(",")[1] in TWELVE_RECORDS]
    log.write_text("".join([heading, *kept]), encoding="utf-8", newline="\n")


def steps(block: Block) -> list[Step]:
    """The commands of a ``console`` block."""
    found: list[Step] = []
    for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        command, _, shown = part.partition("\n")
        command = re.sub(r"\s+#\s.*$", "", command).strip()
        if command == "echo $?":
            found[-1] = Step(found[-1].command, found[-1].shown, int(shown))
        else:
            found.append(Step(command, shown, 0))
    return found


class PageRun:
    """One page on its way through, in a folder of its own.

    Parameters
    ----------
    home: the folder that stands for `HOME`; commands begin in it, or in `start` below it.
    """

    def __init__(self, home: Path, start: str = ".") -> None:
        self._home = home.resolve()
        self._here = self._home / start
        self._names: dict[str, Any] = {}
        self._served: dict[str, str] = {}  # the addresses of the page, and where they really are

    def carry_out(self, block: Block) -> None:
        """Execute the block, and compare its output with what the page shows."""
        if block.note.startswith("not run:"):
            return
        if block.note.startswith("file:"):
            path = self._here / block.note.removeprefix("file:").strip()
            path.parent.mkdir(parents=True, exist_ok=True)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8", newline="\n")
        elif block.note.startswith("server:"):
            self._with_server(block)
        elif block.note.startswith("killed in record"):
            self._kill(shlex.split(steps(block)[0].command), int(block.note.split()[-1]))
        elif block.kind == "console":
            for step in steps(block):
                self._step(step, block)
        elif block.kind == "pycon":
            self._python(block)

    def _with_server(self, block: Block) -> None:
        from patience import unhurried
        from protocol_servers import SERVERS
        from rigctl.rig import load_rig
        from several_devices import patient_devices, served_devices

        path = self._here / block.note.removeprefix("server:").strip()
        rig = load_rig(path)
        with ExitStack() as stack:
            if rig.devices:  # three servers in this process are slow together
                stack.enter_context(unhurried())
                path.write_text(patient_devices(rig.text), encoding="utf-8", newline="\n")
                stack.callback(path.write_text, rig.text, encoding="utf-8", newline="\n")
                served = stack.enter_context(served_devices(rig))
                circuit, ports = served.circuit, served.addresses
                self._served = {str(rig.devices[name].port): port for name, port in ports.items()}
            else:
                server = stack.enter_context(SERVERS[rig.backend.kind](rig))
                circuit, self._served = server.circuit, {str(rig.backend.port): server.port}
            for step in steps(block):
                self._step(step, block)
            assert circuit.off, f"line {block.line}: an output is still on"
        self._served = {}

    def _step(self, step: Step, block: Block) -> None:
        printed, told, code = "", "", 0
        both = step.command.endswith("2>&1")
        for shown in step.command.removesuffix("2>&1").split(" && "):
            command = shown
            for written, real in self._served.items():
                command = command.replace(written, real)
            program, *arguments = shlex.split(command)
            if program == "cd":
                self._here = (self._here / arguments[0]).resolve()
                assert self._here.is_relative_to(self._home), step.command
                continue
            assert program == "rigctl", f"a page shows only rigctl: {step.command}"
            printed, told, code = self._rigctl(arguments)
            if arguments[0] == "init" and block.note.endswith("of twelve records"):
                cut_campaign(next(self._home.rglob("data/unknown-bench.csv")))
        where = f"line {block.line}: {step.command}"
        assert code == step.code, f"{where}\nended with {code}, not {step.code}\n{printed}{told}"
        if step.shown.strip():
            vary = block.note.startswith("figures vary")
            wanted = _plain(step.shown, vary=vary)
            got = _plain(self._at_home(printed + told if both else printed), vary=vary)
            same = doctest.OutputChecker().check_output(wanted, got, doctest.ELLIPSIS)
            assert same, f"{where}\n--- the page says\n{wanted}\n--- it printed\n{got}"

    def _rigctl(self, arguments: list[str]) -> tuple[str, str, int]:
        """The stdout, stderr and exit code of a command."""
        from rigctl.cli.main import main

        printed, told, before = io.StringIO(), io.StringIO(), sys.argv
        sys.argv = ["rigctl", *arguments]
        try:
            with chdir(self._here), redirect_stdout(printed), redirect_stderr(told):
                main()
        except SystemExit as end:
            return printed.getvalue(), told.getvalue(), int(end.code or 0)
        finally:
            sys.argv = before
        return printed.getvalue(), told.getvalue(), 0

    def _python(self, block: Block) -> None:
        test = doctest.DocTestParser().get_doctest(block.text, self._names, f"line {block.line}", None, 0)
        flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
        told = io.StringIO()
        with chdir(self._here):
            failed = (
                doctest.DocTestRunner(optionflags=flags).run(test, out=told.write, clear_globs=False).failed
            )
        self._names = test.globs
        assert not failed, told.getvalue()

    def _kill(self, command: list[str], record: int) -> None:
        """Begin a command, and kill it when it has opened that record."""
        program = [sys.executable, "-m", "rigctl", *command[1:]]
        quiet = subprocess.DEVNULL
        with subprocess.Popen(program, cwd=self._here, stdout=quiet, stderr=quiet) as process:
            try:
                give_up = time.monotonic() + 600.0
                while _open_record(self._here) != record:
                    assert process.poll() is None, "the run ended before it could be killed"
                    assert time.monotonic() < give_up, "the record was never opened"
                    time.sleep(0.05)
            finally:
                process.kill()

    def _at_home(self, printed: str) -> str:
        printed = printed.replace("\\", "/").replace(self._home.as_posix(), HOME)
        for written, real in self._served.items():
            printed = printed.replace(real, written)
        return printed


def _open_record(project: Path) -> int:
    """The record that the newest run has open; −1 for none."""
    states = sorted(project.glob("runs/*/state.json"))
    try:
        state = json.loads(states[-1].read_text(encoding="utf-8")) if states else {}
    except (OSError, ValueError):  # it is just being replaced
        return -1
    running = state.get("state") == "running"
    return int(state.get("record", -1)) if running else -1


def _plain(text: str, *, vary: bool) -> str:
    """The text without parts that depend on the day or the terminal."""
    text = _RUN_ID.sub("RUN", text)
    if vary:
        text = re.sub(r"(compiled for) (linux|win|darwin)\d+", r"\1 this computer", text)
        text = re.sub(r"\d+(?:[.:]\d+)*", "0", text)
        text = re.sub(r"\b0 (\w+)s\b", r"0 \1", text)  # one spike, or three spikes
        # in which channels it finds more depends on how many records there are
        text = re.sub(r"^(  free model) .*$", r"\1", text, flags=re.MULTILINE)
    return "\n".join(re.sub(r"  +", "  ", line).rstrip() for line in text.strip().splitlines()) + "\n"

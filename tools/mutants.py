"""Plant faults one at a time in the rooms of `tools/mutants.toml`, and print those that no test finds.

python tools/mutants.py                      every room
python tools/mutants.py units journal        these rooms
python tools/mutants.py --sample 0           every fault, not a sample of 150 for each room
python tools/mutants.py --since main         only in lines that differ from a commit
python tools/mutants.py --only _scan         only in functions or files with this in their name

A fault is a small change of the syntax tree: ``<`` for ``<=``, a condition dropped, a call left out, a number
changed. The tests of a room are collected once, in this process. A forked copy of it runs them all and notes
which lines each one reaches; then there is one more copy for each fault, which replaces the code of the
functions that hold it and runs the tests that reach it, the cheapest first, until one fails. A fault costs
milliseconds instead of an import of everything.

The score of a room is the share of its faults that a test finds, without those that `mutants.toml` lists as
equivalent, each with the reason why no test can find it.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from planted_faults import ROOT, SOURCE, Fault, Planter

GOAL = 0.95
#: s of processor time; a test that takes longer is left out, since survivors run every test that reaches them
SLOW = 4.0
#: what a room's process exits with; `NOTHING` if it had no fault to find
PASSED, MISSED, NOTHING = 0, 1, 2


@dataclass(frozen=True)
class Reach:
    """What one test reaches: lines of each file, and s of processor time."""

    item: Any
    seconds: float
    lines: dict[str, frozenset[int]]

    def reaches(self, fault: Fault) -> bool:
        """Whether it runs the statement; a constant may be used anywhere, by modules that import it."""
        lines = self.lines.get(fault.file, frozenset())
        first, last = fault.lines
        return not fault.inside or not lines.isdisjoint(range(first, last + 1))


class Rounds:
    """A plugin of pytest that runs its tests once for each fault."""

    def __init__(self, room: str, entry: Any, known: dict[Any, str], options: Any, out: int) -> None:
        self._room, self._entry, self._known, self._options, self._out = room, entry, known, options, out
        self._files: list[str] = entry["files"]
        self.outcome = MISSED

    def pytest_configure(self) -> None:
        """Examples that fail are not reduced to smaller ones."""
        from hypothesis import HealthCheck, Phase, settings

        settings.register_profile(
            "mutants",
            derandomize=True,
            deadline=None,
            database=None,
            phases=(Phase.explicit, Phase.generate),
            suppress_health_check=list(HealthCheck),
        )
        settings.load_profile("mutants")

    def pytest_runtestloop(self, session: Any) -> bool:
        """Instead of pytest's own: note what the tests reach, then plant each fault."""
        if session.testsfailed:  # a file that fails to import is one; each fault would seem to be found
            self._say(f"{self._room}: tests could not be collected\n")
            return True
        session.config.pluginmanager.unregister(name="terminalreporter")
        for name in self._entry.get("imports", ()):
            importlib.import_module(name)
        planter = Planter(self._files)
        chosen = self._choose(planter.faults())
        reached = self._look(session.items, planter) if chosen else []
        counts: Counter[str] = Counter()
        for fault in chosen:
            tests = [one for one in reached if one.reaches(fault)]
            outcome = self._try(planter, fault, tests) if tests else "survived"
            if outcome == "survived" and fault.key in self._known:
                outcome = "equivalent"
            counts[outcome] += 1
            if outcome in ("survived", "not planted"):
                remark = outcome if tests else "no test reaches it"
                self._say(
                    f"src/rigctl/{fault.file}:{fault.lines[0]}  {fault.where}: {fault.change}  ({remark})"
                )
        counted = counts["found"] + counts["out of time"] + counts["survived"]
        rest = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
        if not counted:
            self.outcome = NOTHING
            self._say(f"{self._room}: no faults{rest and f' ({rest})'}\n")
            return True
        score = 1.0 - counts["survived"] / counted
        self.outcome = PASSED if score >= GOAL else MISSED
        self._say(f"{self._room}: {score:.1%} of {counted} faults found by {len(reached)} tests ({rest})\n")
        return True

    def _choose(self, every: Sequence[Fault]) -> list[Fault]:
        if self._options.since:
            lines = {file: changed_lines(file, self._options.since) for file in self._files}
            every = [one for one in every if lines[one.file] & set(range(one.lines[0], one.lines[1] + 1))]
        every = [one for one in every if self._options.only in f"{one.file} {one.where}"]
        if not 0 < self._options.sample < len(every):
            return list(every)
        generator = random.Random(self._options.seed)
        picked = sorted(generator.sample(range(len(every)), self._options.sample))
        return [every[index] for index in picked]

    def _look(self, items: Sequence[Any], planter: Planter) -> list[Reach]:
        """Run every test once, in a copy; those that fail without any fault are named and left out."""
        with tempfile.TemporaryFile("w+", encoding="utf-8") as file:
            pid = os.fork()
            if pid == 0:
                _quiet()
                _note(items, planter, file)
            os.waitpid(pid, 0)
            file.seek(0)
            noted = [json.loads(line) for line in file]
        reached = []
        for item, one in zip(items, noted, strict=False):
            if one["failed"]:
                self._say(f"{item.nodeid}: fails without any fault, and is left out")
            elif one["seconds"] < SLOW:
                lines = {name: frozenset(numbers) for name, numbers in one["lines"].items()}
                reached.append(Reach(item, one["seconds"], lines))
        if len(noted) < len(items):
            self._say(f"{self._room}: only {len(noted)} of {len(items)} tests ran")
        return sorted(reached, key=lambda one: one.seconds)

    def _try(self, planter: Planter, fault: Fault, tests: Sequence[Reach]) -> str:
        """Plant a fault in a copy of this process and run the tests until one fails."""
        seconds = sum(one.seconds for one in tests)
        pid = os.fork()
        if pid == 0:
            _quiet()
            resource.setrlimit(resource.RLIMIT_CPU, (int(5 + 3 * seconds), resource.RLIM_INFINITY))
            try:
                planted = planter.plant(fault)
            except BaseException:  # noqa: BLE001 - a module that cannot be imported any more is noticed
                os._exit(1)
            if not planted:
                os._exit(2)
            _run([one.item for one in tests])
        end = time.monotonic() + 60.0 + 20.0 * seconds  # waits for a line or a process, on a busy computer
        done, status = os.waitpid(pid, os.WNOHANG)
        while not done and time.monotonic() < end:
            time.sleep(0.005)
            done, status = os.waitpid(pid, os.WNOHANG)
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)  # with the processes that its tests have left
        if not done:
            os.waitpid(pid, 0)
            return "out of time"
        if os.WIFSIGNALED(status):
            return "out of time" if os.WTERMSIG(status) == signal.SIGXCPU else "found"
        return {0: "survived", 2: "not planted"}.get(os.WEXITSTATUS(status), "found")

    def _say(self, text: str) -> None:
        os.write(self._out, f"{text}\n".encode())


def _quiet() -> None:
    """A group of its own, and no output."""
    os.setpgrp()
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)


def _run(items: Sequence[Any]) -> NoReturn:
    """Run tests until one fails, and end this process."""
    session = items[0].session
    try:
        for item, after in zip(items, [*items[1:], None], strict=True):
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
            if session.testsfailed:
                os._exit(1)
    except BaseException:  # noqa: BLE001 - whatever it is, the fault was noticed
        os._exit(1)
    os._exit(0)


def _note(items: Sequence[Any], planter: Planter, out: Any) -> NoReturn:
    """Run each test and write the lines that it reaches; those of a fixture count for its whole file."""
    lines: dict[str, set[int]] = {}

    def reached(file: str, first: int, last: int) -> None:
        lines.setdefault(file, set()).update(range(first, last + 1))

    planter.probe(reached)

    class Setup:
        """Lines that the fixtures of each file have reached."""

        def __init__(self) -> None:
            self.of: dict[Path, dict[str, set[int]]] = {}

        def pytest_runtest_call(self, item: Any) -> None:
            for name, numbers in lines.items():
                self.of.setdefault(item.path, {}).setdefault(name, set()).update(numbers)

    setup = Setup()
    items[0].config.pluginmanager.register(setup)
    failed = 0
    for item, after in zip(items, [*items[1:], None], strict=True):
        lines.clear()
        planter.forget()
        began = sum(os.times()[:4])
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
        for name, numbers in setup.of.get(item.path, {}).items():
            lines.setdefault(name, set()).update(numbers)
        noted = {
            "failed": item.session.testsfailed > failed,
            "seconds": sum(os.times()[:4]) - began,
            "lines": {name: sorted(numbers) for name, numbers in lines.items()},
        }
        failed = item.session.testsfailed
        out.write(json.dumps(noted) + "\n")
        out.flush()
    os._exit(0)


def changed_lines(file: str, commit: str) -> set[int]:
    """The lines of a file that differ from a commit."""
    command = ["git", "diff", "--unified=0", commit, "--", str(SOURCE / file)]
    text = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    spans = re.findall(r"^@@ .*\+(\d+)(?:,(\d+))? @@", text, re.MULTILINE)
    return {line for first, count in spans for line in range(int(first), int(first) + int(count or 1))}


def run_room(room: str, entry: dict[str, Any], known: dict[Any, str], options: Any) -> int:
    """Test one room; return `PASSED` if its score reaches the goal, else `MISSED` or `NOTHING`."""
    import pytest

    out = os.dup(1)
    rounds = Rounds(room, entry, known, options, out)
    with tempfile.TemporaryDirectory() as folder:
        quiet = ["-q", "--no-header", "--no-summary", "-p", "no:cacheprovider", "-p", "no:xdist"]
        pytest.main([*quiet, f"--basetemp={folder}/tests", *entry["tests"]], plugins=[rounds])
    return rounds.outcome


def main(arguments: Sequence[str] | None = None) -> int:
    """Test the rooms, each in a process of its own."""
    rooms = tomllib.loads((Path(__file__).with_suffix(".toml")).read_text(encoding="utf-8"))
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", nargs="*", choices=[*rooms["rooms"], []], metavar="ROOM")
    parser.add_argument("--sample", type=int, default=150, help="faults for each room; 0 is all of them")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--since", metavar="COMMIT", help="only in lines that differ from it")
    parser.add_argument("--only", default="", metavar="TEXT", help="of a file's or a function's name")
    options = parser.parse_args(arguments)
    if not hasattr(os, "fork"):
        parser.error("needs fork, which this system does not have")
    os.chdir(ROOT)
    known = {(one["file"], one["where"], one["change"]): one["reason"] for one in rooms.get("equivalent", [])}
    outcomes = set()
    for room in options.rooms or rooms["rooms"]:
        pid = os.fork()
        if pid == 0:
            os._exit(run_room(room, rooms["rooms"][room], known, options))
        outcomes.add(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
    # a room without a changed line is passed over, but a name that no room knows has tested nothing
    return 0 if PASSED in outcomes and outcomes <= {PASSED, NOTHING} else 1


if __name__ == "__main__":
    sys.exit(main())

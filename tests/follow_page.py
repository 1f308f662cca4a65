"""Follow a page of the documentation literally: save the files it shows, type its commands, compare.

A page says "Save this as `NAME`." before a block. In a ``console`` block a line that begins with ``$ `` is
typed; the lines below it are what the answer must contain, spaces aside, and whatever stands for a ``…``.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli.main import app

_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_SAVE = re.compile(r"Save this as `([^`]+)`")


@dataclass(frozen=True)
class File:
    """A file that the page shows."""

    name: str
    text: str


@dataclass
class Command:
    """A line that the page tells one to type, and what it says comes of it."""

    typed: str
    answer: list[str] = field(default_factory=list)


def steps_of(page: str) -> Iterator[File | Command]:
    """What the page tells one to do, in its order."""
    end = 0
    for block in _BLOCK.finditer(page):
        saved = _SAVE.findall(page[end : block.start()])
        end = block.end()
        if saved:
            yield File(saved[-1], block.group(2))
        elif block.group(1) == "console":
            yield from _commands(block.group(2))


def _commands(block: str) -> Iterator[Command]:
    command: Command | None = None
    for line in block.splitlines():
        if line.startswith("$ "):
            if command is not None:
                yield command
            command = Command(line.removeprefix("$ "))
        elif command is not None and line.strip():
            command.answer.append(line)
    if command is not None:
        yield command


def follow(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Do what the page says, beginning in the current folder; every command must succeed."""
    for step in steps_of(page.read_text(encoding="utf-8")):
        if isinstance(step, File):
            Path(step.name).parent.mkdir(parents=True, exist_ok=True)
            Path(step.name).write_text(step.text, encoding="utf-8", newline="\n")
            continue
        program, *arguments = shlex.split(step.typed)
        if program == "cd":
            monkeypatch.chdir(arguments[0])
            continue
        assert program == "rigctl", step.typed
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, f"{step.typed}: {result.output} {result.exception}"
        told = " ".join(result.output.split())
        for line in step.answer:
            pieces = [re.escape(" ".join(piece.split())) for piece in line.split("…")]
            assert re.search(r"\s?\S*\s?".join(pieces), told), f"{step.typed}: {result.output}"

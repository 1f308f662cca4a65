"""Commands as a user types them, in this process: what they print, answer and refuse."""

from __future__ import annotations

import json
import re
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from json_page import undocumented
from rigctl.cli.commands.init import create_project
from rigctl.cli.main import app
from rigctl.errors import ExitCode, RigctlError

MODEL = "models/hl32-textbook.yaml"


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def told(*arguments: str) -> str:
    """Return the output of a successful command; errors are raised."""
    done = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def answer(*arguments: str) -> dict[str, Any]:
    """Return the JSON answer of a command, and check that all its names are documented."""
    document: dict[str, Any] = json.loads(told(*arguments, "--json"))
    assert undocumented(arguments, document) == set()
    return document


def refusal(*arguments: str, exit_code: ExitCode = ExitCode.USAGE) -> str:
    """Return the message of a refused command."""
    with pytest.raises(RigctlError) as caught:
        CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert caught.value.exit_code == exit_code
    return str(caught.value)


def create_strokes(folder: Path, temperatures: str, seed: int) -> Path:
    """A project with a small campaign on the simulated bench: four strokes at each of the temperatures."""
    create_project(folder)
    with chdir(folder):
        arguments = ["procedures/campaign.yaml", "-a", f"temperatures={temperatures}", "--seed", str(seed)]
        told("simulate", *arguments)
    return folder


def textbook_copy(name: str, *changes: tuple[str, str]) -> str:
    """The textbook model as ``models/<name>.yaml``, with parts of its text changed and its own versions."""
    text = Path(MODEL).read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = Path("models", f"{name}.yaml")
    path.write_text(text, encoding="utf-8", newline="\n")
    return path.as_posix()


def with_exact_sensors(rig: Path) -> None:
    """State a fiftieth of each uncertainty in a rig file: no error of a sensor is an answer then."""
    text = rig.read_text("utf-8")
    rig.write_text(
        re.sub(r"(?<=uncertainty: )[\d.]+", lambda one: f"{float(one[0]) / 50.0:g}", text), "utf-8"
    )

"""Every command that an answer proposes can be run as it is printed, and so on to the end."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from commands import call
from swing import project, slow, white

#: the first command follows "Next:", further ones stand below it
_NEXT = re.compile(r"^(?:Next:| {5}) (rigctl .+)$", re.MULTILINE)
#: commands in one walk; each answer proposes at most one or two
_MOST = 12


def walk(*starts: str) -> list[str]:
    """Carry out commands and all that they propose; the commands, in order."""
    waiting, done = list(starts), list[str]()
    while waiting and len(done) < _MOST:
        command = waiting.pop(0)
        if command in done:
            continue
        done.append(command)
        ended = call(*_words(command))
        assert ended.exit_code == 0, f"{command}\n{ended.output}\n{ended.exception}"
        waiting += _NEXT.findall(ended.output)
    assert not waiting, f"it goes on: {waiting}"
    return done


def _words(command: str) -> list[str]:
    program, *words = re.findall(r"""(?:[^\s"']|"[^"]*"|'[^']*')+""", command)
    assert program == "rigctl", command
    return [re.sub(r"""["']""", "", word) for word in words]


@pytest.mark.parametrize(
    ("noise", "cubic", "stated", "ends"),
    [
        (white, 0.6, "", "rigctl diagnose"),  # an effect is named, and added
        (white, 0.0, "", "rigctl report"),  # nothing is missing
        (slow, 0.0, "", "rigctl report"),  # these data cannot tell
        (slow, 0.0, "200 m", "rigctl compare"),  # the noise in the rig file has a wrong unit: that is all
    ],
)
def test_what_answers_propose_can_be_run(
    noise: Callable[[np.random.Generator], np.ndarray],
    cubic: float,
    stated: str,
    ends: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    project(tmp_path, noise, cubic, stated)
    monkeypatch.chdir(tmp_path)
    done = walk("rigctl import log.csv --rig rigs/swing.yaml")
    assert any(command.startswith("rigctl compare") for command in done)
    assert any(command.startswith(ends) for command in done)
    if cubic:
        assert any("--apply" in command for command in done)


def test_what_the_answers_of_a_drafted_family_propose_can_be_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a stranger's log without a project to the end of what is proposed."""
    project(tmp_path, white, cubic=0.6)
    (tmp_path / "bench").mkdir()
    (tmp_path / "log.csv").rename(tmp_path / "bench" / "log.csv")
    monkeypatch.chdir(tmp_path / "bench")
    done = walk("rigctl family new swung --csv log.csv --commanded force")
    assert any(command.startswith("rigctl compare") for command in done)
    assert any(command.startswith("rigctl diagnose") for command in done)


def test_what_the_answers_on_records_that_differ_too_little_propose_can_be_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A verdict between several effects proposes records that would tell them apart, and their procedure."""
    told = call("init", str(tmp_path / "mine"))
    assert told.exit_code == 0, told.output
    monkeypatch.chdir(tmp_path / "mine")
    walk(
        "rigctl simulate procedures/heater-board-steps.yaml --seed 3",
        "rigctl compare latest --model models/heater-board.yaml",
    )

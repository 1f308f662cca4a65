"""The shell completes values, as it asks for them: by the environment of its completion script."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rigctl.cli.commands.init import create_project
from rigctl.dataset.importing import import_file

#: what an installation writes as the file `rigctl`
SCRIPT = "import sys; sys.argv[0] = 'rigctl'; from rigctl.cli.entry import main; main()"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    create_project(folder)
    import_file(folder / "data" / "hl32-viscosity.csv", None, folder / "runs")
    return folder


#: where the distribution of a command is not installed
NO_VALIDATION = """
from rigctl.cli.catalogue import BY_NAME
BY_NAME["validate"] = BY_NAME["validate"]._replace(package="rigctl_elsewhere")
"""


def offered(folder: Path, line: str, before: str = "") -> set[str]:
    """What bash is offered at the end of a line."""
    words = line.split(" ")
    asked = {"_RIGCTL_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", before + SCRIPT],
        cwd=folder, env={**os.environ, **asked}, capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert (done.stderr, done.returncode) == ("", 0)
    return {one.partition(",")[-1] or one for one in done.stdout.split("\n") if one}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rigctl report la", {"latest"}),
        ("rigctl check --rig rigs/hl32-bench-u", {"rigs/hl32-bench-uno.yaml"}),
        ("rigctl compare latest --model models/hl32-t", {"models/hl32-textbook.yaml"}),
        ("rigctl simulate procedures/camp", {"procedures/campaign.yaml"}),
        ("rigctl calibrate --rig rigs/hl32-bench.yaml oil", {"oil_temperature"}),
        ("rigctl jog --rig rigs/hl32-bench.yaml val", {"valve"}),
        ("rigctl model set models/hl32-textbook.yaml moving", {"moving_mass="}),
        ("rigctl effects show piston", {"piston_leakage", "piston_leakage:conductance="}),
        ("rigctl compare nothing --model no/such", set()),
        ("rigctl no-command la", set()),
    ],
)
def test_values_are_completed(bench: Path, line: str, expected: set[str]) -> None:
    assert offered(bench, line) == expected


def test_an_error_is_not_printed_at_the_prompt(bench: Path) -> None:
    assert "--tier" in offered(bench, "rigctl validate --t")
    assert offered(bench, "rigctl validate --t", NO_VALIDATION) == set()


def test_powershell_is_offered_the_same_where_rigctl_runs_as_a_module(bench: Path) -> None:
    """As `py -m rigctl`, for which the variables had a name with spaces."""
    asked = {
        "_RIGCTL_COMPLETE": "complete_powershell",
        "_TYPER_COMPLETE_ARGS": "rigctl report la",
        "_TYPER_COMPLETE_WORD_TO_COMPLETE": "la",
    }
    done = subprocess.run(
        [sys.executable, "-P", "-m", "rigctl"],
        cwd=bench, env={**os.environ, **asked}, capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.stdout.startswith("latest")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["effects", "show", "piston_leakage", ":", "cond"], {"conductance="}),
        (["effects", "show", "piston_leakage", ":"], {"conductance="}),
        (
            ["simulate", "procedures/campaign.yaml", "--with", "=", "piston_leakage", ":", "cond"],
            {"conductance="},
        ),
        (["report", "la"], {"latest"}),
    ],
)
@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is asked")
def test_bash_completes_words_that_it_splits(
    bench: Path, tmp_path: Path, words: list[str], expected: set[str]
) -> None:
    """Bash splits words at ':' and '=', and replaces only what follows the last of them."""
    ask = [sys.executable, "-P", "-c", SCRIPT]
    script = subprocess.run(
        ask,
        env={**os.environ, "_RIGCTL_COMPLETE": "source_bash"},
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    assert "complete -o default -F" in script
    program = tmp_path / "rigctl"
    program.write_text(f'#!/bin/sh\nexec {shlex.join(ask)} "$@"\n', "utf-8")
    program.chmod(0o755)
    line = f"COMP_WORDS=({shlex.join(['rigctl', *words])}); COMP_CWORD={len(words)}"
    call = f'{script}\n{line}\n_rigctl_completion {program}\nprintf "%s\\n" "${{COMPREPLY[@]}}"'
    done = subprocess.run(["bash", "-c", call], cwd=bench, capture_output=True, text=True, check=False)
    assert {one for one in done.stdout.split("\n") if one} == expected, done.stderr


def test_runs_are_completed(bench: Path) -> None:
    (run,) = (bench / "runs").glob("*-hl32-viscosity")
    assert offered(bench, f"rigctl compare {run.name[:15]}") == {run.name}

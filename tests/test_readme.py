"""README's lines, typed as they stand into the shell that a reader has."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from doc_page import Block, blocks
from logger_headings import LOGS

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="README's lines are those of bash")

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "README.md").read_text(encoding="utf-8")
CONSOLE = [block for block in blocks(PAGE) if block.kind == "console"]
#: commands of minutes, which other tests carry out: here their options and their files are checked
LONG = ("diagnose", "design", "learn", "discover", "compensate", "survey")

AT_THE_END = "all lines were typed"

#: what stands in for them: options and values are read as by the command, and every file that is named exists
ACCEPTED = """
import sys
from pathlib import Path
import click, typer
from rigctl.cli.main import app

words = sys.argv[1:]
command, context = typer.main.get_command(app), None
while True:
    context = command.make_context(words[0] if words else "rigctl", list(words), parent=context)
    if not isinstance(command, click.Group):
        break
    _, command, words = command.resolve_command(context, [*context._protected_args, *context.args])
    words = words if words else []
new = set(sys.argv[i + 1] for i, word in enumerate(sys.argv[:-1]) if word in ("-o", "--output"))
for word in sys.argv[1:]:
    if word not in new and word.endswith((".yaml", ".csv")) and not Path(word).is_file():
        sys.exit(f"{word}: there is no such file")
"""


def typed(block: Block) -> str:
    """The lines of a block without their prompt: comments remain, as in a line that was copied."""
    return "\n".join(line.removeprefix("$ ") for line in block.text.splitlines() if line.startswith("$ "))


def block_with(text: str) -> str:
    (found,) = (typed(block) for block in CONSOLE if text in block.text)
    return found


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shared_results: Path) -> Path:
    """An empty folder, with `rigctl` on the path."""
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "accepted.py").write_text(ACCEPTED, encoding="utf-8")
    python = sys.executable
    (programs / "rigctl").write_text(
        f'#!/bin/sh\ncase "$1" in\n{"|".join(LONG)}) exec "{python}" "{programs}/accepted.py" "$@";;\n'
        f'*) exec "{python}" -m rigctl "$@";;\nesac\n',
        encoding="utf-8",
    )
    (programs / "rigctl").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:/usr/bin:/bin")
    home = tmp_path / "home"
    home.mkdir()
    return home


def run(lines: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Type the lines; the first that fails ends it.

    They are no command's input: one that reads its input would swallow those after it.
    """
    done = subprocess.run(
        ["bash", "-e", "-c", f"{lines}\necho {AT_THE_END}"],
        stdin=subprocess.DEVNULL,
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    assert done.stdout.endswith(f"{AT_THE_END}\n")
    assert "Traceback" not in done.stderr
    return done


def test_the_first_steps_of_readme_are_typed_as_they_stand(shell: Path) -> None:
    done = run(
        block_with("rigctl init my-bench") + "\n" + block_with("rigctl design latest"),
        shell,
    )
    assert "wrong direction" in done.stdout.casefold()  # as the comment on that line says
    assert "did you mean" not in done.stderr


def test_the_lines_of_readme_for_a_log_are_typed_as_they_stand(shell: Path) -> None:
    (shell / "log.csv").write_text(LOGS["numpy savetxt"].text, encoding="utf-8")
    run(block_with("rigctl init lab"), shell)
    assert (shell / "lab" / "models" / "motor.yaml").is_file()


def test_the_procedure_of_readme_is_valid(shell: Path) -> None:
    run("rigctl init my-bench && cd my-bench", shell)
    (text,) = (block.text for block in blocks(PAGE) if block.kind == "yaml")
    (shell / "my-bench" / "procedures" / "readme.yaml").write_text(text, encoding="utf-8")
    run("cd my-bench && rigctl check procedures/readme.yaml", shell)


def test_every_other_command_that_readme_names_exists() -> None:
    """`rigctl NAME` and `make NAME` in the text, the extras of `pip`, and modules of figures."""
    from rigctl.cli.catalogue import ENTRIES

    names = {entry.name for entry in ENTRIES}
    named = set(re.findall(r"`rigctl ([a-z]+)", PAGE)) | set(
        re.findall(r"^\$ rigctl ([a-z]+)", PAGE, re.MULTILINE)
    )
    assert named <= names
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"(?:`|\$ )make ([a-z]+)", PAGE)) <= targets
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert all(
        re.search(rf"^{extra} = \[", project, re.MULTILINE) for extra in re.findall(r"\.\[(\w+)\]", PAGE)
    )
    for module in set(re.findall(r"python -m (benchmarks\.\w+)", PAGE)):
        assert (ROOT / f"{module.replace('.', '/')}.py").is_file() or (
            ROOT / module.replace(".", "/")
        ).is_dir()

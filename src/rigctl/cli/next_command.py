"""The next command: the last line of an answer."""

from __future__ import annotations

from collections.abc import Sequence
from shlex import quote

from rich.console import Console
from rich.markup import escape

from rigctl.cli.tables import console
from rigctl.command_line import DataOptions, analysis, shell_word


def show_next(command: str, why: str, to: Console | None = None) -> None:
    """Show the command, or the commands in lines of their own, and below what they do."""
    (to or console()).print(
        f"\nNext: [bold]{escape(one_below_another(command))}[/]\n  {escape(why)}", soft_wrap=True
    )


def one_below_another(commands: str) -> str:
    """The lines behind ``Next:``; no sign between commands works in every shell."""
    return commands.replace("\n", "\n      ")


def enter_environment() -> tuple[str, ...]:
    """The line ``source .venv/bin/activate`` where the shell would not find this rigctl, else none.

    It is a line of its own, as Windows PowerShell has no ``&&``.
    """
    import os
    import shutil
    import sys
    from pathlib import Path

    scripts = Path(sys.prefix) / ("Scripts" if os.name == "nt" else "bin")
    found = shutil.which("rigctl")
    if sys.prefix == sys.base_prefix or (found and Path(found).parent.absolute() == scripts.absolute()):
        return ()
    script = scripts / "activate"
    if Path.cwd() in script.parents:
        script = script.relative_to(Path.cwd())
    if os.name == "nt":  # cmd takes what follows a forward slash for an option of the command
        return (shell_word(str(script), windows=False),)
    return (f"source {quote(str(script))}",)


def page_of(verb: str, runs: Sequence[str], model: str, choice: DataOptions | None = None, *own: str) -> str:
    """The command that makes the page of `verb` for the selected records, with its `own` options.

    `report`, which is shorter, uses all records and has none of these options.
    """
    if own or (choice is not None and (choice.only or choice.hold_out)):
        return f"{analysis(verb, runs, model, choice, *own)} -o page.html"
    return analysis("report", runs, model, choice) + " --diagnose" * (verb == "diagnose")

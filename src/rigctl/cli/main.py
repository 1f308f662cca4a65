"""The entry point: commands are loaded when they are called, and errors end in one clear message.

In: the command line. Out: an exit code; with it one message on stderr, or a document with `--json`.
Whatever a command raises ends in `_carry_out`, the only place in which errors become messages; a
traceback is a fault of rigctl. Commands that operate a bench get output that does not block.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from importlib import import_module
from importlib.util import find_spec
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from rigctl.cli.catalogue import BY_NAME, ENTRIES
from rigctl.cli.closed_output import has_broken_pipe, is_unread
from rigctl.cli.complete import complete_values
from rigctl.cli.echo import echo
from rigctl.cli.nonblocking_output import ON_A_BENCH, carry_out
from rigctl.cli.overview import overview
from rigctl.cli.usage_errors import name_parameters, one_style
from rigctl.errors import ExitCode, Location, RigctlError, unknown_name


class LazyGroup(TyperGroup):
    """A group of commands that imports a command only to carry it out, or to print its own help."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Parse the options before the command."""
        with one_style():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Parse the command's own options, and carry it out."""
        with one_style():
            return super().invoke(ctx)

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of the table, which is the order of a user's work."""
        return [entry.name for entry in ENTRIES]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A placeholder with the name and summary that the overview shows."""
        entry = BY_NAME.get(cmd_name)
        if entry is None:
            return None
        return TyperCommand(entry.name, help=entry.summary, rich_help_panel=entry.panel)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """The overview, as `rigctl.cli.entry` shows it too."""
        formatter.write(overview())

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Load the command that is called."""
        name = args[0]
        if name not in BY_NAME:
            raise unknown_name("command", name, BY_NAME)
        return name, load_command(name), args[1:]


def load_command(name: str) -> Any:
    """Import a command's module and make the command from its function or sub-application.

    Raises
    ------
    RigctlError
        the command belongs to a distribution that is not installed.
    """
    entry = BY_NAME[name]
    module_name, attribute = entry.target.split(":")
    if find_spec(entry.package) is None:
        distribution = entry.package.replace("_", "-")
        raise RigctlError(
            f"'rigctl {name}' is in a package of its own, which is not installed",
            value=distribution,
            hint=f"In a clone of rigctl: pip install . ./{distribution}; "
            f"with pipx: pipx inject rigctl ./{distribution}",
        )
    target = getattr(import_module(f"{entry.package}.{module_name}"), attribute)
    if not isinstance(target, typer.Typer):
        function, target = target, typer.Typer(add_completion=False)
        target.command(name, no_args_is_help=False)(function)
    target.pretty_exceptions_enable = False
    target.rich_markup_mode = "markdown"  # no markup: brackets, as in 'time [s]', are literal
    command = typer.main.get_command(target)
    command.name = name
    for one in getattr(command, "commands", {}).values() or [command]:
        complete_values(one)
        one.callback = _with_local_paths(one.callback)
        name_parameters(one)
    return command


def _with_local_paths(carry_out_command: Callable[..., Any]) -> Callable[..., Any]:
    """Refuse an address of storage where a file is meant: as a path, ``s3://a`` is a folder ``s3:`` here."""

    @wraps(carry_out_command)
    def checked(**given: Any) -> Any:
        from rigctl.project import require_local

        for value in given.values():
            for path in value if isinstance(value, list | tuple) else (value,):
                if isinstance(path, Path):
                    require_local(path)
        return carry_out_command(**given)

    return checked


#: allocations between two garbage collections in a command that does not operate a bench
_SELDOM = 50_000

app = typer.Typer(
    name="rigctl",
    cls=LazyGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        echo(f"rigctl {version('rigctl')}")
        raise typer.Exit


@app.callback()
def rigctl(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Run a test bench, record its behaviour, and find out what its model lacks.

    First steps: 'rigctl init my-bench', then 'rigctl check' and 'rigctl simulate' one of its procedures,
    then 'rigctl report latest'. 'rigctl COMMAND --help' shows an example of each.
    """


def main() -> None:
    """Run the command line; a user's mistake gives one message on stderr, never a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # a terminal that has no '±' shows a '?' instead of a traceback
            stream.reconfigure(errors="replace")
    if sys.argv[1:2] and sys.argv[1] in ON_A_BENCH:
        carry_out(_carry_out)
    else:
        # in a few seconds a garbage collection over all libraries costs more than it frees;
        # on a bench, where a pause counts, often and shortly
        gc.set_threshold(_SELDOM)
        _carry_out()


def _carry_out() -> None:
    wanted = "--json" in sys.argv[1:]
    try:
        app(prog_name="rigctl")  # also as `py -m rigctl`, whose own name no shell could complete
    except RigctlError as error:
        if "_RIGCTL_COMPLETE" in os.environ:
            return  # a shell that asks for completions has no place to say it
        _refuse(error, as_json=wanted)
    except RecursionError:
        _refuse(RigctlError("the input is nested too deeply"), as_json=wanted)
    except MemoryError:
        _refuse(RigctlError("out of memory", exit_code=ExitCode.FAILED), as_json=wanted)
    except BrokenPipeError:
        raise  # see `rigctl.cli.entry`
    except OSError as problem:  # e.g. a disk that is full or missing
        name = Path(problem.filename) if isinstance(problem.filename, str) else None
        text = problem.strerror or str(problem)
        _refuse(RigctlError(text, where=Location(name), exit_code=ExitCode.FAILED), as_json=wanted)
    except SystemExit as end:
        # The library of the command line turns Ctrl-C into an exit; a command that has handled it itself has
        # said so already. At a question it has another code for it.
        at_question = end.code == ExitCode.FAILED and _has(end, typer.Abort)
        if (end.code == ExitCode.INTERRUPTED or at_question) and _has(end, KeyboardInterrupt):
            _refuse(RigctlError("Stopped", exit_code=ExitCode.INTERRUPTED), as_json=wanted)
        if end.code == ExitCode.FAILED and has_broken_pipe(end) and not is_unread():
            # the library of the command line ends silently, as if it were the output's
            text = "a connection was closed by its other end"
            _refuse(RigctlError(text, exit_code=ExitCode.FAILED), as_json=wanted)
        raise


def _has(end: BaseException, kind: type[BaseException]) -> bool:
    """True if such an error led to the end; False for a command that then reported and ended by itself."""
    error: BaseException | None = end
    while error is not None and not isinstance(error, kind):
        error = error.__cause__ or error.__context__
    return error is not None


def _refuse(error: RigctlError, *, as_json: bool) -> NoReturn:
    """Print one message on stderr, with ``--json`` a document on stdout, and exit with the error's code."""
    with suppress(BrokenPipeError):  # the exit code remains that of the error
        print(f"rigctl: {error}", file=sys.stderr)  # noqa: T201
    if as_json:
        _print_refusal(error)
    sys.exit(error.exit_code)


def _print_refusal(error: RigctlError) -> None:
    """The error as a JSON document."""
    import json

    document = {"error": error.as_dict(), "exit_code": int(error.exit_code)}
    print(json.dumps(document, ensure_ascii=False))  # noqa: T201

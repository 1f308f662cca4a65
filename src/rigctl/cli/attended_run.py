"""What `run`, `simulate` and `resume` share: operator, display, and the report of the end.

Who answers the questions of a procedure depends on how it was called: a person at the terminal, a person
at the page (`--answer-in-browser`), answers given beforehand, or nobody, on a bench that is not real. Where
questions would wait for an input that is empty, the run is refused before it begins.

The end is reported from the most to the least important: outputs that may be on, the result, the device's
test, remarks on the data. What could fail in a remark never hides what comes before it.
"""

from __future__ import annotations

import errno
import getpass
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, NoReturn

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.errors import RigctlError
from rigctl.wording import noun

if TYPE_CHECKING:
    from rigctl.dataset import Run
    from rigctl.dataset.pass_fail import Judgement
    from rigctl.plan import Plan
    from rigctl.runner.launch import Launch
    from rigctl.runner.session import RunResult

#: measures outside their limits that are listed at the end of a run
_MOST_SHOWN = 10
#: backends whose operator is simulated or recorded along with the bench
_UNATTENDED = ("simulated", "replay", "emulated")


@contextmanager
def attended(
    how: Launch, plan: Plan, answers: Mapping[str, str], *, remote: bool = False
) -> Iterator[Launch]:
    """The launch with its operator, the keys of the terminal, and a display on stderr.

    With `remote`, questions are answered on the web page.
    """
    if remote and not answers:
        with _remote(how, plan) as ready:
            yield ready
        return
    from rigctl.live import view
    from rigctl.runner.operators.automatic_operator import AutomaticOperator, refuse_questions, scripted
    from rigctl.runner.operators.console import Console
    from rigctl.runner.operators.keys import HELP, input_is_empty
    from rigctl.runner.operators.operator import Operator

    kind = how.backend or plan.rig.kind
    # A real bench asks a person, unless the answers were given; a simulated one has an operator of its own.
    by_hand = kind not in _UNATTENDED and not answers
    keys = typing_possible()
    if by_hand and not keys and not how.dry and input_is_empty():
        refuse_questions(plan)
    display = view(plan, hint=HELP if keys else "")
    how = replace(how, observer=display)
    if not by_hand and not keys:
        unattended = scripted(plan, answers) if answers else AutomaticOperator()
        with display:
            yield replace(how, operator=unattended)
        return
    # a display that redraws itself shows questions and what is typed
    with Console(how.person, None) if display.interactive else Console(how.person) as console, display:
        operator: Operator = console
        if not by_hand:
            operator = scripted(plan, answers) if answers else AutomaticOperator()
        yield replace(how, operator=operator, controls=(*how.controls, console))


@contextmanager
def _remote(how: Launch, plan: Plan) -> Iterator[Launch]:
    """The launch with an operator in a browser."""
    from rigctl.live import view
    from rigctl.runner.operators.control_thread import beside
    from rigctl.runner.operators.remote_operator import RemoteOperator

    operator = RemoteOperator(how.person, how.runs)
    with view(plan) as display:
        controls = (*how.controls, beside(operator.answers, how.clock))
        yield replace(how, observer=display, operator=operator, controls=controls)


def person_in_charge(given: str | None) -> str:
    """The person in charge: as given, or the user of this account."""
    if given:
        return given
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a user without a name, as in a container
        return ""


def report_end(result: RunResult, *, as_json: bool) -> NoReturn:
    """Report how a run ended, and end with its exit code, also if the terminal was closed."""
    try:
        _tell_end(result, as_json=as_json)
    except OSError as error:
        if error.errno != errno.EIO:  # that of a terminal that is gone: nobody reads how it ended
            raise
    raise typer.Exit(int(result.exit_code))


def _tell_end(result: RunResult, *, as_json: bool) -> None:
    from rigctl.answers.measures import measure_blocks
    from rigctl.cli.blocks import show
    from rigctl.cli.nonblocking_output import finish_display
    from rigctl.dataset.history import absences_in

    finish_display()
    if result.unconfirmed is not None:  # before anything that takes time, or may fail
        warning = f"OUTPUTS NOT CONFIRMED SAFE: {result.unconfirmed} may still be on"
        typer.secho(f"{warning}\n{result.by_hand}", fg=typer.colors.RED, bold=True, err=True)
    test, run = result.test, _run(result)
    stuck = _stuck(run)
    if as_json:
        folder = result.folder
        document = {
            "run": folder.name if folder is not None else None,
            "path": folder.as_posix() if folder is not None else None,
            "status": result.status,
            "reason": result.reason,
            "records": result.records,
            "duration": round(result.duration, 6),
            "exit_code": int(result.exit_code),
            "unconfirmed": result.unconfirmed,
            "by_hand": result.by_hand,
            "warnings": [asdict(one) for one in result.warnings],
            "stuck": stuck,
            "test": test.to_json() if test is not None else None,
        }
        print_json(document)
    else:
        echo(result.summary())
        if result.folder is not None:
            echo(f"  {result.folder.as_posix()}")
        if run is not None and sys.stdout.isatty():
            with suppress(RigctlError):  # what its files lack must not hide how the run ended
                show(measure_blocks(run))
        if test is not None and test.measures:
            _report_test(test)
        if run is not None and (absences := absences_in(run.info)):
            echo(f"  note: lost devices: {absences}")
        for sentence in stuck:
            echo(f"  note: {sentence}")


def _run(result: RunResult) -> Run | None:
    """The run's data; None if they cannot be read, or something else comes first."""
    from rigctl.dataset import open_run

    if result.folder is None or result.unconfirmed is not None:
        return None
    try:
        return open_run(result.folder)
    except Exception:  # noqa: BLE001 - a remark on the data must not hide how the run ended
        return None


def _stuck(run: Run | None) -> list[str]:
    """What the run's own data say of its sensors; nothing for a run without readable samples."""
    from rigctl.dataset.standstill import stuck_channels

    if run is None:
        return []
    try:
        return stuck_channels(run)
    except Exception:  # noqa: BLE001 - a remark on the data must not hide how the run ended
        return []


def _report_test(test: Judgement) -> None:
    """Report whether the device has passed, and every limit that it missed."""
    count, missed = len(test.measures), test.missed
    measures, its = noun(count, "measure"), noun(count, "its", "their")
    if not missed:
        ended = "" if test.result == "pass" else ", and the run did not come to its end"
        within = f"{count} {measures} within {its} limits{ended}"
        typer.secho(f"{test.result.upper()}: {within}", fg=typer.colors.GREEN if not ended else None)
        return
    typer.secho(f"FAIL: {len(missed)} of {count} {measures} outside the limits", fg=typer.colors.RED)
    for measure in missed[:_MOST_SHOWN]:
        echo(f"  {measure.where + ': ' if measure.where else ''}{measure.sentence()}")
    if len(missed) > _MOST_SHOWN:
        echo(f"  and {len(missed) - _MOST_SHOWN} more: 'rigctl runs show'")


def say_warnings(warnings: Sequence[str]) -> None:
    """Show warnings before a run."""
    for warning in warnings:
        echo(f"warning: {warning}", err=True)


def typing_possible() -> bool:
    """Whether a person can type here: stdin is a terminal."""
    from rigctl.runner.operators.keys import is_terminal

    return is_terminal(sys.stdin)

"""The device under test and the person in charge, as options of a command, with a prompt if missing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Final

import typer

from rigctl.cli.echo import echo
from rigctl.cli.question import ask
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.plan import Plan
    from rigctl.plan.identity import Identity

SerialNumberOption = Annotated[
    str | None,
    typer.Option(help="Serial number of the device under test; kept with the run, like the next two."),
]
PartOption = Annotated[str | None, typer.Option(help="Part or type number of the device under test.")]
NotesOption = Annotated[str | None, typer.Option(help="Other notes about the device.")]

#: number of attempts at an answer
_TRIES: Final = 5


def identified(plan: Plan, given: Mapping[str, str | None], *, demanded: bool = True) -> Identity:
    """The given values and the procedure's defaults; a person at the terminal is asked for what is required.

    With `demanded` false, as on a simulated bench, nothing has to be given, but given values must still
    match.

    Raises
    ------
    RigctlError
        a value does not match the procedure's pattern, or is missing and nobody can be asked.
    """
    from dataclasses import replace

    from rigctl.cli.attended_run import typing_possible
    from rigctl.plan.identity import settled

    identity, missing = settled(plan.procedure.identity, given)
    if not demanded or not missing:
        return identity
    if not typing_possible():
        options = " and ".join(f"--{name.replace('_', '-')}" for name in missing)
        raise RigctlError(
            f"the procedure requires the {' and the '.join(name.replace('_', ' ') for name in missing)}",
            expected=options,
            where=plan.root.where,
        )
    return replace(identity, **{name: _ask(plan, name) for name in missing})


def _ask(plan: Plan, name: str) -> str:
    """Ask until an answer fits, a few times."""
    from rigctl.plan.identity import checked

    demands = plan.procedure.identity
    pattern = getattr(demands, name).pattern
    for _ in range(_TRIES):
        text = ask(name.replace("_", " ").capitalize() + (f" [{pattern}]" if pattern else ""))
        try:
            answer = checked(demands, name, text)
        except RigctlError as error:
            echo(str(error), err=True)
        else:
            if answer:
                return answer
    raise RigctlError(f"no {name.replace('_', ' ')} was given that fits", expected=pattern)

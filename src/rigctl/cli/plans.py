"""From the command line to a plan: the procedure, the rig and the arguments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.plan import Plan


def read_assignments(texts: Sequence[str], option: str = "--arg") -> dict[str, str]:
    """``name=value`` texts as a mapping; the last one of a name counts.

    Raises
    ------
    RigctlError
        a text without a name or an equals sign.
    """
    assignments: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise RigctlError(f"{option}: no assignment", value=text, expected="name=value")
        assignments[name.strip()] = value.strip()
    return assignments


def open_plan(procedure: Path, rig: Path | None = None, arguments: Sequence[str] = ()) -> Plan:
    """Read a procedure, expand it on a rig (by default the one it names), and return its plan.

    Raises
    ------
    RigctlError
        a file or an argument is wrong.
    """
    from rigctl.procedure import expand, load_procedure
    from rigctl.project import find_file
    from rigctl.rig import load_rig

    given = read_assignments(arguments)
    read = load_procedure(find_file(procedure))
    return expand(read, load_rig(find_file(rig) if rig is not None else read.rig_path), given)

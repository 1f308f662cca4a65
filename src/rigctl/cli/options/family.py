"""`--family`: a user's own family of models for the duration of one command."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rigctl.rig import Rig


@contextmanager
def family_given(written: str) -> Iterator[None]:
    """Register a family by its name and file; a Python file is executed, and an FMU may be, since the user
    names it explicitly.

    Raises
    ------
    RigctlError
        the file is wrong or fails, or its family has a name that is taken.
    """
    from rigctl.fmu.archive import digest
    from rigctl.fmu.program import allow
    from rigctl.physics.families import FAMILIES, find_family, is_family_file, using_families
    from rigctl.physics.user.load import load_family
    from rigctl.physics.user.program import run_family_file
    from rigctl.project import find_file

    if written.casefold().endswith(".fmu"):  # what a family file names, and may run only if the user does too
        allow(digest(find_file(Path(written))))
        yield
        return
    if not is_family_file(written):
        find_family(written)
        yield
        return
    path = find_file(Path(written))
    python = path.suffix.casefold() == ".py"
    family = run_family_file(path) if python else load_family(path, FAMILIES)
    with using_families(family, path=path):
        yield


def use_family(context: typer.Context, written: str | None) -> str | None:
    """Apply `--family` for the duration of the command."""
    if written is not None and not context.resilient_parsing:
        context.with_resource(family_given(written))
    return written


def check_family_of(rig: Rig) -> None:
    """Require that the rig's family, if it names one, is registered and matches the rig file.

    Raises
    ------
    RigctlError
        it is not, or does not.
    """
    if rig.model is not None:
        from rigctl.model.rig_family import family_of

        family_of(rig)


#: of commands whose files may name the family
FamilyOption = Annotated[
    str | None,
    typer.Option(
        "--family",
        metavar="FILE",
        callback=use_family,
        help="Your own family of models, which the rig or model file names: YAML or Python "
        "(Python is executed); or the FMU that a family file names, so that it may run.",
        show_default=False,
    ),
]

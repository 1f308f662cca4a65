"""`--allow-driver`: Python packages that may be imported for drivers; at a terminal, others are asked for."""

from __future__ import annotations

from typing import Annotated

import typer

from rigctl.cli.question import confirm


def _allow(context: typer.Context, packages: list[str] | None) -> list[str] | None:
    """Allow packages for the duration of the command."""
    if not context.resilient_parsing:
        from rigctl.backends.python.permission import allowing, require_package
        from rigctl.cli.attended_run import typing_possible

        for package in packages or ():
            require_package(package, "--allow-driver: ")
        context.with_resource(allowing(packages or (), _ask if typing_possible() else None))
    return packages


def _ask(package: str) -> bool:
    question = (
        f"The rig file names a driver of the Python package {package!r}, which would be executed. "
        "Allow this package, here and from now on in this project?"
    )
    return confirm(question)


AllowDriverOption = Annotated[
    list[str] | None,
    typer.Option(
        "--allow-driver",
        metavar="PACKAGE",
        callback=_allow,
        help="Python package that the rig file may name a driver of; repeatable. If 'drivers' in rigctl.toml "
        "lists it, this is kept for the project; otherwise it is for one command.",
        show_default=False,
    ),
]

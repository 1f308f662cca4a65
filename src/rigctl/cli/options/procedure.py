"""`--rig` and `--arg` of the commands that read a procedure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

RigOption = Annotated[
    Path | None, typer.Option(help="Rig file to use instead of the one that the procedure names.")
]
ArgumentOption = Annotated[
    list[str] | None,
    typer.Option("--arg", "-a", metavar="NAME=VALUE", help="Argument of the procedure; repeatable."),
]

"""The option for the address of a bench, or of each of its devices."""

from __future__ import annotations

from typing import Annotated

import typer

PortOption = Annotated[
    list[str] | None,
    typer.Option(
        help="Serial port, pyserial URL or other address, e.g. /dev/ttyACM0; NAME=ADDRESS for one of several "
        "devices, repeatable."
    ),
]

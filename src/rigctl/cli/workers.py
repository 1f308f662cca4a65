"""Options of commands that hand work out."""

from __future__ import annotations

from typing import Annotated

import typer

Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        help="Hand the work to a Dask scheduler, tcp://HOST:8786, or to local:N processes.",
        show_default=False,
    ),
]
WorkerCount = Annotated[
    int | None,
    typer.Option(
        "--workers", metavar="N", min=1, help="Processes; one for each core if left out.", show_default=False
    ),
]

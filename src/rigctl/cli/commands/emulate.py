"""`rigctl emulate`: the board's firmware on an emulated microcontroller, its port ready for any client."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.echo import echo


def emulate(
    rig: Annotated[
        str, typer.Option(metavar="<path>", help="Rig file of the bench that its pins are wired to.")
    ] = "rigs/hl32-bench-uno.yaml",
    link: Annotated[
        Path | None, typer.Option(help="Name for the port, e.g. ttyRIG.", show_default=False)
    ] = None,
    baud: Annotated[int, typer.Option(help="115200 or 500000.")] = 115200,
    speed: Annotated[str, typer.Option(help="1x, or e.g. 5x.")] = "1x",
    seed: Annotated[int | None, typer.Option(min=0, help="Seed for the sensor noise.")] = None,
) -> None:
    """Emulate the board and its bench, and offer its serial port to any client until Ctrl-C.

    Needs Linux and simavr (Debian: libsimavr2).

    Examples:

      rigctl emulate --link ttyRIG

      rigctl run procedures/quick-check.yaml --rig rigs/hl32-bench-uno.yaml --port ttyRIG
    """
    from rigctl.backends.emulated.create import make_board
    from rigctl.backends.emulated.pty_bridge import PtyBridge
    from rigctl.errors import RigctlError
    from rigctl.project import find_project
    from rigctl.rig import load_rig
    from rigctl.runner.bench_access import clock_for
    from rigctl.runner.operators.signals import Signals

    if speed == "max":
        raise RigctlError("other clients run in real time", value=speed, expected="1x, or e.g. 5x")
    path = Path(rig) if Path(rig).exists() else find_project().resolve(rig)
    options: dict[str, object] = {"baud": baud} if seed is None else {"baud": baud, "seed": seed}
    board = make_board(load_rig(path), options)
    bridge = PtyBridge(board, clock_for(speed, "emulated"))
    try:
        # handlers of our own: a shell's background job has Ctrl-C ignored, and SIGTERM would leave the link
        with Signals() as signals:
            if link is not None:
                bridge.link(link)
            echo(f"{link or bridge.port} at {baud} baud; Ctrl-C ends it")
            while not signals.count:
                bridge.step()
        echo("ended", err=True)
    finally:
        bridge.unlink()
        bridge.close()
        board.close()

"""`rigctl demo`: the main job on the simulated bench, from nothing to a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from rigctl.dataset import Run

_PROCEDURE = Path("procedures") / "campaign.yaml"


def demo(
    directory: Annotated[
        Path, typer.Argument(help="The project folder to work in; made when it is not there.")
    ] = Path("rigctl-demo"),
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser at the end.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the bench's noise.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Carry out the published campaign on the simulated bench and make a page of it.

    The bench heats its oil from 20 to 80 degC and strokes its cylinder at four pressures: about fifty minutes
    of bench time, in seconds. Every call makes a new run; nothing is overwritten.

    Example: rigctl demo my-demo --open
    """
    from rich.console import Console

    from rigctl.cli.init import create_project
    from rigctl.files.write import to_json

    console = Console(stderr=as_json, highlight=False)
    if (directory / "rigctl.toml").exists():
        console.print(f"[bold]1[/] The project in {directory} is there already")
    else:
        create_project(directory)
        console.print(f"[bold]1[/] A project folder with the published bench: {directory}")
    console.print(f"[bold]2[/] The campaign on the simulated bench: {_PROCEDURE}")
    run, seconds = _simulate(directory, seed)
    console.print(f"  {run.info['duration'] / 60:.0f} min of bench time in {seconds:.1f} s: {run.id}")
    _show_strokes(console, run)
    page = directory / f"{run.id}.html"
    size = _write_page(run, page)
    console.print(f"[bold]3[/] The page about it: {page} ({size / 1e6:.1f} MB)")
    if as_json:
        typer.echo(to_json({"project": str(directory), "run": run.id, "page": str(page), "bytes": size}))
    if show:
        typer.launch(str(page))
    elif not as_json:
        console.print(f"\nNext: open it, then  cd {directory} && rigctl check {_PROCEDURE}")


def _simulate(directory: Path, seed: int) -> tuple[Run, float]:
    """The campaign as a new run of the project, and the wall time it took."""
    import time

    from rigctl.cli.plans import open_plan
    from rigctl.dataset import open_run
    from rigctl.errors import ExitCode, RigctlError
    from rigctl.live import view
    from rigctl.runner.launch import launch
    from rigctl.runner.simulation import simulation_launch

    start = time.perf_counter()
    plan = open_plan(directory / _PROCEDURE)
    with view(plan) as display:
        result = launch(plan, simulation_launch(plan, directory / "runs", seed=seed, observer=display))
    if result.exit_code != ExitCode.DONE or result.folder is None:
        raise RigctlError("the campaign did not finish", value=result.reason, exit_code=result.exit_code)
    return open_run(result.folder), time.perf_counter() - start


def _show_strokes(console: Console, run: Run) -> None:
    """Stroke against temperature and pressure, as the records hold it."""
    from rich.table import Table

    strokes = run.records.pivot_table(index="oil", columns="supply", values="stroke")
    table = Table(r"oil \[degC]", *(f"{supply:g} bar" for supply in strokes.columns), title=r"stroke \[mm]")
    for oil, row in strokes.iterrows():
        table.add_row(f"{oil:g}", *(f"{value:.1f}" for value in row))
    console.print(table)


def _write_page(run: Run, page: Path) -> int:
    from rigctl.report import write_report

    return write_report([run], page).size

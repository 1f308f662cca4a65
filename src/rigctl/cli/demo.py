"""`rigctl demo`: the whole loop on the simulated bench, from nothing to a model that agrees, and a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import echo_json

if TYPE_CHECKING:
    from rich.console import Console

    from rigctl.analysis.comparison_result import Comparison
    from rigctl.analysis.improve import Improvement
    from rigctl.dataset import Run

_PROCEDURE = Path("procedures") / "campaign.yaml"
_MODEL = Path("models") / "hl32-textbook.yaml"
#: what the bench may hide; the seed chooses, so that a reader of this file does not know either
_HIDDEN = ("valve_delay_thermal", "valve_leakage", "relief_thermal_drift")
_HELD_OUT = "oil == 60 degC"


def demo(
    directory: Annotated[
        Path, typer.Argument(help="The project folder to work in; made when it is not there.")
    ] = Path("rigctl-demo"),
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser at the end.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the bench's noise, and of what it hides.")] = 1,
    plain: Annotated[
        bool, typer.Option("--plain", help="Hide nothing: the campaign and its page alone.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Carry out the published campaign on a bench that hides something, find out what, and add it.

    The bench heats its oil from 20 to 80 degC and strokes its cylinder at four pressures: about fifty minutes
    of bench time, in seconds. The textbook model is compared with what was measured; what it lacks is named,
    added and judged on a temperature that the fit never saw. Every call makes a new run, and a copy of the
    model for it; nothing is overwritten.

    Example: rigctl demo my-demo --open
    """
    from rich.console import Console
    from rich.markup import escape

    from rigctl.cli.init import create_project
    from rigctl.files.write import to_json

    console = Console(stderr=as_json, highlight=False)
    if (directory / "rigctl.toml").exists():
        console.print(f"[bold]1[/] The project in {escape(str(directory))} is there already")
    else:
        create_project(directory)
        console.print(f"[bold]1[/] A project folder with the published bench: {escape(str(directory))}")
    console.print(f"[bold]2[/] The campaign on the simulated bench: {_PROCEDURE}")
    run, seconds = _simulate(directory, seed, None if plain else _HIDDEN[seed % len(_HIDDEN)])
    console.print(f"  {run.info['duration'] / 60:.0f} min of bench time in {seconds:.1f} s: {run.id}")
    _show_strokes(console, run)
    page = directory / f"{run.id}.html"
    told: dict[str, object] = {"project": str(directory), "run": run.id}
    if plain:
        size = _write_page(run, page)
    else:
        model = _own_model(directory, run)
        compared, improved = _improve(model, run, console)
        told |= {
            "model": str(model),
            "verdict": improved.first.verdict.value,
            "effects": list(improved.first.effects),
            "classes": [list(names) for names in improved.first.classes],
            "hidden": _HIDDEN[seed % len(_HIDDEN)],
            "ended": improved.ended.value,
            "diagnosis": improved.document(),
        }
        size = _write_analysis(run, page, compared, improved, model)
    console.print(
        f"[bold]{3 if plain else 5}[/] The page about it: {escape(str(page))} ({size / 1e6:.1f} MB)"
    )
    if as_json:
        echo_json(to_json(told | {"page": str(page), "bytes": size}))
    if show:
        typer.launch(str(page))
    elif not as_json:
        console.print(f"\nNext: open it, then  cd {escape(str(directory))} && rigctl check {_PROCEDURE}")


def _own_model(directory: Path, run: Run) -> Path:
    """A copy of the textbook model for this run: another demo begins with the textbook again."""
    from rigctl.files.write import write_new

    path = directory / _MODEL.parent / f"{run.id}.yaml"
    write_new(path, (directory / _MODEL).read_bytes())
    return path


def _improve(path: Path, run: Run, console: Console) -> tuple[Comparison, Improvement]:
    """Compare the textbook model with the run, and add what it lacks."""
    from rich.markup import escape

    from rigctl.analysis.comparison import compare
    from rigctl.analysis.improve import improve
    from rigctl.cli.diagnose_views import show_improvement
    from rigctl.cli.telling import telling
    from rigctl.model import load_model

    with telling() as on_progress:
        compared = compare([run], [load_model(path)], hold_out=_HELD_OUT, on_progress=on_progress)
    console.print(f"[bold]3[/] The textbook model against what was measured: {escape(str(path))}")
    console.print(f"  {escape(compared.models[0].statement)}", soft_wrap=True)
    with telling() as on_progress:
        improved = improve(compared, path, on_progress=on_progress)
    console.print(f"[bold]4[/] What it lacks, added and judged where the fit never looked ({_HELD_OUT})")
    if not console.stderr:
        show_improvement(improved)
    return compared, improved


def _write_analysis(run: Run, page: Path, compared: Comparison, improved: Improvement, model: Path) -> int:
    """The page of the run with the comparison, the diagnosis and the fall of the error."""
    from rigctl.report import write_report
    from rigctl.report.analysis import improvement_sections

    return write_report([run], page, sections=improvement_sections(compared, improved, model)).size


def _simulate(directory: Path, seed: int, hidden: str | None) -> tuple[Run, float]:
    """The campaign as a new run of the project, and the wall time it took."""
    import time

    from rigctl.cli.plans import open_plan
    from rigctl.dataset import open_run
    from rigctl.errors import ExitCode, RigctlError
    from rigctl.live import view
    from rigctl.runner.launch import launch
    from rigctl.runner.simulation import simulation_launch

    start = time.perf_counter()
    effects = () if hidden is None else (hidden,)
    plan = open_plan(directory / _PROCEDURE)
    with view(plan) as display:
        result = launch(
            plan, simulation_launch(plan, directory / "runs", seed=seed, effects=effects, observer=display)
        )
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

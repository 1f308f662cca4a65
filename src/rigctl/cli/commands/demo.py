"""`rigctl demo`: the whole workflow on the simulated bench, up to a model that agrees, and a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import echo_json

if TYPE_CHECKING:
    from rich.console import Console

    from rigctl.analysis.comparison_result import Comparison
    from rigctl.dataset import Run
    from rigctl.design.result import DesignResult
    from rigctl.learning.result import Learned, Round

_PROCEDURE = Path("procedures") / "campaign.yaml"
_MODEL = Path("models") / "hl32-textbook.yaml"
#: name of the copy; for further demos in a folder with a number appended
_DEMO = "hl32-demo"
#: effects that the bench may hide, too weak for the campaign to identify; chosen by the seed, so that
#: a reader of this file does not know which either
_HIDDEN = (
    "rod_leakage:conductance=3e-15 m^3",
    "valve_leakage:conductance=4e-16 m^3",
)
_HELD_OUT = "oil == 60 degC"
#: rounds of learning, the campaign included
_ROUNDS = 3


def demo(
    directory: Annotated[
        Path, typer.Argument(help="Project folder to work in; created if it does not exist.")
    ] = Path("rigctl-demo"),
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser at the end.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed for the noise and the hidden effect.")] = 1,
    plain: Annotated[
        bool, typer.Option("--plain", help="Hide nothing: run only the campaign and write its page.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Run the published campaign on a bench with a hidden effect, identify the effect, and add it to the
    model.

    The bench heats its oil from 20 to 80 degC and strokes its cylinder at four pressures: about fifty
    minutes of bench time, in seconds. The campaign leaves several explanations of why the textbook model is
    wrong. The records that distinguish them are designed and measured, and their predicted power is compared
    with the result; effects that are significant are added, and checked at a temperature that the fit did
    not use. Every call makes new runs, and a copy of the model for them; nothing is overwritten.

    Example: rigctl demo my-demo --open
    """
    from rich.console import Console
    from rich.markup import escape

    from rigctl.cli.commands.init import create_project
    from rigctl.files.write import to_json

    console = Console(stderr=as_json, highlight=False)
    if (directory / "rigctl.toml").exists():
        console.print(f"[bold]1[/] Using the project that is already in {escape(str(directory))}")
    else:
        create_project(directory)
        console.print(f"[bold]1[/] A project folder with the published bench: {escape(str(directory))}")
    console.print(f"[bold]2[/] The campaign on the simulated bench: {_PROCEDURE}")
    run, seconds = _simulate(directory, seed, None if plain else _HIDDEN[seed % len(_HIDDEN)])
    console.print(f"  {run.info['duration'] / 60:.0f} min of bench time in {seconds:.1f} s: {run.id}")
    _show_strokes(console, run)
    document: dict[str, object] = {"project": str(directory), "run": run.id}
    if plain:
        page = directory / f"{run.id}.html"
        size = _write_page(run, page)
    else:
        hidden = _HIDDEN[seed % len(_HIDDEN)]
        model = _own_model(directory)
        page = directory / f"{model.stem}.html"
        compared = _compare(model, run, console)
        learned = _learn(directory, model, run, seed, hidden, console)
        first = learned.rounds[0]
        document |= {
            "model": str(model),
            "verdict": first.verdict,
            "effects": list(first.effects),
            "classes": [list(names) for names in first.classes],
            "hidden": hidden.partition(":")[0],
            "learned": learned.document(),
        }
        size = _write_story(directory, learned, page, compared, model, hidden)
    console.print(
        f"[bold]{3 if plain else 6}[/] The page about it: {escape(str(page))} ({size / 1e6:.1f} MB)"
    )
    if as_json:
        echo_json(to_json(document | {"page": str(page), "bytes": size}))
    if show:
        typer.launch(str(page))
    elif not as_json:
        console.print(f"\nNext: open it, then  cd {escape(str(directory))} && rigctl check {_PROCEDURE}")


def _own_model(directory: Path) -> Path:
    """A copy of the textbook model, ``hl32-demo.yaml``: another demo starts from the textbook again."""
    from itertools import count

    from rigctl.files.write import write_new

    for number in count(1):
        path = directory / _MODEL.parent / (f"{_DEMO}-{number}.yaml" if number > 1 else f"{_DEMO}.yaml")
        try:
            write_new(path, (directory / _MODEL).read_bytes())
        except FileExistsError:
            continue
        return path
    raise AssertionError("there is always a number that is free")


def _compare(path: Path, run: Run, console: Console) -> Comparison:
    """Compare the textbook model with the campaign."""
    from rich.markup import escape

    from rigctl.analysis.comparison import compare
    from rigctl.cli.progress import progress_display
    from rigctl.model import load_model

    with progress_display() as on_progress:
        compared = compare([run], [load_model(path)], hold_out=_HELD_OUT, on_progress=on_progress)
    console.print(f"[bold]3[/] The textbook model compared with the measurements: {escape(str(path))}")
    console.print(f"  {escape(compared.models[0].statement)}", soft_wrap=True)
    return compared


def _learn(directory: Path, model: Path, run: Run, seed: int, hidden: str, console: Console) -> Learned:
    """The steps after the campaign: the open question, the designed records, and their result."""
    from rich.markup import escape

    from rigctl.cli.progress import progress_display
    from rigctl.learning.bench import LaunchedBench
    from rigctl.learning.keep import Kept, Task
    from rigctl.learning.learn import Learner
    from rigctl.learning.result import round_text
    from rigctl.runner.simulation import simulation_launch

    runs = directory / "runs"
    task = Task(
        procedure=str((directory / _PROCEDURE).absolute()),
        model=str(model.absolute()),
        version=1,
        runs=(run.id,),
        rounds=_ROUNDS,
        hold_out=_HELD_OUT,
    )
    bench = LaunchedBench(
        how=lambda plan, number: simulation_launch(plan, runs, seed=seed + number - 1, effects=(hidden,))
    )

    def proposed(proposal: Round, design: DesignResult) -> bool:
        console.print(f"[bold]4[/] What to measure next: {escape(proposal.procedure)}")
        console.print(f"  {escape(design.statement)}", soft_wrap=True)
        return True

    def judged(one: Round) -> None:
        console.print(f"  {escape(round_text(one))}", soft_wrap=True)

    session = Kept.create(directory, task, "demo")
    learned = Learner(session, bench, runs, proposed, working=progress_display, on_round=judged).learn()
    console.print(f"[bold]5[/] The result, evaluated also on records that no fit saw ({_HELD_OUT})")
    console.print(f"  {escape(learned.statement)}", soft_wrap=True)
    answer = _effects_text(learned, model)
    console.print(f"  hidden: {escape(hidden)}; found: [bold]{escape(answer)}[/]", soft_wrap=True)
    return learned


def _effects_text(learned: Learned, model: Path) -> str:
    """The added effects with their sizes, in the form of ``--with``; otherwise how it ended."""
    from rigctl.model import load_model
    from rigctl.units import parse_unit, with_uncertainty

    effects = load_model(model).effects
    parts = []
    for name in learned.added:
        sizes = []
        for key, one in effects[name].items():
            unit = parse_unit(one.unit or "1")
            sizes.append(
                f"{key}={with_uncertainty(one.si / unit.factor, (one.std or 0.0) / unit.factor, unit.text)}"
            )
        parts.append(f"{name}:{','.join(sizes)}")
    return " and ".join(parts) or learned.ended.value.replace("_", " ")


def _write_story(
    directory: Path, learned: Learned, page: Path, compared: Comparison, model: Path, hidden: str
) -> int:
    """The page: what was learnt, how the error fell, where the textbook failed, and the hidden effect."""
    from rigctl.cli.analysis_page import named_versions
    from rigctl.dataset import find_run, open_run
    from rigctl.report import write_report
    from rigctl.report.analysis import comparison_sections, hidden_section, learning_sections

    names = [*compared.runs, *(one.run for one in learned.rounds if one.run)]
    runs = [open_run(find_run(name, directory / "runs")) for name in dict.fromkeys(names)]
    versions = named_versions(runs, model, 1, hold_out=_HELD_OUT)
    sections = [
        *learning_sections(learned, model, versions),
        *comparison_sections(compared, answered=True),
        hidden_section(
            hidden, _effects_text(learned, model), right=learned.added == (hidden.partition(":")[0],)
        ),
    ]
    return write_report(runs, page, sections=sections).size


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

"""`rigctl demo`: the stroke falls, the textbook says it rises, and what is missing is found.

In: nothing but a folder. Out: a project with two runs, a copy of the textbook model with the missing
effect as its next version, and a page. It calls the functions that `import`, `simulate`, `compare` and
`diagnose --apply` call, so that all it shows can be repeated by hand.

The story has two halves. The eight strokes of the publication cannot tell four explanations apart,
whatever the analysis. A simulated bench therefore hides one of the four, and records strokes over time:
with these it is found, and the page tells at the end what was hidden. A copy of the model is changed, so
that the next demo begins at the textbook again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.as_json import Json

if TYPE_CHECKING:
    from rich.console import Console

    from rigctl.analysis.comparison_result import Comparison
    from rigctl.analysis.improve import Improvement
    from rigctl.dataset import Run

_PUBLISHED = Path("data") / "hl32-strokes.csv"
_RIG = Path("rigs") / "hl32-bench.yaml"
_PROCEDURE = Path("procedures") / "campaign.yaml"
_MODEL = Path("models") / "hl32-textbook.yaml"
#: name of the copy; for further demos in a folder with a number appended
_DEMO = "hl32-demo"
#: what the simulated bench hides: one of the four effects that the published strokes cannot tell apart
_HIDDEN = "valve_delay_thermal:coefficient=1.8 ms/K"
#: every other temperature of the campaign: enough, in half the time
_TEMPERATURES = "20 degC, 40 degC, 60 degC, 80 degC"
_HELD_OUT = "oil == 60 degC"


def demo(
    directory: Annotated[
        Path, typer.Argument(help="Project folder to work in; created if it does not exist.")
    ] = Path("rigctl-demo"),
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser at the end.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed for the noise.")] = 1,
    plain: Annotated[
        bool, typer.Option("--plain", help="Hide nothing: run only the campaign and write its page.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Tell the published story: the measured stroke falls as the oil warms, the textbook model says it rises;
    find the missing effect, and add it to the model.

    The eight strokes of the publication leave four explanations open; which record would decide is stated.
    The simulated bench hides an effect too. It heats its oil from 20 to 80 degC and strokes its cylinder at
    four pressures, recorded over time: three quarters of an hour of bench time, in seconds. What is found is
    added to the model and checked at a temperature that no fit has seen. Every call makes new runs, and a
    copy of the model for them; nothing is overwritten.

    Example: rigctl demo my-demo --open
    """
    from rich.console import Console
    from rich.markup import escape

    console = Console(stderr=as_json, highlight=False)
    # 1. A project of its own, as every later command is typed in it; one that is there is used again.
    if (directory / "rigctl.toml").exists():
        console.print(f"[bold]1[/] Using the project that is already in {escape(directory.as_posix())}")
    else:
        from rigctl.cli.commands.init import create_project

        create_project(directory)
        console.print(f"[bold]1[/] A project folder with the published bench: {escape(directory.as_posix())}")
    if plain:
        document, page, size = _plain(directory, seed, console)
    else:
        document, page, size = _story(directory, seed, console)
    document = {"project": directory.as_posix(), **document, "page": page.as_posix(), "bytes": size}
    if as_json:
        print_json(document)
    if show:
        typer.launch(str(page))
    elif not as_json:
        _show_next(console, directory, page)


def _plain(directory: Path, seed: int, console: Console) -> tuple[dict[str, object], Path, int]:
    """The whole campaign with nothing hidden, and its page."""
    from rigctl.report import write_report

    console.print(f"[bold]2[/] The campaign on the simulated bench: {_PROCEDURE}")
    run = _simulate(directory, seed, console)
    page = directory / f"{run.id}.html"
    size = write_report([run], page).size
    _say_page(console, 3, page, size)
    return {"run": run.id}, page, size


def _story(directory: Path, seed: int, console: Console) -> tuple[dict[str, object], Path, int]:
    """The published strokes, the bench that hides one of their explanations, and what is found there."""
    # 2. Eight published numbers: imported and compared first, since the simulated bench below hides one of
    # the explanations that they leave open.
    model = _own_model(directory)
    console.print(f"[bold]2[/] The published strokes, eight numbers: {_PUBLISHED}")
    published = _published(directory, model, console)
    # 3. and 4. Meanwhile the published strokes are diagnosed in another process; `answer` waits for it.
    with _asking(directory, model, published) as answer:
        console.print(
            f"[bold]3[/] A simulated bench, recorded over time; it hides an effect: {_PROCEDURE}",
            soft_wrap=True,
        )
        run = _simulate(
            directory, seed, console, arguments=(f"temperatures={_TEMPERATURES}",), effects=(_HIDDEN,)
        )
        compared, improved = _mend(model, run, console)
        question = answer()
    # 5. and 6. What is left open is told before what is found: the second answers the first.
    _show_question(question, console)
    found = _found(improved, model)
    _show_found(compared, improved, found, console)
    page = directory / f"{model.stem}.html"
    size = _write_page(page, run, (compared, improved), (published, question), model, found)
    _say_page(console, 7, page, size)
    return (
        {
            "published": published.runs[0],
            "run": run.id,
            "model": model.as_posix(),
            "question": question,
            "verdict": improved.first.verdict,
            "effects": list(improved.first.effects),
            "hidden": _HIDDEN.partition(":")[0],
            "improved": improved.document(),
        },
        page,
        size,
    )


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


def _published(directory: Path, model: Path, console: Console) -> Comparison:
    """The published strokes, imported and compared with the textbook."""
    from rigctl.cli.progress import progress_display

    with progress_display("Reading the published strokes"):
        from rigctl.dataset import open_run
        from rigctl.dataset.importing import import_file
        from rigctl.rig import load_rig

        imported = import_file(directory / _PUBLISHED, load_rig(directory / _RIG), directory / "runs")
    return _compare(open_run(imported.path), model, console)


def _compare(run: Run, model: Path, console: Console, hold_out: str | None = None) -> Comparison:
    """A run compared with a model, and the direction in which that is wrong."""
    from rigctl.cli.progress import progress_display

    with progress_display("Reading the records") as on_progress:
        from rigctl.analysis.comparison import compare
        from rigctl.answers.trends import trend_text
        from rigctl.model import load_model

        compared = compare([run], [load_model(model)], hold_out=hold_out, on_progress=on_progress)
    wrong = [trend_text(one) for one in compared.models[0].trends if one.wrong_sign and one.matters]
    statement = f"wrong direction: {wrong[0]}" if wrong else compared.models[0].statement
    console.print(f"  {statement}", markup=False, soft_wrap=True)
    return compared


@contextmanager
def _asking(directory: Path, model: Path, published: Comparison) -> Iterator[Callable[[], dict[str, Any]]]:
    """Diagnose the published strokes in another process meanwhile: the other core has nothing to do. Yields a
    function that waits for the diagnosis, as ``rigctl diagnose --json`` prints it."""
    import json
    import subprocess

    from rigctl.child_process import module_command
    from rigctl.cli.progress import progress_display
    from rigctl.errors import RigctlError

    words = ("diagnose", published.runs[0], "--model", model.relative_to(directory).as_posix(), "--json")
    command = module_command("rigctl", *words)
    with subprocess.Popen(  # noqa: S603 - our own program
        command, cwd=directory, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:

        def answer() -> dict[str, Any]:
            with progress_display("Diagnosing the published strokes"):
                printed, complaint = process.communicate()
            if process.returncode:
                *_, why = complaint.decode("utf-8", "replace").strip().splitlines() or [""]
                raise RigctlError(
                    f"the published strokes were not diagnosed: {why.removeprefix('rigctl: ')}".rstrip(": "),
                    hint=f"'rigctl {' '.join(words)}'",
                )
            return dict(json.loads(printed))

        try:
            yield answer
        finally:
            if process.poll() is None:
                process.kill()


def _mend(path: Path, run: Run, console: Console) -> tuple[Comparison, Improvement]:
    """The textbook compared with the campaign, and what it lacks added as its next version."""
    from rigctl.cli.progress import progress_display

    console.print(f"[bold]4[/] The textbook model compared with it: {path.as_posix()}")
    compared = _compare(run, path, console, _HELD_OUT)
    with progress_display("Looking for what the model lacks") as on_progress:
        from rigctl.analysis.improve import improve

        return compared, improve(compared, path, sure=True, on_progress=on_progress)


def _show_question(question: Mapping[str, Any], console: Console) -> None:
    """What the published strokes leave open, and which record would decide."""
    from rigctl.effects.registry import find_effect

    console.print("[bold]5[/] What single strokes leave open")
    rivals = question["classes"][0] if question["classes"] else []
    undecided = f"the eight published ones cannot tell which of {len(rivals)} effects it is:"
    console.print(f"  {undecided if rivals else question['statement']}", markup=False, soft_wrap=True)
    for name in rivals:
        console.print(
            f"    {find_effect(name, 'hydraulic_cylinder').described}", markup=False, soft_wrap=True
        )
    for step in question["next_steps"][:2]:
        console.print(f"  what decides: {step}", markup=False, soft_wrap=True)


def _show_found(compared: Comparison, improved: Improvement, found: str, console: Console) -> None:
    """What was added, the error of the stroke before and after, and what was hidden."""
    from rigctl.report.analysis.stroke_over_temperature import held_out_strokes

    console.print("[bold]6[/] What strokes recorded over time tell, added to the model as its next version")
    console.print(f"  {improved.statement}", markup=False, soft_wrap=True)
    if improved.steps:
        unseen = held_out_strokes(compared.models[0], improved.steps[-1].comparison)
        console.print(f"  {unseen} ({_HELD_OUT})", markup=False, soft_wrap=True)
    console.print(f"  hidden: {_HIDDEN}", markup=False, soft_wrap=True)
    console.print(f"  found:  {found}", markup=False, soft_wrap=True)


def _found(improved: Improvement, model: Path) -> str:
    """The added effects with their sizes, in the form of ``--with``; otherwise how it ended."""
    from rigctl.model import load_model
    from rigctl.units import parse_unit, with_uncertainty

    effects = load_model(model).effects
    parts = []
    for name in (name for step in improved.steps for name in step.effects):
        sizes = []
        for key, one in effects[name].items():
            unit = parse_unit(one.unit or "1")
            sizes.append(
                f"{key}={with_uncertainty(one.si / unit.factor, (one.std or 0.0) / unit.factor, unit.text)}"
            )
        parts.append(f"{name}:{','.join(sizes)}")
    return " and ".join(parts) or improved.ended.value.replace("_", " ")


def _write_page(
    page: Path,
    run: Run,
    mended: tuple[Comparison, Improvement],
    asked: tuple[Comparison, Mapping[str, Any]],
    model: Path,
    found: str,
) -> int:
    """The page: the picture, how the error fell, what single strokes leave open, and the hidden effect."""
    from rigctl.cli.progress import progress_display

    with progress_display(f"Writing {page.as_posix()}") as on_progress:
        from rigctl.report import write_report
        from rigctl.report.analysis import hidden_section, improvement_sections, question_section

        top, *rest = improvement_sections(*mended, model)
        # The answer on top, then the question that the published strokes left open, the evidence, and last
        # what was hidden.
        added = tuple(name for step in mended[1].steps for name in step.effects)
        sections = [
            top,
            question_section(asked[0].models[0], asked[1]),
            *rest,
            hidden_section(_HIDDEN, found, right=added == (_HIDDEN.partition(":")[0],)),
        ]
        return write_report([run], page, sections=sections, on_progress=on_progress).size


def _simulate(
    directory: Path,
    seed: int,
    console: Console,
    *,
    arguments: tuple[str, ...] = (),
    effects: tuple[str, ...] = (),
) -> Run:
    """The campaign as a new run of the project."""
    import time

    from rigctl.cli.progress import progress_display

    start = time.perf_counter()
    # The same way as `rigctl simulate`: the plan first, then the run, shown while it is in progress.
    with progress_display(f"Reading {_PROCEDURE.as_posix()}"):
        from rigctl.answers.measures import measure_blocks
        from rigctl.cli.blocks import show
        from rigctl.cli.plans import open_plan
        from rigctl.dataset import open_run
        from rigctl.errors import ExitCode, RigctlError
        from rigctl.live import view
        from rigctl.runner.launch import launch
        from rigctl.runner.simulation import simulation_launch

        plan = open_plan(directory / _PROCEDURE, arguments=arguments)
    with view(plan) as display:
        result = launch(
            plan, simulation_launch(plan, directory / "runs", seed=seed, effects=effects, observer=display)
        )
    if result.exit_code != ExitCode.DONE or result.folder is None:
        raise RigctlError("the campaign did not finish", value=result.reason, exit_code=result.exit_code)
    run = open_run(result.folder)
    seconds = time.perf_counter() - start
    console.print(f"  {run.info['duration'] / 60:.0f} min of bench time in {seconds:.1f} s: {run.id}")
    show(measure_blocks(run), console)
    return run


def _say_page(console: Console, number: int, page: Path, size: int) -> None:
    from rich.markup import escape

    console.print(f"[bold]{number}[/] The page about it: {escape(page.as_posix())} ({size / 1e6:.1f} MB)")


def _show_next(console: Console, directory: Path, page: Path) -> None:
    """The next commands, as they work in the shell that this one was typed in."""
    from rich.markup import escape

    from rigctl.cli.next_command import enter_environment
    from rigctl.command_line import shell_word

    console.print(f"\nNext: open {escape(page.as_posix())} in a browser, then")
    for line in (*enter_environment(), f"cd {shell_word(directory.as_posix())}", "rigctl serve"):
        console.print(f"  {escape(line)}", soft_wrap=True)

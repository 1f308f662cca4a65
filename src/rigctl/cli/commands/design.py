"""`rigctl design`: what to measure next in order to distinguish the remaining explanations.

In: runs and a model, whose diagnosis leaves a question open, or two effects named by the user, or several
models of which one is right. Out: an
answer, and on request a procedure, a work sheet for a bench without rigctl, and a page. The design is
made by `rigctl.design.design`.

It is a command of its own, and not a part of every diagnosis, because it simulates some hundred records
with every explanation: it takes as long as the diagnosis, and most users want only the verdict. `diagnose
--design` makes both at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import AsPage, Assume, HoldOut, Only, Runs
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.workers import Cluster

if TYPE_CHECKING:
    from rigctl.command_line import DataOptions
    from rigctl.dataset import Run
    from rigctl.design.result import DesignResult


def design(
    runs: Runs,
    model: Annotated[
        list[Path],
        typer.Option(
            "--model",
            "-m",
            metavar="M",
            help="Model file; M@3 is its version 3; repeatable, to find out which of several is right.",
            show_default=False,
        ),
    ],
    hold_out: HoldOut = None,
    only: Only = None,
    *,
    budget: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Limit on bench time, including heating and settling: 30m, 2h, '90 s'.",
            show_default=False,
        ),
    ] = None,
    records: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Maximum number of records; by default 4.")
    ] = None,
    separate: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="Two effects to distinguish, or an effect and 'none', instead of those that the "
            "diagnosis leaves open.",
            show_default=False,
        ),
    ] = None,
    sensors: Annotated[
        bool,
        typer.Option("--sensors", help="Also consider the channels that the rig file lists as possible."),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed for candidates and draws.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="File to write the procedure to.", show_default=False
        ),
    ] = None,
    page: AsPage = None,
    sheet: Annotated[
        Path | None,
        typer.Option(
            "--sheet",
            metavar="FILE",
            help="Printable work sheet to write, for a bench without rigctl; nothing is overwritten.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Let -o and --page replace a file that rigctl did not write.")
    ] = False,
    assume: Assume = None,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Number of processes for simulating candidates and refitting rivals; by default 1.",
            show_default=False,
        ),
    ] = None,
    cluster: Cluster = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Design the records, or find the sensor, that would distinguish the remaining explanations.

    Every candidate is a record that the rig can make. It is simulated with every explanation, each refitted
    against the others, and is rejected if any of them brings it near a limit of the rig. The predicted power
    is the probability that a diagnosis of old and new records names only the right explanation.

    Examples:

      rigctl design latest --model models/hl32-textbook.yaml -o next.yaml

      rigctl design latest --model models/hl32-textbook.yaml --budget 30m --records 2

      rigctl design latest --model models/first.yaml --model models/second.yaml
    """
    from rigctl.cli.progress import progress_display

    with progress_display("Reading the records", "no further file was written") as on_progress:
        from rigctl.answers.design.design import design_answer, whole_design
        from rigctl.cli.analysis_page import require_page
        from rigctl.cli.blocks import show, show_answer
        from rigctl.cli.named_input import open_models, open_runs
        from rigctl.command_line import DataOptions
        from rigctl.dataset.outputs import is_designed, require_output
        from rigctl.design.design import design_experiment
        from rigctl.tasks import Workers

        at = Workers(workers, cluster=cluster) if workers or cluster else None
        seconds = None if budget is None else read_budget(budget)
        pair = None if separate is None else read_pair(separate)
        if output is not None:
            require_output(output, replaces=is_designed, force=force)
        if sheet is not None:
            require_output(sheet, option="")
        require_page(page, force=force)
        opened, *others = open_models(model)
        measured = open_runs(runs, opened, assume)
        result = design_experiment(
            measured,
            opened,
            others=others,
            budget=seconds,
            records=records,
            separate=pair,
            sensors=sensors,
            seed=seed,
            hold_out=hold_out,
            only=only,
            workers=at,
            on_progress=on_progress,
        )
        if output is not None and result.procedure:
            _write_procedure(output, result)
        if sheet is not None and result.records:
            _write_sheet(sheet, result)
        if page is not None:
            on_progress(f"Writing {page.as_posix()}")
            _write_page(measured, page, result, force=force)
    if as_json:
        print_json(result.as_json())
    else:
        show(whole_design(result)) if verbose else show_answer(design_answer(result))
        choice = DataOptions(only, hold_out, assume or (), family)
        own = _own_options(budget, records, separate, seed, sensors=sensors)
        _suggest_next(result, runs, [one.as_posix() for one in model], choice, own, output)


def read_budget(text: str) -> float:
    """A time in s: ``30m`` are minutes here, as nobody has a budget of metres.

    Raises
    ------
    RigctlError
        not a time, or not greater than zero.
    """
    from rigctl.errors import RigctlError
    from rigctl.units import read_si

    plain = text.strip()
    minutes = plain[:-1].strip() if plain.endswith("m") else ""
    try:
        seconds = 60.0 * float(minutes) if minutes else read_si(plain, "s")
    except (RigctlError, ValueError):
        raise RigctlError("--budget: no time", value=text, expected="e.g. 30m, 2h or '90 s'") from None
    if not 0.0 < seconds < float("inf"):
        raise RigctlError("--budget: no time is left", value=text, expected="e.g. 30m, 2h or '90 s'")
    return seconds


def read_pair(text: str) -> tuple[str, str]:
    """Two names with a comma between them.

    Raises
    ------
    RigctlError
        more or fewer.
    """
    from rigctl.errors import RigctlError

    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise RigctlError("--separate: two names are needed", value=text, expected="A,B")
    return names[0], names[1]


def _write_procedure(output: Path, result: DesignResult) -> None:
    from rigctl.cli.echo import echo
    from rigctl.files.write import write_text

    write_text(output, result.procedure)
    echo(f"Wrote {output.as_posix()}", err=True)


def _write_sheet(sheet: Path, result: DesignResult) -> None:
    from rigctl.answers.design.work_sheet import work_sheet
    from rigctl.cli.echo import echo
    from rigctl.files.write import write_new

    write_new(sheet, work_sheet(result).encode("utf-8"))
    echo(f"Wrote {sheet.as_posix()}", err=True)


def _write_page(runs: list[Run], page: Path, result: DesignResult, *, force: bool) -> None:
    """The design first, then the diagnosis on which it is based."""
    from rigctl.cli.analysis_page import write_page
    from rigctl.report.analysis import design_sections, diagnosis_sections
    from rigctl.report.section import folded

    sections = design_sections(result)
    if result.diagnosis is not None:
        sections += folded(diagnosis_sections(result.diagnosis))
    write_page(runs, page, sections, force=force)


def _own_options(
    budget: str | None, records: int | None, separate: str | None, seed: int, *, sensors: bool
) -> list[str]:
    """The words of the given options that no other command has."""
    given = (("--budget", budget), ("--records", records), ("--separate", separate), ("--seed", seed or None))
    words = [word for option, value in given if value is not None for word in (option, str(value))]
    return [*words, *(["--sensors"] if sensors else [])]


def _suggest_next(
    result: DesignResult,
    runs: list[str],
    models: Sequence[str],
    choice: DataOptions,
    own: Sequence[str],
    output: Path | None,
) -> None:
    """The next command: write the procedure, check it, or look for a sensor; with `own` the options."""
    from rigctl.cli.next_command import show_next
    from rigctl.command_line import DataOptions, analysis, command

    first, *others = models
    rivals = [word for other in others for word in ("--model", other)]
    again = analysis("design", runs, first, choice, *rivals, *own)
    diagnosis = analysis("diagnose", runs, first, choice)
    rows = bool(result.records) and not result.procedure
    if others and (rows or not result.records):
        show_next(analysis("compare", runs, first, choice, *rivals), "shows where each model fails")
    elif rows:
        show_next(diagnosis, "shows what other than rows would distinguish them")
    elif not result.separable and result.aim != "precision" and "--sensors" not in own:
        show_next(f"{again} --sensors", "shows which sensor would distinguish them")
    elif not result.procedure:
        show_next(diagnosis, "shows what these data can decide and what not")
    elif output is None:
        show_next(f"{again} -o next.yaml", "writes the procedure")
    else:
        check = command(["check", output.as_posix()], DataOptions(family=choice.family))
        show_next(check, "shows what it will do before anything moves")

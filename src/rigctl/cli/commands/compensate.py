"""`rigctl compensate`: the set-point that keeps a quantity while conditions drift, and its check.

Two commands in one, as the second belongs to the first. Without `--judge`, runs and a model become a
schedule, written as C header or table, and a procedure that tests it on the bench. With `--judge`, the
runs of that procedure become a verdict, and the exit code: it needs no model and no options, because each
record of such a check states what it was made for.

The model alone is not believed: a schedule counts once pairs of records, with and without it in random
order, show a smaller error (`rigctl.compensation.paired_test`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import AsPage
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption

if TYPE_CHECKING:
    from rigctl.compensation.paired_test import Verdict
    from rigctl.compensation.result import Schedule


def compensate(
    runs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RUN...]",
            help="Ids, starts of ids, paths, or 'latest' (default).",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", "-m", metavar="M", help="Model file; M@3 is its version 3.", show_default=False
        ),
    ] = None,
    *,
    keep: Annotated[
        str | None,
        typer.Option(
            metavar="TARGET", help='Measure to hold and its value: "stroke = 110 mm".', show_default=False
        ),
    ] = None,
    vary: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Set-point to vary: supply_pressure.", show_default=False),
    ] = None,
    over: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Operating variable that it depends on: oil_temperature.", show_default=False
        ),
    ] = None,
    rows: Annotated[
        int, typer.Option(min=2, max=100, help="Number of operating points in the schedule.")
    ] = 7,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed for the random order of the records that check it.")
    ] = 0,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File for the schedule as a C header (.h) or a table (.csv), or for the procedure "
            "that checks it (.yaml); repeatable.",
            show_default=False,
        ),
    ] = None,
    judge: Annotated[
        bool,
        typer.Option(
            "--judge", help="Evaluate the runs of such a check; exit code 1 if the schedule fails it."
        ),
    ] = False,
    page: AsPage = None,
    force: Annotated[
        bool, typer.Option("--force", help="Let -o and --page replace an existing file.")
    ] = False,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Calculate the set-point that holds a measured quantity constant over the operating range, and check
    the result.

    The model is fitted to the runs and solved for the set-point at each operating point; the uncertainty of
    its parameters is propagated to the set-point. The schedule is checked by pairs of records, with and
    without it, in random order: it is accepted if the error with it is significantly smaller.

    Examples:

      rigctl compensate latest -m models/hl32-textbook.yaml --keep "stroke = 110 mm" \\
        --vary supply_pressure --over oil_temperature -o schedule.h -o procedures/check.yaml

      rigctl compensate latest --judge
    """
    from rigctl.errors import RigctlError

    chosen = runs or ["latest"]
    if judge:
        given = {
            "--model": model,
            "--keep": keep,
            "--vary": vary,
            "--over": over,
            "-o": output,
            "--page": page,
        }
        extra = [name for name, value in given.items() if value]
        if extra:
            raise RigctlError(
                "--judge takes what a check was made for from its records", value=", ".join(extra)
            )
        _judge(chosen, as_json=as_json)
        return
    named = {"--model": model, "--keep": keep, "--vary": vary, "--over": over}
    missing = [name for name, value in named.items() if not value]
    if model is None or keep is None or vary is None or over is None:
        raise RigctlError("a schedule needs more", expected=", ".join(missing))
    from rigctl.cli.progress import progress_display

    with progress_display("Reading the records", "nothing was saved") as on_progress:
        from rigctl.answers.schedule.schedule import schedule_answer, schedule_evidence
        from rigctl.cli.analysis_page import require_page, write_page
        from rigctl.cli.blocks import show_answer
        from rigctl.cli.named_input import open_models, open_runs
        from rigctl.compensation.schedule import compensate as compensated

        written = output or []
        _require(written, force=force)
        require_page(page, force=force)
        (opened,) = open_models([model])
        measured = open_runs(chosen, opened)
        schedule = compensated(
            measured, opened, keep=keep, vary=vary, over=over, rows=rows, seed=seed, on_progress=on_progress
        )
        _write(schedule, written)
        if page is not None:
            from rigctl.report.analysis import compensation_sections

            write_page(measured, page, compensation_sections(schedule), force=force)
    if as_json:
        print_json(schedule.document())
    else:
        show_answer(schedule_answer(schedule, written), schedule_evidence(schedule) if verbose else ())


def _judge(chosen: list[str], *, as_json: bool) -> None:
    from rigctl.answers.schedule.schedule import check_block
    from rigctl.cli.blocks import show
    from rigctl.cli.named_input import open_runs
    from rigctl.compensation.paired_test import judge as judged
    from rigctl.errors import ExitCode

    verdict: Verdict = judged(open_runs(chosen))
    if as_json:
        print_json(verdict.document())
    else:
        show([check_block(verdict)])
    if not verdict.accepted:
        raise typer.Exit(int(ExitCode.FAILED))


def _texts() -> dict[str, Callable[[Schedule, Path], str]]:
    """The content to write, by the extension of the file."""
    from rigctl.answers.schedule.check import check_procedure
    from rigctl.answers.schedule.tables import csv_text, header_text

    return {
        ".h": lambda schedule, _: header_text(schedule),
        ".csv": lambda schedule, _: csv_text(schedule),
        ".yaml": lambda schedule, path: check_procedure(schedule, path.parent),
    }


def _require(written: list[Path], *, force: bool) -> None:
    """Refuse an unknown kind of file, and an existing file."""
    from rigctl.dataset.outputs import require_output
    from rigctl.errors import RigctlError

    known = _texts()
    for path in written:
        if path.suffix not in known:
            raise RigctlError(
                "not a file format for a schedule",
                value=path.name,
                expected=f"a name that ends in {', '.join(known)}",
            )
        require_output(path, force=force)


def _write(schedule: Schedule, written: list[Path]) -> None:
    from rigctl.files.write import write_text

    known = _texts()
    for path in written:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, known[path.suffix](schedule, path))

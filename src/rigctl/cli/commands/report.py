"""`rigctl report`: one page about one or more runs."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.analysis import Assume
from rigctl.cli.options.cache import NoCache, Verbose
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.progress import progress_display
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.dataset import Run
    from rigctl.model import Model
    from rigctl.report.section import Section


class FigureFormat(StrEnum):
    """Formats of figures."""

    PNG = "png"
    SVG = "svg"


def report(
    runs: Annotated[
        list[str], typer.Argument(metavar="RUN...", help="Ids, starts of ids, paths, or 'latest'.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Page to write; by default RUN.html in the current folder."),
    ] = None,
    model: Annotated[
        list[Path] | None,
        typer.Option(
            "--model",
            "-m",
            metavar="M",
            help="Model to compare with the runs; repeatable.",
            show_default=False,
        ),
    ] = None,
    *,
    diagnose: Annotated[
        bool, typer.Option("--diagnose", help="Also diagnose what the first --model lacks.")
    ] = False,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Verbose = False,
    figures: Annotated[
        Path | None, typer.Option(help="Folder in which every plot is also saved as a separate file.")
    ] = None,
    form: Annotated[FigureFormat, typer.Option("--format", help="Format of the figures.")] = FigureFormat.PNG,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Replace files that are not pages or figures of rigctl, but never one of a run."
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Report the files written as JSON.")] = False,
) -> None:
    """Make one self-contained HTML page about one or more runs.

    The page holds its plots and data, needs no network, and can be sent by mail or printed. With --model it
    also compares the model with all records of the runs. The pages that 'rigctl compare' and 'rigctl
    diagnose' write with -o use only the records selected by --only and --hold-out.

    Examples:

      rigctl report latest

      rigctl report latest --model models/hl32-textbook.yaml --diagnose

      rigctl report 20261121-0900 20261122-0900 -o both-days.html --figures figures --format svg
    """
    _require_model(model, diagnose=diagnose, assume=assume)
    with progress_display("Reading the runs", "nothing was saved") as on_progress:
        from rigctl.cli.analysis_page import require_page
        from rigctl.cli.named_input import open_models, open_runs
        from rigctl.report import write_report

        models = open_models(model or ())
        opened = open_runs(runs, models[0] if models else None, assume)
        first, more = opened[0].id, len(opened) - 1
        target = output or Path(f"{first}-and-{more}-more.html" if more else f"{first}.html")
        require_page(target, force=force)
        sections = _analysis(opened, models, on_progress, diagnose=diagnose) if models else []
        written = write_report(
            opened,
            target,
            figures=figures,
            form=form.value,
            sections=sections,
            force=force,
            on_progress=on_progress,
        )
    if as_json:
        facts = {
            "page": written.page,
            "bytes": written.size,
            "figures": list(written.figures),
            "runs": list(written.runs),
        }
        print_json(facts)
    else:
        echo(f"Wrote {written.summary()}")


def _require_model(model: list[Path] | None, *, diagnose: bool, assume: list[str] | None) -> None:
    """Refuse options that need a model."""
    if model:
        return
    named = "Name one, e.g. --model models/hl32-textbook.yaml"
    if diagnose:
        raise RigctlError("--diagnose needs a model, and none was named", hint=named)
    if assume:
        raise RigctlError("--assume gives an input of a model, and no model was named", hint=named)


def _analysis(
    runs: list[Run], models: list[Model], on_progress: Callable[[str], None], *, diagnose: bool
) -> list[Section]:
    """What the first model lacks, how the models agree with the runs, and how their error fell."""
    from rigctl.analysis.diagnosis import diagnose_comparison
    from rigctl.cli.analysis_page import compare_with_versions
    from rigctl.report.analysis import comparison_sections, diagnosis_sections, history_sections

    comparison, versions = compare_with_versions(runs, models, on_progress=on_progress)
    compared = comparison_sections(comparison, answered=diagnose)
    path = models[-1].path
    if path is not None:
        compared += history_sections(path, versions)
    if not diagnose:
        return compared
    missing = diagnose_comparison(
        comparison.models[0], comparison.runs, notes=comparison.notes, on_progress=on_progress
    )
    return [*diagnosis_sections(missing), *compared]

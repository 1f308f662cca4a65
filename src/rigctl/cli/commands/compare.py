"""`rigctl compare`: how well a model agrees with measurements, and where it fails.

In: runs, one or several models, and FMUs to be compared with the last of them. Out: an answer for the
terminal, a page or JSON, and the command that leads on. The comparison is made by
`rigctl.analysis.comparison`, the words by `rigctl.answers`.

An FMU is no further `--model`: it has neither a parameter to fit nor a record-level unknown, so that the
tests of a model would reject even a right one for its initial values. It is shown beside the model,
without a verdict. What can be refused, a page that exists or a file that is no FMU, is refused before the
fits, which take seconds to minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import Assume, Fit, Force, HoldOut, Only, Page, Runs
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption

if TYPE_CHECKING:
    from rigctl.analysis.comparison_result import Comparison
    from rigctl.analysis.fmu_rival import FmuRival
    from rigctl.command_line import DataOptions


def compare(
    runs: Runs,
    model: Annotated[
        list[Path],
        typer.Option(
            "--model",
            "-m",
            metavar="M",
            help="Model file; M@3 is its version 3; repeatable.",
            show_default=False,
        ),
    ],
    hold_out: HoldOut = None,
    only: Only = None,
    *,
    fit: Fit = True,
    assume: Assume = None,
    rival: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FMU",
            help="FMU (FMI 2.0 or 3.0) to compare with the last model; repeatable. Its code is executed.",
            show_default=False,
        ),
    ] = None,
    rival_timeout: Annotated[
        str,
        typer.Option(metavar="TIME", help="Longest time of one simulation of a record by an FMU."),
    ] = "1 min",
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    output: Page = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compare models with measurements: how well they agree, and where they fail.

    Every error is shown relative to the noise of the data. Up to three tests decide whether a model agrees
    within it; if not, the output shows where the error occurs, its trend over the operating variables, and
    the equation that lacks a term.

    Examples:

      rigctl compare latest --model models/hl32-textbook.yaml --hold-out "oil == 60 degC"

      rigctl compare latest --model models/hl32-textbook.yaml@1 --model models/hl32-textbook.yaml
    """
    from rigctl.cli.progress import progress_display

    with progress_display("Reading the records", "nothing was saved") as on_progress:
        from rigctl.answers.comparison import comparison_answer, comparison_evidence
        from rigctl.answers.fmu_rival import rival_blocks
        from rigctl.cli.analysis_page import compare_with_versions, require_page, write_page
        from rigctl.cli.blocks import show, show_answer
        from rigctl.cli.named_input import open_models, open_runs
        from rigctl.command_line import DataOptions
        from rigctl.files.quantity import Q

        require_page(output, force=force)
        fmus = _require_fmus(rival or ())
        patience = Q("s", positive=True).read(rival_timeout)
        models = open_models(model)
        opened = open_runs(runs, models[0], assume)
        comparison, versions = compare_with_versions(
            opened,
            models,
            earlier=output is not None,
            hold_out=hold_out,
            only=only,
            refit=fit,
            on_progress=on_progress,
        )
        rivals = _rivals(fmus, comparison, on_progress, patience)
        if output is not None:
            from rigctl.report.analysis import comparison_sections, history_sections

            on_progress(f"Writing {output.as_posix()}")
            path = models[-1].path
            last = [] if path is None else history_sections(path, versions)
            write_page(opened, output, [*comparison_sections(comparison), *last], force=force)
    if as_json:
        rival_documents = {"rivals": [one.document() for one in rivals]} if rivals else {}
        print_json({**_document(comparison), **rival_documents})
    else:
        if verbose:
            show(comparison_evidence(comparison))
        else:
            show_answer(comparison_answer(comparison))
        show(block for rival in rivals for block in rival_blocks(rival))
        choice = DataOptions(only, hold_out, assume or (), family)
        _suggest_next(comparison, runs, [str(one) for one in model], choice, fit=fit)


def _document(comparison: Comparison) -> dict[str, Any]:
    """The machine-readable answer, with the residual analysis of every model."""
    from rigctl.analysis.linear.residual_analysis import residual_correlations

    document = comparison.document()
    for model, part in zip(comparison.models, document["models"], strict=True):
        found = {} if model.rows else residual_correlations(model.fit)
        part["residuals"] = {name: one.document() for name, one in found.items()}
    if len(comparison.models) == 1:
        document["residuals"] = document["models"][0]["residuals"]
    return document


def _require_fmus(written: Sequence[Path]) -> list[Path]:
    """The named FMUs; a file that is none is refused before the models are fitted."""
    if not written:
        return []
    from rigctl.analysis.fmu_rival import require_fmu
    from rigctl.project import find_file

    found = [find_file(path) for path in written]
    for path in found:
        require_fmu(path)
    return found


def _rivals(
    fmus: Sequence[Path], comparison: Comparison, on_progress: Callable[[str], None], patience: float
) -> list[FmuRival]:
    """Every FMU beside the last model."""
    from rigctl.analysis.fmu_rival import judge_fmu

    rivals = []
    for path in fmus:
        on_progress(f"Running {path.name}")
        last = comparison.models[-1]
        rivals.append(judge_fmu(path, last.fit, last.name, on_progress, patience))
    return rivals


def _suggest_next(
    comparison: Comparison, runs: list[str], models: Sequence[str], choice: DataOptions, *, fit: bool
) -> None:
    """The next command: find what the last model lacks, or make the page of all."""
    from rigctl.cli.next_command import page_of, show_next
    from rigctl.command_line import analysis

    first, *others = models
    own = [word for other in others for word in ("--model", other)] + ["--no-fit"] * (not fit)
    page = page_of("compare", runs, first, choice, *own)
    diagnosis = analysis("diagnose", runs, models[-1], choice)
    if comparison.models[-1].adequacy.unusable:
        return  # the answer says which number is to be corrected, and nothing can be found before
    if comparison.models[-1].adequate and comparison.models[-1].rows:
        show_next(diagnosis, "shows what so few values can tell, and what to measure next")
    elif comparison.models[-1].adequacy.undecided:
        show_next(diagnosis, "looks for an effect that explains so much that no noise level is needed")
    elif comparison.models[-1].adequacy.below_noise:
        show_next(page, "writes a page; a record at rest or a repeated condition would show the noise")
    elif comparison.models[-1].explained_by:
        show_next(diagnosis, "tells what would be missing if sensors and clocks were exact")
    elif comparison.models[-1].adequate:
        show_next(page, "writes a page; these data call for nothing more")
    else:
        show_next(diagnosis, "finds the missing effect")

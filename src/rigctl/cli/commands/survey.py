"""`rigctl survey`: many runs looked at with one model: what changed, since when, and how sure that is.

In: a model, and all finished runs or some of them. Out: an answer, a page, JUnit XML for a scheduler, and
with `--alarm` the exit code. `rigctl.monitoring.survey` does the work, and keeps what it has read of each
run: the survey of tomorrow reads only the runs of tomorrow.

A damaged run does not end a survey of a thousand: it is left out and named. A run that the user has
named, and that does not exist, is a mistake and ends it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import Assume, Force, OneModel, Only, Page
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.workers import Cluster, WorkerCount
from rigctl.printable import shown_path

if TYPE_CHECKING:
    from rigctl.dataset import Run


def survey(
    model: OneModel,
    runs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RUN...]",
            help="Ids, starts of ids, paths, addresses in storage, or 'all' (default).",
            show_default=False,
        ),
    ] = None,
    *,
    where: Annotated[
        str | None,
        typer.Option(
            metavar="COND",
            help="Only runs that meet this SQL condition, as for 'rigctl runs list --where'.",
            show_default=False,
        ),
    ] = None,
    by: Annotated[
        str,
        typer.Option(
            metavar="GROUP",
            help="Grouping of the data into points: run, record, day, week, month, or a column "
            "whose equal values form a group.",
        ),
    ] = "run",
    over: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Variable to order the runs by: date, order, or a record column, procedure "
            "argument or channel; by default the date if the runs have one.",
            show_default=False,
        ),
    ] = None,
    share: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER",
            help="Parameter with one common value for all runs, named as in the model file, or "
            "'all'; repeatable. The other free parameters are fitted to each run.",
            show_default=False,
        ),
    ] = None,
    effects: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Effects whose sizes are estimated, separated by commas, or 'none'; by default all "
            "that the model may lack. Fewer effects give more power.",
            show_default=False,
        ),
    ] = None,
    only: Only = None,
    assume: Assume = None,
    name: Annotated[
        bool,
        typer.Option(
            "--name/--no-name", help="Diagnose the effect that has changed, and fit its size in every run."
        ),
    ] = True,
    alarm: Annotated[
        bool, typer.Option("--alarm", help="Exit with code 1 if something has changed, for schedulers.")
    ] = False,
    junit: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Also write the result as JUnit XML test cases.", show_default=False
        ),
    ] = None,
    workers: WorkerCount = None,
    cluster: Cluster = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    output: Page = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Analyse many runs with one model: what has changed, since when, and how certain that is.

    Each run is fitted, and the size of each effect that the model may lack is estimated in it. Only
    significant changes are reported: where nothing changes, at most 1 survey in 100 reports one, whatever
    the number of runs and quantities and the scatter of single runs; a level that drifts slowly by itself
    counts as changed. A diagnosis of a run after the change determines which effect it is. Results of runs
    are kept: a survey that was interrupted, or is repeated with another run, reuses them. A run that cannot
    be read is reported and skipped.

    Examples:

      rigctl survey --model models/hl32-textbook.yaml -o survey.html

      rigctl survey all --where "started >= '2026-01-01'" --model models/pump.yaml --share delivery \\
        --effects none --over oil_temperature --alarm --junit survey.xml
    """
    from rigctl.cli.progress import progress_display

    message = (
        "nothing was saved"
        if no_cache
        else "what has been read is kept, and the same command continues from there"
    )
    with progress_display("Reading the runs", message) as on_progress:
        from rigctl.answers.survey import survey_answer, survey_evidence
        from rigctl.cli.analysis_page import require_page
        from rigctl.cli.blocks import show_answer
        from rigctl.cli.named_input import open_models
        from rigctl.dataset.outputs import require_output
        from rigctl.errors import ExitCode
        from rigctl.monitoring.survey import survey as surveyed
        from rigctl.tasks import Workers

        at = Workers(workers, cluster=cluster)
        require_page(output, force=force)
        if junit is not None:
            require_output(junit, force=force)
        (opened,) = open_models([model])
        measured, damaged = _opened(runs or ["all"], where)
        result = surveyed(
            measured,
            opened,
            by=by,
            over=over,
            share=share or (),
            effects=None if effects is None else [one.strip() for one in effects.split(",") if one.strip()],
            only=only,
            assume=assume or (),
            name=name,
            notes=damaged,
            workers=at,
            on_progress=on_progress,
        )
        if output is not None:
            from rigctl.report.analysis.survey import write_survey_page

            write_survey_page(result, opened.rig.name if opened.rig else "", output, force=force)
        if junit is not None:
            from rigctl.report.survey_junit import write_junit

            write_junit(result, junit)
    if as_json:
        print_json(result.document())
    else:
        written = [path for path in (output, junit) if path is not None]
        show_answer(survey_answer(result, written), survey_evidence(result) if verbose else ())
    if alarm and result.verdict == "changed":
        raise typer.Exit(int(ExitCode.FAILED))


def _opened(written: list[str], where: str | None) -> tuple[list[Run], list[str]]:
    """The named runs, for ``all`` every finished one; and notes on those that are damaged."""
    from rigctl.dataset import list_runs, open_run
    from rigctl.dataset.run_json import RUNNING
    from rigctl.errors import ExitCode, RigctlError

    named = written != ["all"]
    if named and where is not None:
        raise RigctlError("--where chooses among all runs", value=" ".join(written), expected="all")
    references = written
    if not named:
        listed = list_runs(where=where)
        references = [shown_path(one.folder) for one in listed if one.status not in (RUNNING, "unclosed")]
    runs: dict[str, Run] = {}
    damaged: list[RigctlError] = []
    for reference in references:
        try:
            run = open_run(reference)
        except RigctlError as problem:
            if named and problem.exit_code is not ExitCode.FAILED:
                raise
            damaged.append(problem)
        else:
            runs[run.id] = run
    if not runs and damaged:
        raise damaged[0]
    if not runs:
        raise RigctlError("there is no run to survey", hint="'rigctl runs list' shows the available runs")
    return list(runs.values()), [f"left out: {problem}" for problem in damaged]

"""`rigctl survey`: many runs looked at with one model: what changed, since when, and how sure that is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.compare import Assume, Force, OneModel, Only, Page
from rigctl.cli.family import FamilyOption
from rigctl.cli.reuse import NoCache, Verbose
from rigctl.cli.workers import Cluster, WorkerCount

if TYPE_CHECKING:
    from rigctl.dataset import Run


def survey(
    model: OneModel,
    runs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RUN...]",
            help="Ids, starts of ids, paths, addresses in storage, or 'all', the default.",
            show_default=False,
        ),
    ] = None,
    *,
    where: Annotated[
        str | None,
        typer.Option(
            metavar="COND",
            help="Of all runs only those that meet this condition, as of 'rigctl runs list --where'.",
            show_default=False,
        ),
    ] = None,
    by: Annotated[
        str,
        typer.Option(
            metavar="GROUP",
            help="What is one point: run, record, day, week, month, or a column whose equal values belong "
            "together.",
        ),
    ] = "run",
    over: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What it is looked at over: date, order, or a column, an argument or a channel. The date, "
            "where the runs have one.",
            show_default=False,
        ),
    ] = None,
    share: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER",
            help="A parameter that all runs have in common, as the model file has it; 'all' for every one; "
            "repeatable. The others that the file frees are fitted in each run.",
            show_default=False,
        ),
    ] = None,
    effects: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Effects whose sizes are looked at, separated by commas, or 'none'; all that the model may "
            "lack if left out. Fewer are surer.",
            show_default=False,
        ),
    ] = None,
    only: Only = None,
    assume: Assume = None,
    name: Annotated[
        bool, typer.Option("--name/--no-name", help="Diagnose what has changed, and fit it in every run.")
    ] = True,
    alarm: Annotated[
        bool, typer.Option("--alarm", help="Exit code 1 where something has changed, for schedulers.")
    ] = False,
    junit: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also write it as test cases in JUnit's XML.", show_default=False),
    ] = None,
    workers: WorkerCount = None,
    cluster: Cluster = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Verbose = False,
    output: Page = None,
    force: Force = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Look at many runs with one model: what has changed over them, since when, and how sure that is.

    Each run is fitted, and the size of each effect that the model may lack is estimated in it. A change is
    told where it is no chance: in 1 of 100 surveys at most where nothing changes, however many runs and
    quantities were looked at, and however far single runs scatter. What it is, a diagnosis of a run after the
    change says. Results of runs are kept: a survey that was stopped, or is asked again with a run more, goes
    on with what is there. A run that cannot be read is told, and left out.

    Examples:

      rigctl survey --model models/hl32-textbook.yaml -o survey.html

      rigctl survey all --where "started >= '2026-01-01'" --model models/pump.yaml --share delivery \\
        --effects none --over oil_temperature --alarm --junit survey.xml
    """
    from rigctl.cli.analysis_page import require_page
    from rigctl.cli.compare import open_models
    from rigctl.cli.survey_views import show_survey
    from rigctl.cli.tables import print_json
    from rigctl.cli.telling import telling
    from rigctl.dataset.outputs import require_output
    from rigctl.errors import ExitCode
    from rigctl.survey.survey import survey as surveyed
    from rigctl.tasks import Workers

    at = Workers(workers, cluster=cluster)
    require_page(output, force=force)
    if junit is not None:
        require_output(junit, force=force)
    (opened,) = open_models([model])
    with telling("what was read is kept, and the same command goes on with it") as on_progress:
        measured, damaged = _opened(runs or ["all"], where)
        found = surveyed(
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

        write_survey_page(found, opened.rig.name if opened.rig else "", output, force=force)
    if junit is not None:
        from rigctl.survey.junit import write_junit

        write_junit(found, junit)
    if as_json:
        print_json(found.document())
    else:
        show_survey(found, [path for path in (output, junit) if path is not None])
    if alarm and found.verdict == "changed":
        raise typer.Exit(int(ExitCode.FAILED))


def _opened(written: list[str], where: str | None) -> tuple[list[Run], list[str]]:
    """The runs that are named, of ``all`` those that are over; and which of them are damaged, in words."""
    from rigctl.dataset import list_runs, open_run
    from rigctl.dataset.run_json import RUNNING
    from rigctl.errors import ExitCode, RigctlError

    named = written != ["all"]
    if named and where is not None:
        raise RigctlError("--where chooses among all runs", value=" ".join(written), expected="all")
    references = written
    if not named:
        listed = list_runs(where=where)
        references = [str(one.folder) for one in listed if one.status not in (RUNNING, "unclosed")]
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
        raise RigctlError("there is no run to survey", hint="'rigctl runs list' shows those that there are")
    return list(runs.values()), [f"left out: {problem}" for problem in damaged]

"""`rigctl discover`: a term that no effect of the library provides: its location, curve and formulas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import AsPage, Assume, HoldOut, OneModel, Only, Runs
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.workers import Cluster

if TYPE_CHECKING:
    from rigctl.command_line import DataOptions
    from rigctl.dataset import Run
    from rigctl.discovery.result import Discovery


def discover(
    runs: Runs,
    model: OneModel,
    hold_out: HoldOut = None,
    only: Only = None,
    *,
    slot: Annotated[
        str | None,
        typer.Option(
            metavar="SLOT",
            help="Search only at this location in the equations; 'rigctl effects list --slots' lists them.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Folder for an effect file of each formula that predicts the records it was not "
            "fitted to. Existing files are kept.",
            show_default=False,
        ),
    ] = None,
    page: AsPage = None,
    force: Annotated[
        bool, typer.Option("--force", help="Let --page replace a file that is not a page of rigctl.")
    ] = False,
    cluster: Cluster = None,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Search for a formula of the missing term where no effect of the library is certain to be it.

    A diagnosis is made first; if the library has the answer, or these data cannot show whether anything is
    missing, no search is made. Otherwise the result is the location of the missing term in the equations,
    the variables that it depends on, the term as a curve with its band, and all formulas that these data
    cannot distinguish from the best.

    Examples:

      rigctl discover latest --model models/hl32-textbook.yaml

      rigctl discover latest --model models/hl32-textbook.yaml --slot friction -o effects/
    """
    from rigctl.cli.progress import progress_display

    with progress_display("Reading the records", "no further file was written") as on_progress:
        from rigctl.answers.discovery import discovery_answer, discovery_evidence
        from rigctl.cli.analysis_page import require_page
        from rigctl.cli.blocks import show_answer
        from rigctl.cli.named_input import open_models, open_runs
        from rigctl.command_line import DataOptions
        from rigctl.dataset.outputs import require_folder
        from rigctl.discovery.discover import discover as discovered
        from rigctl.discovery.discover import require_slot
        from rigctl.discovery.written_effects import write_files
        from rigctl.tasks import Workers

        if output is not None:
            require_folder(output)
        require_page(page, force=force)
        (opened,) = open_models([model])
        require_slot(opened.family, slot)
        choice = DataOptions(only, hold_out, assume or (), family)
        measured = open_runs(runs, opened, choice.assume)
        discovery = discovered(
            measured,
            opened,
            hold_out=hold_out,
            only=only,
            slot=slot,
            workers=Workers(cluster=cluster) if cluster is not None else None,
            on_progress=on_progress,
        )
        if output is not None:
            discovery = write_files(discovery, output)
        if page is not None:
            on_progress(f"Writing {page.as_posix()}")
            _write_page(measured, page, discovery, force=force)
    if as_json:
        print_json(discovery.document())
    else:
        evidence = discovery_evidence(discovery) if verbose else ()
        show_answer(discovery_answer(discovery), evidence)
        _suggest_next(discovery, runs, model.as_posix(), choice, slot, saved=output is not None)


def _write_page(runs: list[Run], page: Path, discovery: Discovery, *, force: bool) -> None:
    """The search first, then the diagnosis on which it is based."""
    from rigctl.cli.analysis_page import write_page
    from rigctl.report.analysis import diagnosis_sections, discovery_sections
    from rigctl.report.section import folded

    began = folded(diagnosis_sections(discovery.diagnosis))
    write_page(runs, page, [*discovery_sections(discovery), *began], force=force)


def _suggest_next(
    discovery: Discovery, runs: list[str], model: str, choice: DataOptions, slot: str | None, *, saved: bool
) -> None:
    """The next command: diagnose, save the formulas, or add the first of them."""
    from rigctl.cli.next_command import show_next
    from rigctl.command_line import analysis, command

    accepted = [one for one in discovery.formulas if one.accepted]
    if discovery.gate.reason == "library":
        show_next(
            analysis("diagnose", runs, model, choice), "shows which effect it is, and how certain that is"
        )
    elif accepted and accepted[0].file is not None:
        words = ["model", "add", model, accepted[0].file.as_posix(), *runs, "--fit-shapes"]
        show_next(command(words, choice), "adds the first of them as the model's next version")
    elif accepted and not saved:
        own = ["--slot", slot] if slot is not None else []
        again = analysis("discover", runs, model, choice, *own)
        show_next(f"{again} -o effects", "writes them as effect files, for 'model add' and 'compare'")
    else:
        agrees = discovery.gate.reason == "adequate"
        draws = "writes a page" if agrees else "plots where the model fails"
        show_next(f"{analysis('compare', runs, model, choice)} -o page.html", draws)

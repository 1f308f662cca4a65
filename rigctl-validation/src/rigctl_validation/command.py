"""`rigctl validate`: how often the diagnosis is right, on campaigns of a bench that hides something."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.workers import Cluster, WorkerCount
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.tasks import Workers
    from rigctl_validation.figures import Figures
    from rigctl_validation.outcome import AnyTrial, TrialOutcome
    from rigctl_validation.parallel import Work
    from rigctl_validation.tier_definition import TierDefinition


class TierName(StrEnum):
    """Tier of the benchmark."""

    QUICK = "quick"
    FULL = "full"
    ANYONE = "anyone"
    MOVING = "moving"
    COVERAGE = "coverage"
    REAL = "real"
    SHAPE = "shape"
    DISCOVERY = "discovery"
    DESIGN = "design"
    DEVICES = "devices"


def validate(
    tier: Annotated[
        TierName,
        typer.Option(
            help="quick takes minutes, full hours; anyone: ten small benches; moving: the same benches, "
            "never at rest, with noise of every colour; coverage: their sensors and guesses are as wrong as "
            "stated; real: published logs of real benches; shape: laws "
            "other than the library's; discovery: terms that are in no library, and formulas for them; "
            "design: predicted power of designed records, and their results; devices: the separate bench "
            "read by one device and by several."
        ),
    ] = TierName.QUICK,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the results.")] = Path("validation"),
    first: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Number of trials, a representative sample of all.", show_default=False
        ),
    ] = None,
    reuse: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Earlier results: the amplitudes and similarities of effects, which do not depend on the "
            "search and its decisions, are taken from there.",
            show_default=False,
        ),
    ] = None,
    workers: WorkerCount = None,
    cluster: Cluster = None,
    *,
    resume: Annotated[bool, typer.Option("--resume", help="Continue with the existing results.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Measure how often the diagnosis is right, on campaigns of a separate bench with hidden effects.

    That bench shares no equation and no integrator with the models under test, and its hidden effects have
    shapes other than the library's. The tier anyone has ten small benches instead, each with family, rig and
    model as a user writes them, tested from a CSV file to the verdict; the tier moving has twins of them that
    never rest, with white, correlated, 1/f and drifting noise that the rig file states, does not state or
    states wrongly, and logs with which no verdict can be right; the tier coverage has these twins with
    sensors and guesses that are wrong by as much as is stated of them, and counts the intervals that hold
    the true values; the tier real has seven published logs of
    real benches, whole and cut, in the folder that RIGCTL_REAL_DATA names; the tier shape has effects of up
    to 1000 sigmas with laws far from the library's, alone, in pairs, and removed from the library; the tier
    discovery plants terms that are in no library, and searches for their formulas; the tier design runs
    'learn' on that bench, and compares the predicted power of designed records with the results; the tier
    devices reads that bench by one device and by four, of other rates, ages and clocks, and compares the
    answers. Every
    finished trial is kept: after a kill, --resume continues. The tables are also written into the folder, as
    Markdown.

    Example: rigctl validate --tier quick
    """
    from rigctl.files.write import write_text
    from rigctl.tasks import Workers
    from rigctl_validation.tables import page

    if out.exists() and not out.is_dir():
        raise RigctlError("a file is there", value=str(out), expected="the name of a folder")
    chosen = Workers(workers, cluster=cluster)
    figures, path = _carried_out(tier, out, first, chosen, resume=resume, reuse=reuse)
    command = f"rigctl validate --tier {tier.value}" + (f" --first {first}" if first is not None else "")
    command += f" --reuse {reuse}" if reuse is not None else ""
    write_text(out / f"{tier.value}.md", page(figures, command))
    if as_json:
        print_json({"command": command, "results": path.as_posix(), **figures.document()})
    else:
        _show(figures, path)


def _carried_out(
    tier: TierName, out: Path, first: int | None, workers: Workers, *, resume: bool, reuse: Path | None
) -> tuple[Figures, Path]:
    """The figures of the tier's trials, and the file that keeps every one of them."""
    from rigctl.files.write import write_text
    from rigctl_validation.tier_definition import tier_definition

    if tier is TierName.REAL:
        from rigctl_validation.real.logs import data_folder

        data_folder()  # one message instead of one for each trial
    path = out / f"{tier.value}.jsonl"
    definition = tier_definition(tier.value)
    trials = definition.trials[:first]
    version = _version(tier)
    work = definition.carry_out if reuse is None else _reusing(definition, tier, reuse)
    outcomes = _outcomes(trials, work, path, definition.read, workers, version=version, resume=resume)
    if tier is TierName.DESIGN:
        from rigctl_validation.designed.picture import calibration_svg
        from rigctl_validation.designed.rates import calibration_bins

        write_text(out / "predicted-power.svg", calibration_svg(tuple(calibration_bins(outcomes))))
    return definition.figures(outcomes), path


def _reusing(
    definition: TierDefinition[AnyTrial], tier: TierName, file: Path
) -> Callable[[AnyTrial], TrialOutcome[AnyTrial]]:
    """The work on a trial, with what does not depend on the search taken from a file."""
    from rigctl.errors import Location
    from rigctl_validation.store import every_outcome

    if definition.reusing is None:
        raise RigctlError(
            f"the tier {tier.value} has nothing that could be reused",
            value=f"--reuse {file.as_posix()}",
            expected="the tier quick, full or shape",
        )
    if not file.is_file():
        raise RigctlError("no such file", expected="results, DIR/TIER.jsonl", where=Location(file))
    trials = {trial.name for trial in definition.trials}
    earlier = {
        one.scenario.name: one
        for one in every_outcome(file, definition.read)
        if one.scenario.name in trials and not one.failure
    }
    if not earlier:
        raise RigctlError(f"no results of the tier {tier.value}", where=Location(file))
    return definition.reusing(earlier)


def _version(tier: TierName) -> str:
    """The version of the results of a tier: of the method and, for searches, of the discovery."""
    from rigctl.method_version import DISCOVERY_VERSION, METHOD_VERSION

    searched = f", discovery {DISCOVERY_VERSION}" if tier is TierName.DISCOVERY else ""
    return f"method {METHOD_VERSION}{searched}"


def _outcomes(
    trials: Sequence[AnyTrial],
    work: Work[AnyTrial],
    path: Path,
    read: Callable[[Mapping[str, Any]], AnyTrial],
    workers: Workers,
    *,
    version: str,
    resume: bool,
) -> Sequence[TrialOutcome[AnyTrial]]:
    from rigctl.cli.progress import progress_display
    from rigctl_validation.parallel import run_scenarios
    from rigctl_validation.store import ResultStore

    store = ResultStore(path, version, read)
    if not resume and store.outcomes(trials):
        raise RigctlError(
            "results of this version are there already",
            value=path.as_posix(),
            hint="'--resume' continues them, another '--out' starts afresh",
        )

    def stopped() -> str:
        if not store.outcomes(trials):
            return "no trial was finished"
        return "every finished trial is kept, and '--resume' continues"

    with progress_display("Preparing the trials", stopped) as report:
        return run_scenarios(
            trials, work, store, workers=workers, progress=lambda standing: report(str(standing))
        )


def _show(figures: Figures, path: Path) -> None:
    from rich.markup import escape

    from rigctl.cli.tables import console
    from rigctl_validation.tables import confusion_table, left_out_text, listing_table, rates_table

    screen = console()
    screen.print(rates_table(figures))
    screen.print(listing_table(figures) if figures.listing else confusion_table(figures))
    for line in left_out_text(figures):
        screen.print(escape(line), soft_wrap=True)
    screen.print(f"Every trial: {escape(path.as_posix())}", soft_wrap=True)

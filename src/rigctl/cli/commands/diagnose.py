"""`rigctl diagnose`: which physical effect a model lacks, how certain that is, and adding it.

In: runs and one model. Out: the verdict with its evidence; with `--apply` the model's next versions, one
for each addition; on request a page, a design of the next measurement, and files of the laws that the
data suggest. The method is in `rigctl.analysis.diagnosis` and `improve`, the words in `rigctl.answers`.

The longest part of this module is `_suggest_next`, the one command that leads on from a verdict. It is
chosen here, above the analysis, because it is a matter of commands: it repeats the runs and options that
were typed, so that the line can be copied. Its cases are in order, the first that holds decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import Assume, Force, HoldOut, OneModel, Only, Page, Runs
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.workers import Cluster

if TYPE_CHECKING:
    from rigctl.analysis.comparison_result import Comparison
    from rigctl.analysis.diagnosis_result import Diagnosis
    from rigctl.analysis.improve import Improvement
    from rigctl.command_line import DataOptions
    from rigctl.dataset import Run
    from rigctl.design.result import DesignResult
    from rigctl.tasks import Workers


#: largest number of effects that are added by default
_MOST = 4


def diagnose(
    runs: Runs,
    model: OneModel,
    hold_out: HoldOut = None,
    only: Only = None,
    *,
    apply: Annotated[
        bool,
        typer.Option(
            "--apply",
            help="Add what is missing, step by step, until the model agrees or nothing helps. Each "
            "step is saved as the model's next version.",
        ),
    ] = False,
    most: Annotated[
        int,
        typer.Option(
            "--max-effects",
            metavar="N",
            min=1,
            help="Maximum number of effects to add with --apply; 1 excludes pairs of effects.",
        ),
    ] = _MOST,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    laws: Annotated[
        Path | None,
        typer.Option(
            "--laws",
            metavar="FOLDER",
            help="Folder for the laws that the data suggest where they differ from those of the "
            "library, one effect file for each; nothing is overwritten.",
            show_default=False,
        ),
    ] = None,
    design: Annotated[
        bool,
        typer.Option(
            "--design",
            help="Also design the next measurement, as 'rigctl design' does, where a question remains open.",
        ),
    ] = False,
    repetitions: Annotated[
        int,
        typer.Option(
            "--bootstrap",
            metavar="N",
            min=0,
            help="Also give confidence intervals that do not depend on the noise model, from N fits "
            "to resampled data (wild bootstrap); 200 are enough. Not with --apply.",
        ),
    ] = 0,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Number of processes for --bootstrap; by default one per core.",
            show_default=False,
        ),
    ] = None,
    cluster: Cluster = None,
    output: Page = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find out which effect a model lacks, how certain that is, and which effects cannot be distinguished
    from it.

    The verdict is one of: adequate (nothing is missing), missing_effect, ambiguous (several explain it, and
    these data cannot distinguish them) and outside_library. It never names a winner that the data do not
    support.

    Examples:

      rigctl diagnose latest --model models/hl32-textbook.yaml

      rigctl diagnose latest --model models/hl32-textbook.yaml --apply --hold-out "oil == 60 degC"
    """
    from rigctl.cli.progress import progress_display

    message = "the steps saved so far are kept" if apply else "nothing was saved"
    with progress_display("Reading the records", message) as on_progress:
        from rigctl.analysis.diagnosis import diagnose_comparison
        from rigctl.analysis.improve import improve
        from rigctl.answers.documents import diagnosis_document, improvement_document
        from rigctl.cli.named_input import open_runs
        from rigctl.command_line import DataOptions
        from rigctl.project import own_model
        from rigctl.tasks import Workers

        _require_no_apply(apply, design=design, bootstrap=bool(repetitions))
        _require_bootstrap(repetitions, workers=workers, cluster=cluster)
        at = Workers(workers, cluster=cluster)
        _require_places(output, laws, force=force)
        limit = ["--max-effects", str(most)] if most != _MOST else []
        path = own_model(model) if apply else model
        choice = DataOptions(only, hold_out, assume or (), family)
        compared = _compared(runs, path, choice, on_progress, resampled=bool(repetitions))
        if apply:
            done = improve(compared, path, most=most, on_progress=on_progress)
        else:
            (before,) = compared.models
            diagnosis = diagnose_comparison(
                before, compared.runs, compared.held_out, compared.notes, most=most, on_progress=on_progress
            )
            diagnosis = _with_intervals(diagnosis, repetitions, at, on_progress)
        next_one = None
        if design:  # imports all kinds of steps, and is rarely needed
            from rigctl.design.design import with_next_experiment

            diagnosis, next_one = with_next_experiment(diagnosis, open_runs(runs), on_progress=on_progress)
        if apply:
            done = replace(done, last=_with_files(done.last, laws))
        else:
            diagnosis = _with_files(diagnosis, laws)
        if output is not None:
            on_progress(f"Writing {output.as_posix()}")
            _write_page(
                open_runs(runs), output, compared, done if apply else diagnosis, path, next_one, force=force
            )
    if as_json:
        print_json(improvement_document(done) if apply else diagnosis_document(diagnosis))
    elif apply:
        _show(done if done.steps or verbose else done.last, verbose=verbose)
        _suggest_next(done.last, runs, model.as_posix(), choice, limit)
    else:
        _show(diagnosis, verbose=verbose)
        if next_one is not None:
            from rigctl.answers.design.design import design_answer, whole_design
            from rigctl.cli.blocks import show, show_answer

            show(whole_design(next_one)) if verbose else show_answer(design_answer(next_one))
        shown = ["--design"] * design + ["--bootstrap", str(repetitions)] * bool(repetitions)
        _suggest_next(diagnosis, runs, model.as_posix(), choice, limit, shown)


def _show(result: Diagnosis | Improvement, *, verbose: bool) -> None:
    """Show the answer; with `verbose` all that it rests on."""
    from rigctl.analysis.improve import Improvement
    from rigctl.answers.diagnosis import diagnosis_answer, whole_diagnosis
    from rigctl.answers.improvement import improvement_answer, improvement_evidence
    from rigctl.cli.blocks import show, show_answer

    if isinstance(result, Improvement):
        show(improvement_evidence(result)) if verbose else show_answer(improvement_answer(result))
    else:
        show(whole_diagnosis(result)) if verbose else show_answer(diagnosis_answer(result))


def _require_no_apply(apply: bool, **others: bool) -> None:
    """Refuse options of a single diagnosis together with one that makes several."""
    from rigctl.errors import RigctlError

    for name, given in others.items():
        if apply and given:
            again = "rigctl design" if name == "design" else f"rigctl diagnose --{name}"
            raise RigctlError(f"--{name} and --apply do not go together", hint=f"'{again}' after --apply")


def _require_bootstrap(repetitions: int, **distributing: object) -> None:
    """Refuse options that distribute the bootstrap where none is requested."""
    from rigctl.errors import RigctlError

    for name, given in distributing.items():
        if given is not None and not repetitions:
            raise RigctlError(
                f"--{name} is for --bootstrap, which was not given", hint="Add '--bootstrap 200'"
            )


def _require_places(page: Path | None, laws: Path | None, *, force: bool) -> None:
    """Refuse a page or a folder that could not be written, before any work is done."""
    from rigctl.cli.analysis_page import require_page
    from rigctl.dataset.outputs import require_folder

    require_page(page, force=force)
    if laws is not None:
        require_folder(laws)


def _with_intervals(
    diagnosis: Diagnosis, repetitions: int, at: Workers, on_progress: Callable[[str], None]
) -> Diagnosis:
    """The diagnosis with intervals for the parameters of its final model, if requested."""
    from rigctl.analysis.bootstrap import bootstrap

    if not repetitions:
        return diagnosis
    return replace(
        diagnosis, bootstrap=bootstrap(diagnosis.best.fit, repetitions, workers=at, on_progress=on_progress)
    )


def _with_files(diagnosis: Diagnosis, folder: Path | None) -> Diagnosis:
    """The diagnosis with the effect files of its laws, where it has any and they are requested."""
    from rigctl.analysis.laws.effect_file import write_law

    if folder is None:
        return diagnosis
    written = tuple(write_law(one, folder, diagnosis.runs, diagnosis.model) for one in diagnosis.laws)
    return replace(diagnosis, laws=written)


def _suggest_next(
    diagnosis: Diagnosis,
    runs: list[str],
    model: str,
    choice: DataOptions,
    limit: Sequence[str],
    shown: Sequence[str] = (),
) -> None:
    """The next command: add what is missing, show where nothing helps, or make the page.

    `limit` are the words of the options on which the diagnosis depends, `shown` those of what only a page of
    it would lack without them.
    """
    from rigctl.analysis.diagnosis_result import Verdict
    from rigctl.cli.next_command import page_of, show_next
    from rigctl.command_line import analysis
    from rigctl.command_line import command as command_text
    from rigctl.discovery.gate import gate_of

    again = analysis("diagnose", runs, model, choice, *limit)
    gate = gate_of(diagnosis)
    # two effects that may only imitate what is missing: the law of either is of no use
    imitating = (gate.open and len(diagnosis.effects) > 1) or bool(diagnosis.certain_besides)
    if not imitating and _law_first(diagnosis, runs, model, choice, again):
        return
    if diagnosis.next_steps and diagnosis.verdict is not Verdict.MISSING_EFFECT:
        command = page_of("diagnose", runs, model, choice, *limit, *shown)
        show_next(command, "writes a page, with what to measure next")
    elif diagnosis.verdict is Verdict.UNDECIDED and diagnosis.before.bounded:
        show_next(again, "looks again, once the bound is wider")
    elif diagnosis.doubt or diagnosis.verdict is Verdict.UNDECIDED:
        command = page_of("compare", runs, model, choice)
        show_next(command, "writes a page; a record at rest or a repeated condition would show the noise")
    elif diagnosis.before.explained_by and not diagnosis.effects:
        page = page_of("diagnose", runs, model, choice, *limit, *shown)
        _tell_sensor_from_effect(diagnosis, analysis("design", runs, model, choice), page)
    elif diagnosis.verdict is Verdict.ADEQUATE:
        command = page_of("compare", runs, model, choice)
        show_next(command, "writes a page; these data call for nothing more")
    elif diagnosis.verdict is Verdict.AMBIGUOUS and any(len(names) > 1 for names in diagnosis.classes):
        command = analysis("design", runs, model, choice)
        show_next(f"{command} -o next.yaml", "designs the records that would distinguish them")
    elif gate.open:
        command = analysis("discover", runs, model, choice)
        show_next(command, "looks for a formula where no effect of the library fits")
    elif diagnosis.certain_besides:
        add = command_text(["model", "add", model, diagnosis.certain_besides[0], *runs], choice)
        show_next(add, "adds what is certain; a diagnosis of that version looks for the rest")
    elif diagnosis.best.candidates:
        likely = ", the most probable, but these data cannot decide" * (
            diagnosis.verdict is Verdict.AMBIGUOUS
        )
        show_next(f"{again} --apply", f"adds {diagnosis.best.effects[0]} as the model's next version{likely}")
    else:
        command = analysis("compare", runs, model, choice)
        why = "plots where it fails; 'rigctl effects check FILE' checks your own effect"
        show_next(f"{command} -o page.html", why)


def _tell_sensor_from_effect(diagnosis: Diagnosis, design: str, page: str) -> None:
    """The next command where errors of sensors explain what the model leaves."""
    from rigctl.cli.next_command import show_next
    from rigctl.command_line import command

    sensors, rig = diagnosis.before.sensors, diagnosis.before.fit.problem.measurements.rig
    if diagnosis.instead_of_sensors:
        show_next(f"{design} -o next.yaml", "designs the records that would tell an effect from a sensor")
    elif (
        diagnosis.before.adequacy.only_misread and sensors is not None and sensors.misread and rig is not None
    ):
        of_rig = ["--rig", rig.path.as_posix()] if rig.path else []
        show_next(command(["calibrate", sensors.misread[0].channel, *of_rig]), "calibrates the sensor again")
    else:
        show_next(page, "writes a page, with what would tell the error of a sensor or clock from the model")


def _law_first(diagnosis: Diagnosis, runs: list[str], model: str, choice: DataOptions, again: str) -> bool:
    """If the data suggest another law of an effect: write it, or add what was written."""
    from rigctl.cli.next_command import show_next
    from rigctl.command_line import DataOptions, command

    laws = [one for one in diagnosis.laws if one.offered]
    if not laws:
        return False
    first = laws[0]
    if first.file is None:
        show_next(f"{again} --laws effects", "writes the law that the data suggest as an effect file")
        return True
    present = first.effect in diagnosis.before.fit.problem.model.effects
    shapes = ["--fit-shapes"] if first.offered == "power" else []
    add = command(["model", "add", model, first.file.as_posix(), *runs, *shapes], choice)
    remove = command(["model", "remove", model, first.effect], DataOptions(family=choice.family))
    instead = f" in place of {first.effect}" * present
    fitted = "exponent" if first.offered == "power" else "factor"
    show_next(
        f"{remove}\n{add}" if present else add,
        f"adds it{instead} with its {fitted} fitted, and reports the error before and after",
    )
    return True


def _write_page(
    runs: list[Run],
    output: Path,
    compared: Comparison,
    result: Diagnosis | Improvement,
    path: Path,
    next_one: DesignResult | None,
    *,
    force: bool,
) -> None:
    """The diagnosis first, with the next measurement or the additions; then the comparison."""
    from rigctl.analysis.improve import Improvement
    from rigctl.cli.analysis_page import write_page
    from rigctl.report.analysis import (
        comparison_sections,
        design_sections,
        diagnosis_sections,
        improvement_sections,
    )

    if isinstance(result, Improvement):
        sections = improvement_sections(compared, result, path)
    else:
        designed = [] if next_one is None else design_sections(next_one)
        sections = [*diagnosis_sections(result), *designed, *comparison_sections(compared, answered=True)]
    write_page(runs, output, sections, force=force)


def _compared(
    runs: list[str],
    path: Path,
    choice: DataOptions,
    on_progress: Callable[[str], None],
    *,
    resampled: bool,
) -> Comparison:
    """The model fitted to the runs; one without free parameters is refused before any work, and a fit that is
    to be `resampled` and cannot be before the diagnosis."""
    from rigctl.analysis.bootstrap import require_resampling
    from rigctl.analysis.comparison import compare
    from rigctl.analysis.fitting import require_free_parameters
    from rigctl.cli.named_input import open_models, open_runs

    (model,) = open_models([path])
    require_free_parameters(model)
    opened = open_runs(runs, model, choice.assume)
    compared = compare(opened, [model], hold_out=choice.hold_out, only=choice.only, on_progress=on_progress)
    if resampled:
        require_resampling(compared.models[0].fit)
    return compared

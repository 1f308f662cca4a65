"""`rigctl frequency`: the frequency response that records show, with coherence, beside a model's.

In: runs, optionally an input, a channel and a model. Out: an answer for each pair of input and channel, a
page with Bode plots, or JSON; `rigctl.analysis.frequency_response` estimates them. With a model, its
response is estimated from its simulation of the same records in the same way, and not computed from a
linearisation: only then do errors of the estimation, such as leakage, appear in both.

Whether the two differ is no verdict on the model; that is for `rigctl compare`, which knows the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import Assume, Fit, Force, Page, Runs, check_condition
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption

if TYPE_CHECKING:
    from rigctl.analysis.frequency_response import FrequencyResponse
    from rigctl.dataset import Run


def frequency(
    runs: Runs,
    input_name: Annotated[
        str | None,
        typer.Option(
            "--input",
            "-i",
            metavar="NAME",
            help="Actuator or channel that excites; by default every actuator that moves.",
            show_default=False,
        ),
    ] = None,
    output_name: Annotated[
        str | None,
        typer.Option(
            "--channel",
            "-c",
            metavar="NAME",
            help="Channel that answers; by default every channel.",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            "-m",
            metavar="M",
            help="Model file whose response is shown beside the measured one.",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(
            "--only",
            metavar="EXPR",
            callback=check_condition,
            help="Records to use, e.g. 'record == 2'; with --model as for 'rigctl compare'.",
            show_default=False,
        ),
    ] = None,
    resolution: Annotated[
        str | None,
        typer.Option(
            metavar="FREQUENCY",
            help="Distance between lines, from windows. By default whole periods are used if the records are "
            "periodic, and otherwise windows that give 16 averages.",
            show_default=False,
        ),
    ] = None,
    *,
    fit: Fit = True,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    output: Page = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measure how a channel follows an actuator over frequency: magnitude, phase, coherence, intervals.

    The model's response is estimated from its simulation of the same records, in the same way as the measured
    one. Only lines at which the input has enough power are used, and those without a significant coherence
    are not shown. The page has Bode plots.

    Examples:

      rigctl frequency latest --input heater_1 --channel temperature_1 -o bode.html

      rigctl frequency latest --input heater_1 --model models/heater-board.yaml
    """
    from rigctl.cli.progress import progress_display

    with progress_display("Reading the records", "nothing was saved") as on_progress:
        from rigctl.answers.frequency_response import (
            frequency_answer,
            frequency_documents,
            frequency_evidence,
            shown_and_not,
        )
        from rigctl.cli.analysis_page import require_page, write_page
        from rigctl.cli.blocks import show, show_answer
        from rigctl.cli.next_command import show_next
        from rigctl.command_line import DataOptions, analysis
        from rigctl.files.quantity import Q

        require_page(output, force=force)
        step = None if resolution is None else Q("Hz", positive=True).read(resolution)
        asked = (input_name, output_name, only, step)
        opened, found = _found(runs, model, asked, assume, on_progress, fit=fit)
        if output is not None:
            from rigctl.report.analysis import frequency_sections

            on_progress(f"Writing {output.as_posix()}")
            write_page(opened, output, frequency_sections(found), force=force)
    if as_json:
        print_json({"runs": [run.id for run in opened], "responses": frequency_documents(found)})
        return
    shown, rest = shown_and_not(found)
    for one in shown:
        show_answer(frequency_answer(one), frequency_evidence(one) if verbose else ())
    show(rest)
    if model is not None and any(one.worst is not None for one in found):
        choice = DataOptions(only, None, assume or (), family)
        show_next(analysis("diagnose", runs, str(model), choice), "looks for what the model lacks")


def _found(
    written: Sequence[str],
    path: Path | None,
    asked: tuple[str | None, str | None, str | None, float | None],
    assume: Sequence[str] | None,
    on_progress: Callable[[str], None],
    *,
    fit: bool,
) -> tuple[list[Run], list[FrequencyResponse]]:
    """The runs, and their responses to what was asked: input, output, condition and resolution."""
    from rigctl.analysis.frequency_response import frequency_responses, responses_of_fit
    from rigctl.cli.named_input import open_models, open_runs
    from rigctl.errors import RigctlError

    input_name, output_name, only, step = asked
    if path is None:
        if assume:
            raise RigctlError("--assume gives an input of a model, and no model was named")
        opened = open_runs(written)
        return opened, frequency_responses(opened, input_name, output_name, only=only, resolution=step)
    from rigctl.analysis.fitting import fit_to_data, read_runs

    (model,) = open_models([path])
    opened = open_runs(written, model, assume)
    data = read_runs(model, opened, only=only, on_progress=on_progress)
    fitted = fit_to_data(model, data, refit=fit, on_progress=on_progress)
    return opened, responses_of_fit(fitted, model.name, input_name, output_name, resolution=step)

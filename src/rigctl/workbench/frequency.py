"""The frequency response of the records on the workbench, measured and of the model as its sliders stand."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rigctl.analysis.frequency_response import FrequencyResponse, moving_inputs, responses_of_outputs
from rigctl.command_line import command
from rigctl.errors import RigctlError
from rigctl.workbench.picture import Picture
from rigctl.workbench.session import Workbench


@dataclass(frozen=True)
class Asked:
    """The response that is asked for.

    Attributes
    ----------
    input, output: names of an input of the model and of a channel; "" for the first input that moves, and for
        the first channel.
    record: the index of the record; None for all records together.
    """

    input: str = ""
    output: str = ""
    record: int | None = None

    def records(self, bench: Workbench) -> tuple[int, ...]:
        """The indices of the records from which it is estimated."""
        count = len(bench.problem.records)
        return tuple(range(count)) if self.record is None else (min(self.record, count - 1),)

    def completed(self, bench: Workbench) -> Asked:
        """With the names that it leaves open; the input stays "" if none moves."""
        moving = moving_inputs(bench.problem, self.records(bench)) if not self.input else ()
        output = self.output or bench.problem.measurements.outputs[0]
        return replace(self, input=self.input or next(iter(moving), ""), output=output)


def frequency_response(
    bench: Workbench, picture: Picture, asked: Asked, like: FrequencyResponse | None = None
) -> FrequencyResponse:
    """The measured response, beside that of the simulated outputs of a picture, estimated in the same way.

    Parameters
    ----------
    like: the response of an earlier picture.

    Raises
    ------
    RigctlError
        as `rigctl.analysis.frequency_response.frequency_responses`, or a record could not be simulated.
    """
    records = asked.records(bench)
    failure = next((picture.failures[k] for k in records if k in picture.failures), None)
    if failure is not None:
        raise RigctlError("a frequency response needs complete simulations", value=failure)
    outputs = {k: picture.outputs[k] for k in records}
    (one,) = responses_of_outputs(
        bench.problem, outputs, bench.model.name, asked.input or None, asked.output, like=like
    )
    return one


def frequency_command(bench: Workbench, asked: Asked) -> str:
    """``rigctl frequency RUN --model M --no-fit``: the same response, of the model in its file."""
    subject = bench.opened.subject
    choice = replace(subject.choice, hold_out=None)
    if asked.record is not None and len(bench.problem.records) > 1:
        this = f"record == {bench.opened.data.numbers[asked.records(bench)[0]]}"
        choice = replace(choice, only=f"({choice.only}) and {this}" if choice.only else this)
    named = (("--input", asked.input), ("--channel", asked.output))
    ways = [word for option, name in named if name for word in (option, name)]
    return command(["frequency", *subject.runs, *ways, "--model", subject.model, "--no-fit"], choice)

"""The Bode plot of the workbench: the report's plot, as data for the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.answers.frequency_response import (
    ESTIMATION_ERRORS,
    frequency_notes,
    frequency_sentence,
    not_estimated,
)
from rigctl.web.workbench.frames import frame
from rigctl.workbench import Asked, Picture, Workbench
from rigctl.workbench.frequency import frequency_command, frequency_response

if TYPE_CHECKING:
    from rigctl.analysis.frequency_response import FrequencyResponse
    from rigctl.report.plot import Plot

Floats = NDArray[np.float64]


class Responses:
    """The frequency response that the page of one workbench shows while `asked` says so."""

    def __init__(self) -> None:
        self.asked: Asked | None = None
        self._last: FrequencyResponse | None = None

    def begin(self, shown: Sequence[int]) -> None:
        """Another bench is open."""
        self._last = None
        self.follow(shown)

    def follow(self, shown: Sequence[int]) -> None:
        """The page shows another record."""
        if self.asked is not None and self.asked.record is not None:
            self.asked = replace(self.asked, record=shown[0])

    def frame(self, bench: Workbench, picture: Picture, given: Asked, header: Mapping[str, Any]) -> bytes:
        """The response of a picture's model beside the measured one, or why these records show none."""
        asked = given.completed(bench)
        document: dict[str, Any] = {
            "kind": "frequency",
            **header,
            "exact": picture.exact,
            "every": asked.record is None,
            "input": asked.input,
            "channel": asked.output,
            "equals": frequency_command(bench, asked),
            "notes": [],
            "plot": None,
        }
        try:
            one = self._last = frequency_response(bench, picture, asked, self._last)
        except ESTIMATION_ERRORS as error:  # the sliders go on without it
            return frame({**document, "tone": "open", "statement": not_estimated(error)}, [])
        said, notes = frequency_sentence(one), frequency_notes(one)
        document |= {"tone": said.tone, "statement": said.text, "notes": [note.text for note in notes]}
        if not one.shown.any():
            return frame(document, [])
        described, arrays = plot_document(_plot(one))
        return frame({**document, "plot": described}, arrays)


def _plot(one: FrequencyResponse) -> Plot:
    from rigctl.report.analysis.frequency_response import bode_plot

    return bode_plot(one)


def plot_document(plot: Plot) -> tuple[dict[str, Any], list[tuple[str, Floats]]]:
    """A plot of the report without its numbers, and these: of each panel the common x, and each y."""
    panels = [
        {
            "title": panel.title,
            "height": panel.height,
            "range": panel.range,
            "traces": [
                {
                    "name": trace.name,
                    "look": trace.look.value,
                    "colour": trace.colour,
                    "faint": trace.faint,
                    "listed": trace.in_legend,
                }
                for trace in panel.traces
            ],
        }
        for panel in plot.panels
    ]
    arrays = [
        (f"panel {k}", np.stack([panel.traces[0].x, *(trace.y for trace in panel.traces)]))
        for k, panel in enumerate(plot.panels)
    ]
    described = {"caption": plot.caption, "x": plot.x_title, "log": plot.log_x, "panels": panels}
    return described, arrays

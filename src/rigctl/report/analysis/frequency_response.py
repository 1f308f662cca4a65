"""The section with Bode plots: magnitude, phase and coherence over frequency, measured and of a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.frequency_response import FrequencyResponse, responses_of_fit
from rigctl.answers.blocks import Block, Details, Figure, Sentence
from rigctl.answers.frequency_response import (
    ESTIMATION_ERRORS,
    frequency_evidence,
    frequency_notes,
    frequency_sentence,
    not_estimated,
    shown_and_not,
)
from rigctl.answers.numbers import symbol
from rigctl.model.fit.fit import FitResult
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot
from rigctl.report.signals import plain_name

Floats = NDArray[np.float64]

#: with more lines than this, they are joined instead of marked
_MARKED = 100
#: colours of the measured response, of the model's, and of limits
_MEASURED, _MODEL, _LIMIT = 7, 0, 7


def frequency_sections(responses: Sequence[FrequencyResponse], *, folded: bool = False) -> list[Section]:
    """A section with a Bode plot for each response, or what keeps the records from showing one."""
    plots: list[Plot] = []
    blocks: list[Block] = []
    drawn, rest = shown_and_not(responses)
    for number, one in enumerate(drawn, start=1):
        blocks.append(frequency_sentence(one))
        if one.shown.any():
            plots.append(bode_plot(one, f"frequency-{number}"))
            blocks.append(Figure(plots[-1].id, plots[-1].caption))
        blocks += frequency_notes(one)
        blocks.append(Details("lines", frequency_evidence(one)))
    blocks += rest
    body = page_blocks(blocks, {plot.id: plot_slot(plot) for plot in plots})
    hint = "magnitude, phase and coherence" if plots else "these records do not show one"
    return [Section("frequency", "Frequency response", body, tuple(plots), folded=folded, hint=hint)]


def frequency_of_model(fitted: FitResult, name: str) -> list[Section]:
    """The folded section of a page about a model; none for a table, whose rows have no time."""
    if fitted.problem.measurements.table:
        return []
    try:
        return frequency_sections(responses_of_fit(fitted, name), folded=True)
    except ESTIMATION_ERRORS as error:  # the page is about the fit, and must not be lost with a part of it
        body = page_blocks([Sentence(not_estimated(error))])
        hint = "these records do not show one"
        return [Section("frequency", "Frequency response", body, folded=True, hint=hint)]


def bode_plot(one: FrequencyResponse, key: str = "frequency") -> Plot:
    """Magnitude, phase and coherence over a logarithmic axis of frequency."""
    low, high = one.band
    inside = (one.spectrum.frequencies >= low) & (one.spectrum.frequencies <= high)
    at, shown = one.spectrum.frequencies[inside], one.shown[inside]
    gain = np.where(shown, one.gain(one.measured)[inside], np.nan)
    share = np.where(shown, one.radius(one.measured)[inside], np.nan) / np.abs(gain)
    model = None if one.predicted is None else one.gain(one.predicted)[inside]
    if model is not None:
        model = np.where(one.spectrum.excited[inside], model, np.nan)
    phase, of_model = _phases(gain, model)
    unit = symbol(one.unit)
    look = Look.MARKED if shown.sum() <= _MARKED else Look.LINE
    with np.errstate(divide="ignore", invalid="ignore"):
        size = 20.0 * np.log10(np.abs(gain))
        lower = size + 20.0 * np.log10(np.where(share < 1.0, 1.0 - share, np.nan))
        turn = np.degrees(np.arcsin(np.minimum(share, 1.0)))
        of_model_size = (
            None if model is None else 20.0 * np.log10(np.abs(np.where(model == 0.0, np.nan, model)))
        )
    upper = size + 20.0 * np.log10(1.0 + share)
    coherence = np.where(shown, one.measured.coherence[inside], np.nan)
    least = np.full(at.size, one.spectrum.least_coherence)
    return Plot(
        key,
        f"Frequency response from {plain_name(one.input)} to {plain_name(one.output)}, with 95 % intervals",
        "frequency [Hz]",
        (
            Panel(
                f"magnitude [dB re 1 {unit}]" if unit else "magnitude [dB]",
                _traces(at, look, "dB", size, (lower, upper), of_model_size, named=True),
                1.5,
            ),
            Panel("phase [°]", _traces(at, look, "°", phase, (phase - turn, phase + turn), of_model), 1.5),
            Panel(
                "coherence",
                (
                    Trace("", at, coherence, look, _MEASURED, in_legend=False),
                    Trace("99 % of chance", at, least, Look.LINE, _LIMIT, "", True),
                ),
                range=(0.0, 1.05),
            ),
        ),
        log_x=True,
    )


def _traces(
    at: Floats,
    look: Look,
    unit: str,
    measured: Floats,
    band: tuple[Floats, Floats],
    model: Floats | None,
    *,
    named: bool = False,
) -> tuple[Trace, ...]:
    traces = [
        Trace("measured", at, measured, look, _MEASURED, unit, in_legend=named),
        Trace("95 % interval", at, band[0], Look.LINE, _MEASURED, unit, True, named),
        Trace("", at, band[1], Look.LINE, _MEASURED, unit, True, False),
    ]
    if model is not None:
        traces.append(Trace("model", at, model, Look.LINE, _MODEL, unit, in_legend=named))
    return tuple(traces)


def _phases(
    gain: NDArray[np.complex128], model: NDArray[np.complex128] | None
) -> tuple[Floats, Floats | None]:
    """Phases in degrees without jumps; of a noisy measured one, the turns nearest to the model's."""
    if model is None:
        return _unwrapped(gain), None
    of_model = _unwrapped(model)
    measured = np.degrees(np.angle(gain))
    return measured + 360.0 * np.round((of_model - measured) / 360.0), of_model


def _unwrapped(gain: NDArray[np.complex128]) -> Floats:
    phase = np.full(gain.size, np.nan)
    known = np.isfinite(gain)
    phase[known] = np.degrees(np.unwrap(np.angle(gain[known])))
    return phase

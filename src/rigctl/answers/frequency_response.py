"""A frequency response in words: where the output follows the input, and where a model's response differs.

In: a `FrequencyResponse`, measured, with a model's estimated in the same way if there is one. Out: an
`Answer`, and a table of the lines. Only lines at which the coherence is significant are shown: elsewhere the
estimate is one of noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, Final

import numpy as np

from rigctl.analysis.frequency_response import FrequencyResponse
from rigctl.answers.blocks import Answer, Block, Column, Note, Points, Sentence, Table, nonempty
from rigctl.errors import RigctlError
from rigctl.units import significant
from rigctl.wording import listed, number_of

#: most lines in a table; of more, a selection in equal ratios
_MOST_LINES = 40

_three, _two = partial(significant, digits=3), partial(significant, digits=2)
_fixed_two = "{:.2f}".format
_signed = partial(significant, digits=2, sign=True)

#: errors of an estimate that must not take the rest of a page with it
ESTIMATION_ERRORS: Final = (RigctlError, ArithmeticError, MemoryError, ValueError)

#: a model's gain below this share of the measured one is none
_NO_GAIN = 1e-3

#: how to read the estimates
READING = (
    "magnitude in dB of the output's unit per unit of the input, phase in degrees; the coherence is the "
    "share of the output's power that follows the input linearly, and ± is the 95 % interval"
)


def frequency_answer(one: FrequencyResponse) -> Answer:
    """Whether the output follows the input, where the model's response is another one, and from what."""
    facts = nonempty(
        [
            ("lines", _lines(one)),
            ("from", _segments(one)),
            ("besides", f"the part of {listed(one.others)}, moving too, is taken out" if one.others else ""),
        ]
    )
    ways = f"from {one.input} to {one.output}"
    if not one.shown.any():
        text = f"these records do not show how {one.output} follows {one.input} at any frequency"
        return Answer("open", "No response", f"{text}: {_why_none(one)}", facts, headed=False)
    more = ("every line",)
    low, high = (_three(frequency) for frequency in one.band)
    band = f"from {low} to {high} Hz" if low != high else f"at {low} Hz"
    if one.model is None:
        coherence = _fixed_two(float(np.median(one.measured.coherence[one.shown])))
        text = f"{one.output} follows {one.input} {band}, with a median coherence of {coherence}"
        return Answer("good", "Measured", text, facts, more=more, headed=False)
    count = int(one.differing.sum())
    if not count:
        text = f"the response of {one.model} {ways} is the measured one, {band}, as far as these records show"
        return Answer("good", "Same response", text, facts, more=more, headed=False)
    text = f"the response of {one.model} {ways} is not the measured one at {_of(count, one)}{_worst(one)}"
    return Answer("bad", "Another response", text, facts, more=more, headed=False)


def shown_and_not(
    responses: Sequence[FrequencyResponse],
) -> tuple[list[FrequencyResponse], tuple[Block, ...]]:
    """The responses that records show, and what else was looked for; a single one is always the former."""
    shown = [one for one in responses if one.shown.any() or len(responses) == 1]
    rest = [f"of {one.output} to {one.input}: {_why_none(one)}" for one in responses if one not in shown]
    return shown, (Points.of("no response is shown", rest),) if rest else ()


def not_estimated(error: Exception) -> str:
    """Why there is no response, of an error while it was estimated; numpy raises others than ours."""
    return str(error) if isinstance(error, RigctlError) else f"it could not be estimated: {error}"


def frequency_evidence(one: FrequencyResponse) -> tuple[Block, ...]:
    """Every line, or a selection of many."""
    table = frequency_table(one)
    return (Note(READING), table) if table.rows else ()


def frequency_sentence(one: FrequencyResponse) -> Sentence:
    """The statement on one of several responses."""
    answer = frequency_answer(one)
    return Sentence(answer.sentence, answer.tone)


def frequency_notes(one: FrequencyResponse) -> list[Note]:
    """From what it was estimated."""
    return [Note(f"{head}: {text}") for head, text in frequency_answer(one).facts]


def frequency_table(one: FrequencyResponse) -> Table:
    """The lines that are shown: measured, and of the model where there is one."""
    at = np.flatnonzero(one.shown)
    if at.size > _MOST_LINES:
        # Equal ratios of frequency, as on the axis of a Bode diagram.
        wanted = np.geomspace(*one.band, _MOST_LINES)
        nearest = np.abs(one.spectrum.frequencies[at][:, None] - wanted[None, :]).argmin(axis=0)
        at = at[np.unique(nearest)]
    columns = [
        Column("frequency", "frequency [Hz]", _three),
        Column("magnitude", "magnitude [dB]", partial(_decimals, digits=1)),
        Column("magnitude_band", "± [dB]", _two),
        Column("phase", "phase [deg]", partial(_decimals, digits=0)),
        Column("phase_band", "± [deg]", _two),
        Column("coherence", "coherence", _fixed_two),
    ]
    if one.model is not None:
        columns += [
            Column("more", "model less measured [dB]", _signed),
            Column("later", "model less measured [deg]", _signed),
        ]
    rows = tuple(_row(one, k) for k in at.tolist())
    strong = frozenset(number for number, k in enumerate(at.tolist()) if one.differing[k])
    return Table(tuple(columns), rows, f"{one.output} / {one.input}{_reference(one)}", strong)


def _reference(one: FrequencyResponse) -> str:
    return "" if one.unit == "1" else f", in dB re 1 {one.unit}"


def _decimals(value: float, digits: int) -> str:
    """With so many decimals, and no negative zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def _row(one: FrequencyResponse, k: int) -> dict[str, Any]:
    gain, radius = one.gain(one.measured)[k], one.radius(one.measured)[k]
    # The estimate lies within a circle of radius r around the complex gain G: hence ±20·log10(1 + r/|G|) dB
    # and ±arcsin(r/|G|).
    share = min(radius / abs(gain), 1.0)
    row: dict[str, Any] = {
        "frequency": float(one.spectrum.frequencies[k]),
        "magnitude": decibels(abs(gain)),
        "magnitude_band": decibels(1.0 + share),
        "phase": float(np.degrees(np.angle(gain))),
        "phase_band": float(np.degrees(np.arcsin(share))),
        "coherence": float(one.measured.coherence[k]),
    }
    if one.predicted is not None:
        more, later = _apart(one, k)
        row |= {"more": more, "later": later} if np.isfinite(more) else {}
    return row


def decibels(ratio: float) -> float:
    """20 times the decimal logarithm."""
    return float(20.0 * np.log10(ratio))


def _apart(one: FrequencyResponse, k: int) -> tuple[float, float]:
    """Model over measured: dB, and degrees from -180 to 180; -inf and NaN where the model does not follow."""
    assert one.predicted is not None  # noqa: S101 - asked for responses of a model only
    ratio = one.predicted.gain[k] / one.measured.gain[k]
    if abs(ratio) < _NO_GAIN:
        return -np.inf, np.nan
    return decibels(abs(ratio)), float(np.degrees(np.angle(ratio)))


def _of(count: int, one: FrequencyResponse) -> str:
    excited = int(one.spectrum.excited.sum())
    return f"{count} of {number_of(excited, 'excited line')}"


def _worst(one: FrequencyResponse) -> str:
    if one.worst is None:
        return ", none of which the measured output shows"
    more, later = _apart(one, one.worst)
    where = _three(float(one.spectrum.frequencies[one.worst]))
    if not np.isfinite(more):
        not_at_all = "(by less than a thousandth of the measured gain)"
        return (
            f", most at {where} Hz: there the model's {one.output} does not follow {one.input} {not_at_all}"
        )
    return f", most at {where} Hz: the model's is {_signed(more)} dB and {_signed(later)} deg off"


def _lines(one: FrequencyResponse) -> str:
    excited, shown = int(one.spectrum.excited.sum()), int(one.shown.sum())
    whole = one.spectrum.frequencies.size
    text = f"{excited} of {whole} excited" if excited < whole else number_of(excited, "line")
    if one.spectrum.left_out:
        text += f", the strongest; {one.spectrum.left_out} weaker ones are left out"
    if not shown:
        return text
    folded = int(one.folded.sum())
    hidden = excited - shown - folded
    if hidden:
        least = _fixed_two(one.spectrum.least_coherence)
        text += f"; {hidden} not shown, where a coherence below {least} is no evidence of any response"
    return text + (f"; {folded} not shown, {_why_folded(one)}" if folded else "")


def _why_folded(one: FrequencyResponse) -> str:
    """Where the samples of the output are too far apart."""
    above = _three(float(one.spectrum.frequencies[one.folded][0]))
    return (
        f"from {above} Hz on: {one.input} also has frequencies beyond half the sampling rate, "
        f"and samples every {_three(one.spectrum.interval)} s do not tell what follows those"
    )


def _segments(one: FrequencyResponse) -> str:
    spectrum = one.spectrum
    of = f" of {number_of(len(one.records), 'record')}" if len(one.records) > 1 else ""
    if spectrum.periods:
        length = _three(spectrum.periods[0].length)
        left_out = sum(period.settling for period in spectrum.periods)
        first = "the first" if len(one.records) == 1 else "the first of each record"
        settled = f"; {first} is left out, in which the output settles" if left_out else ""
        return f"{number_of(spectrum.segments, 'period')} of {length} s{of}{settled}"
    length = _three(1.0 / spectrum.resolution)
    return (
        f"{number_of(spectrum.segments, 'window')} of {length} s{of} (Hann, overlapping by half), worth "
        f"{_two(spectrum.averages)} independent ones"
    )


def _why_none(one: FrequencyResponse) -> str:
    if not one.spectrum.excited.any():
        return f"{one.input} does not move by itself, without {listed(one.others)}"
    if one.folded.all(where=one.spectrum.excited):
        return _why_folded(one)
    return "no line has a coherence that chance would not give"


def frequency_documents(responses: Sequence[FrequencyResponse]) -> list[dict[str, Any]]:
    """The machine-readable answers."""
    return [{**one.document(), "statement": frequency_answer(one).sentence} for one in responses]

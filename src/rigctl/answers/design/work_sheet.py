"""A designed procedure as a printed sheet, for a bench whose operator works without rigctl."""

from __future__ import annotations

from rigctl.answers.design.statement import added, statement
from rigctl.answers.numbers import probability
from rigctl.design.result import DesignResult, ProposedRecord
from rigctl.planning.outline import clock_time

_WIDTH = 96


def work_sheet(design: DesignResult) -> str:
    """What is to be set, done and written down, record by record, as plain text for any printer.

    The steps are those of the designed procedure, in its order; boxes are ticked by hand.
    """
    rule = "=" * _WIDTH
    head = [
        rule,
        f"WORK SHEET   model {design.model}",
        rule,
        *_wrapped(statement(design) + ".", ""),
        "",
        f"Records: {len(design.records)}    bench time with heating: about {clock_time(design.duration)}",
        "Probability that the right effect alone is named: "
        f"{probability(design.before)} now, {probability(design.after)} after",
        "",
        "Operator: ______________________    Date: ______________    Bench: ______________________",
        "",
        "Stop at any sign of trouble: outputs off first, then write down what was seen.",
    ]
    parts = [line for number, one in enumerate(design.records, 1) for line in _record(design, number, one)]
    return "\n".join([*head, *parts, *_foot(design)]) + "\n"


def _record(design: DesignResult, number: int, one: ProposedRecord) -> list[str]:
    settings = [
        f"  [ ] set {name.replace('_', ' ')} to {value}, wait until it is steady"
        for name, value in one.settings.items()
    ]
    steps = [f"  [ ] {step}" for step in one.steps]
    return [
        "",
        "-" * _WIDTH,
        f"RECORD {number}    about {clock_time(one.duration)}",
        f"  recorded: {one.recorded:.3g} s at {one.rate:g} Hz",
        *_wrapped(added(design, one), "  "),
        *settings,
        "  [ ] back to the start position, logger on",
        *steps,
        "  [ ] logger off; file name: ______________________________",
        "  read before: ______________________    read after: ______________________",
        "  remarks: " + "_" * (_WIDTH - 11),
    ]


def _foot(design: DesignResult) -> list[str]:
    return [
        "",
        "-" * _WIDTH,
        "Afterwards, on the computer with rigctl:",
        "  rigctl import FILE... --rig RIG           the log, one record each",
        f"  rigctl diagnose {' '.join(design.runs)} NEW_RUN --model MODEL",
    ]


def _wrapped(text: str, indent: str) -> list[str]:
    from textwrap import wrap

    return wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent)

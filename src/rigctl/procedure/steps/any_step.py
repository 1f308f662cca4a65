"""Every step there is, by its verb: the one table from which reading, schema and messages come."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, BeforeValidator, Discriminator, Tag

from rigctl.errors import RigctlError, unknown_name
from rigctl.files.refusal import refusal
from rigctl.procedure.steps.base import Step
from rigctl.procedure.steps.calls import CallStep
from rigctl.procedure.steps.choices import IfStep, RepeatStep, WhileStep
from rigctl.procedure.steps.motion import ExtendStep, RetractStep
from rigctl.procedure.steps.operator import PromptStep
from rigctl.procedure.steps.outputs import SetStep
from rigctl.procedure.steps.recording import MeasureStep, RecordStep
from rigctl.procedure.steps.setpoints import HeatStep, SetPressureStep
from rigctl.procedure.steps.sweeps import ForStep
from rigctl.procedure.steps.together import DoStep
from rigctl.procedure.steps.waiting import HoldStep, WaitStep

STEPS: tuple[type[Step], ...] = (
    HeatStep,
    SetPressureStep,
    ExtendStep,
    RetractStep,
    WaitStep,
    HoldStep,
    SetStep,
    RecordStep,
    MeasureStep,
    PromptStep,
    ForStep,
    RepeatStep,
    WhileStep,
    IfStep,
    CallStep,
    DoStep,
)
BY_VERB: Mapping[str, type[Step]] = {step.verb: step for step in STEPS}
_FIELDS: Mapping[str, frozenset[str]] = {
    verb: frozenset(field.alias or name for name, field in step.model_fields.items())
    for verb, step in BY_VERB.items()
}


def _verbs(written: Mapping[str, Any]) -> list[str]:
    """The verbs of a step: one when it is a step, the others being fields of it, such as `do`."""
    found = [verb for verb in BY_VERB if verb in written]
    for verb in found:
        if all(other == verb or other in _FIELDS[verb] for other in found):
            return [verb]
    return found


def _one_verb(written: Any) -> Any:
    """Refuse what has no verb or several of them, in words about steps."""
    if isinstance(written, Step):
        return written
    if not isinstance(written, dict) or not written:
        shown = None if written is None or isinstance(written, dict | list) else str(written)
        near = unknown_name("step", shown, BY_VERB).nearest if shown else None
        raise refusal(
            RigctlError("this is no step", value=shown, expected="a step, e.g. 'wait: 2 s'", nearest=near)
        )
    verbs = _verbs(written)
    if len(verbs) > 1:
        raise refusal(
            RigctlError(
                "two steps in one",
                value=" and ".join(verbs),
                expected="one step after each dash",
            ),
            (verbs[1],),
        )
    if not verbs:
        first, *_ = written
        raise refusal(unknown_name("step", first, BY_VERB), (first,))
    return written


def _tag(written: Any) -> str | None:
    if isinstance(written, Step):
        return type(written).__name__
    verbs = _verbs(written) if isinstance(written, dict) else []
    return BY_VERB[verbs[0]].__name__ if verbs else None


AnyStep: TypeAlias = Annotated[
    Annotated[HeatStep, Tag("HeatStep")]
    | Annotated[SetPressureStep, Tag("SetPressureStep")]
    | Annotated[ExtendStep, Tag("ExtendStep")]
    | Annotated[RetractStep, Tag("RetractStep")]
    | Annotated[WaitStep, Tag("WaitStep")]
    | Annotated[HoldStep, Tag("HoldStep")]
    | Annotated[SetStep, Tag("SetStep")]
    | Annotated[RecordStep, Tag("RecordStep")]
    | Annotated[MeasureStep, Tag("MeasureStep")]
    | Annotated[PromptStep, Tag("PromptStep")]
    | Annotated[ForStep, Tag("ForStep")]
    | Annotated[RepeatStep, Tag("RepeatStep")]
    | Annotated[WhileStep, Tag("WhileStep")]
    | Annotated[IfStep, Tag("IfStep")]
    | Annotated[CallStep, Tag("CallStep")]
    | Annotated[DoStep, Tag("DoStep")],
    Discriminator(_tag),
    BeforeValidator(_one_verb),
]

_RECURSIVE: tuple[type[BaseModel], ...] = (
    RecordStep,
    ForStep,
    RepeatStep,
    WhileStep,
    IfStep,
    CallStep,
    DoStep,
)
for _model in _RECURSIVE:
    _model.model_rebuild(_types_namespace={"AnyStep": AnyStep})

"""All kinds of steps by verb, found in the modules of this package; used for reading, schema and messages.

A new kind of step is one new module or package: a `Step` with its verb and example, and an `Action` if it
acts on the bench.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from importlib import import_module
from operator import or_
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Discriminator, Tag

import rigctl.steps
from rigctl.errors import RigctlError, unknown_name
from rigctl.files.refusal import refusal
from rigctl.plan.step import Cleanup, Step


def _kinds() -> Iterator[type[Step]]:
    for found in iter_modules(rigctl.steps.__path__, "rigctl.steps."):
        if found.name == __name__:
            continue
        for kind in vars(import_module(found.name)).values():
            module = getattr(kind, "__module__", None) or ""
            defined_here = module == found.name or module.startswith(f"{found.name}.")
            if defined_here and isinstance(kind, type) and issubclass(kind, Step) and "example" in vars(kind):
                yield kind


#: first those that act on the bench, then those that contain steps
STEPS: tuple[type[Step], ...] = tuple(
    sorted(_kinds(), key=lambda kind: (issubclass(kind, Cleanup), kind.verb))
)
BY_VERB: Mapping[str, type[Step]] = {step.verb: step for step in STEPS}
_FIELDS: Mapping[str, frozenset[str]] = {
    verb: frozenset(field.alias or name for name, field in step.model_fields.items())
    for verb, step in BY_VERB.items()
}


def _verbs(written: Mapping[str, Any]) -> list[str]:
    """Return the verbs among the keys of a step, exactly one for a valid step; a further verb that is a field
    of the first, such as `do`, does not count."""
    found = [verb for verb in BY_VERB if verb in written]
    for verb in found:
        if all(other == verb or other in _FIELDS[verb] for other in found):
            return [verb]
    return found


def _one_verb(written: Any) -> Any:
    """Refuse a step without a verb or with several, with a message that names the verbs."""
    if isinstance(written, Step):
        return written
    if not isinstance(written, dict) or not written:
        shown = None if written is None or isinstance(written, dict | list) else str(written)
        near = unknown_name("step", shown, BY_VERB).nearest if shown else None
        raise refusal(
            RigctlError("this is not a step", value=shown, expected="a step, e.g. 'wait: 2 s'", nearest=near)
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


if TYPE_CHECKING:
    AnyStep: TypeAlias = Step
else:
    AnyStep = Annotated[
        reduce(or_, (Annotated[kind, Tag(kind.__name__)] for kind in STEPS)),
        Discriminator(_tag),
        BeforeValidator(_one_verb),
    ]

for _kind in STEPS:
    _kind.model_rebuild(_types_namespace={"AnyStep": AnyStep})

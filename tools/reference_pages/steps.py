"""The page `docs/reference/procedure-steps.md`, generated from the models that read a procedure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rigctl.files.schema import json_schema
from rigctl.plan.arguments import ArgumentFields
from rigctl.plan.fields import Short
from rigctl.plan.identity import IdentityField, IdentityFields
from rigctl.plan.step import Cleanup, Step
from rigctl.plan.values import Value
from rigctl.procedure.load import ProcedureFile
from rigctl.steps.registry import BY_VERB

_HEAD = """\
# The steps of a procedure

*Generated* from `src/rigctl/steps/` by `make docs`.

A step is a mapping whose verb is its kind. If a short form is given, the value of that one field may be
written instead of the mapping: `wait: 0.2 s` is `wait: {for: 0.2 s}`. Every quantity is written with its
unit, or as an expression of `$variables`: `$supply + 2 bar`. Conditions are written in the
[grammar of expressions](expressions.md).
"""

_CLEANUP = """\
Steps that contain steps (`do`) may also have `on_failure`, `on_abort` and `finally`, each a list of steps.
They run when the step is left: after a failure, after an abort, and in every case, in this order and from
the inside out; a cleanup step that fails does not stop the next. Those of a record run after it has been
closed. A whole procedure may have them too.
"""


def steps_page() -> str:
    """Return the page: the fields of the file, then every step with its fields."""
    schema = json_schema(ProcedureFile, title="")
    definitions: dict[str, Any] = schema["$defs"]
    lines = [_HEAD, "## The file", ""]
    fields = {
        name: info for name, info in ProcedureFile.model_fields.items() if name not in Cleanup.model_fields
    }
    lines += _table(fields, schema["properties"])
    lines += ["", "An argument is written with its default, `supply: 30 bar`, or in full:", ""]
    lines += _fields(definitions, ArgumentFields)
    lines += ["", "Under `identity`:", ""]
    lines += _fields(definitions, IdentityFields)
    lines += ["", "Each of them is written with its default, `part: HL32-50`, or in full:", ""]
    lines += _fields(definitions, IdentityField)
    lines += ["", "## Cleanup", "", _CLEANUP, "## Steps", ""]
    for verb, step in BY_VERB.items():
        lines += [*_step(verb, step, definitions), ""]
    return "\n".join(lines).rstrip() + "\n"


def _step(verb: str, step: type[Step], definitions: dict[str, Any]) -> Iterator[str]:
    yield f"### {verb}"
    yield ""
    yield " ".join((step.__doc__ or "").split())
    yield ""
    yield f"```yaml\n{step.example}```"
    info = {field.alias or name: field for name, field in step.model_fields.items()}[verb]
    short = next((entry.field for entry in info.metadata if isinstance(entry, Short)), None)
    if short is not None:
        yield ""
        yield f"Short form: the value of `{short}`."
    inner = _model_in(info.annotation)
    if inner is not None:
        yield ""
        yield from _fields(definitions, inner)
        for name, entry in inner.model_fields.items():
            part = next(filter(None, map(_model_in, get_args(entry.annotation))), None)
            if part is not None:
                yield from ("", f"`{entry.alias or name}`:", "")
                yield from _fields(definitions, part)
    beside = {
        name: field
        for name, field in step.model_fields.items()
        if name not in Cleanup.model_fields and (inner is None or (field.alias or name) != verb)
    }
    beside = dict(sorted(beside.items(), key=lambda entry: (entry[1].alias or entry[0]) != verb))
    if beside:
        yield ""
        yield "Beside the verb:" if inner is not None else "Keys:"
        yield ""
        yield from _table(beside, definitions[step.__name__]["properties"])


def _fields(definitions: dict[str, Any], model: type[BaseModel]) -> list[str]:
    about = " ".join((model.__doc__ or "").split())
    return [about, "", *_table(model.model_fields, definitions[model.__name__]["properties"])]


def _table(fields: dict[str, FieldInfo], properties: dict[str, Any]) -> list[str]:
    rows = ["| key | for example | default | meaning |", "|---|---|---|---|"]
    for name, info in fields.items():
        key = info.alias or name
        examples = ", ".join(f"`{example}`" for example in _examples(properties[key])[:2])
        rows.append(f"| `{key}` | {examples} | {_default(info)} | {info.description or ''} |")
    return rows


def _examples(schema: Any) -> list[str]:
    """Return the examples given by a schema or one of its branches, or else the values that it allows."""
    if not isinstance(schema, dict):
        return []
    found = schema.get("examples") or schema.get("enum") or []
    for branch in (*schema.get("anyOf", ()), *schema.get("oneOf", ())):
        found = found or _examples(branch)
    return [str(example) for example in found]


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    default = info.get_default(call_default_factory=True, validated_data={})
    if isinstance(default, BaseModel):
        return ""
    if isinstance(default, Value):
        return f"`{default.text}`"
    return "" if default in (None, "", {}) else f"`{str(default).lower()}`"


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if get_origin(annotation) is Annotated:
        return _model_in(get_args(annotation)[0])
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None

"""Validates a document with a pydantic model, with error messages for users and locations in the file.

In: a document with the position of each value, and a model. Out: an instance of the model, or every
mistake at once, each with line and column, in the order of the file.

pydantic decides what is valid; what it says is translated, because it speaks of types, unions and
branches that no user has written. A field that is misspelt is one mistake here, where pydantic reports an
unknown and a missing one, and the complaints of all branches of a union at one place are joined. A file
of another kind is refused by its kind, and not field by field.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from rigctl.errors import RigctlError, SeveralErrors, nearest_name, unknown_name
from rigctl.files import refusal
from rigctl.files.fields import field_names, types_at
from rigctl.files.kinds import file_of, other_kind
from rigctl.files.nodes import Key, known_keys
from rigctl.files.yaml import Document

M = TypeVar("M", bound=BaseModel)

#: the expected value, by the kind of pydantic's error
_EXPECTED = {
    "string_type": "text",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "dict_type": "a mapping (name: value)",
    "mapping_type": "a mapping (name: value)",
    "model_type": "a mapping (name: value)",
    "model_attributes_type": "a mapping (name: value)",
    "dataclass_type": "a mapping (name: value)",
    "list_type": "a list",
    "tuple_type": "a list",
    "set_type": "a list",
    "date_type": "a date, e.g. 2026-03-14",
    "date_parsing": "a date, e.g. 2026-03-14",
    "date_from_datetime_parsing": "a date, e.g. 2026-03-14",
    "date_from_datetime_inexact": "a date, e.g. 2026-03-14",
    "datetime_parsing": "a date and time, e.g. 2026-03-14T09:30:00Z",
    "none_required": "nothing",
}

#: largest number of valid values that are listed in addition to the nearest one
_FEW = 6

#: errors about a bound: the text around it
_BOUNDS = {
    "greater_than": ("too small", "more than {gt}"),
    "greater_than_equal": ("too small", "at least {ge}"),
    "less_than": ("too large", "less than {lt}"),
    "less_than_equal": ("too large", "at most {le}"),
    "too_short": ("too few entries", "at least {min_length}"),
    "too_long": ("too many entries", "at most {max_length}"),
    "string_too_short": ("too short", "at least {min_length} characters"),
    "string_too_long": ("too long", "at most {max_length} characters"),
    "multiple_of": ("not a multiple", "a multiple of {multiple_of}"),
    "string_pattern_mismatch": ("not allowed here", "text like {pattern}"),
}


def validate(document: Document, model: type[M], *, keys: Sequence[Key] = ()) -> M:
    """Return the part of `document` under `keys` as a `model`.

    Raises
    ------
    RigctlError
        the document is not valid; with file, line, column, value, what was expected, and the nearest valid
        name; `SeveralErrors` if there is more than one mistake.
    """
    value: Any = document.data
    for key in keys:
        value = value[key]
    if not keys:
        _require_kind(value, document, model)
    try:
        return model.model_validate(value)
    except ValidationError as problem:
        errors = list(_translate(problem, document, model, tuple(keys)))
    raise errors[0] if len(errors) == 1 else SeveralErrors(errors)


def _require_kind(value: Any, document: Document, model: type[BaseModel]) -> None:
    """Refuse a file of another kind without quoting it, since a name in a procedure may refer to any file."""
    valid = field_names(types_at(model, ()))
    if isinstance(value, dict):
        names = [str(name) for name in value]
        other = other_kind(names, valid)
        if other is not None:
            found, wanted = map(file_of, other)
            raise RigctlError(f"this is {found}", expected=wanted, where=document.locate())
        if not names or any(name in valid or nearest_name(name, valid) for name in names):
            return
        found = f"{len(names)} other fields"
    elif isinstance(value, str):
        found = "a text"
    else:
        return
    raise RigctlError(
        "this is another kind of file",
        value=found,
        expected=f"a mapping (name: value) with {_or(sorted(valid))}",
        where=document.locate(),
    )


def _translate(
    problem: ValidationError, document: Document, model: type[BaseModel], keys: tuple[Key, ...]
) -> Iterable[RigctlError]:
    """Return every error once, in the order of the file, without a missing field that is only misspelt."""
    details: list[dict[str, Any]] = [{**detail} for detail in problem.errors(include_url=False)]
    misspelt = _misspelt_fields(details)
    found: dict[str, RigctlError] = {}
    for detail in details:
        loc = tuple(detail["loc"])
        if detail["type"] == "missing" and loc in misspelt:
            continue
        error = _error(detail, document, model, keys)
        place = str(error.where)
        if place in found:
            found[place] = _merge(found[place], error)
        else:
            found[place] = error
    return sorted(found.values(), key=lambda error: (error.where.line or 0, error.where.column or 0))


def _misspelt_fields(details: list[dict[str, Any]]) -> set[tuple[Key, ...]]:
    """Return the missing fields for which there is an unknown field with a similar name."""
    unknown = [tuple(detail["loc"]) for detail in details if detail["type"] == "extra_forbidden"]
    return {
        tuple(detail["loc"])
        for detail in details
        if detail["type"] == "missing"
        for other in unknown
        if other[:-1] == tuple(detail["loc"])[:-1]
        and nearest_name(str(other[-1]), [str(detail["loc"][-1])]) is not None
    }


def _merge(first: RigctlError, second: RigctlError) -> RigctlError:
    """Combine two errors at one location, from branches of a union: either expected value is valid."""
    expected = " or ".join(dict.fromkeys(part for part in (first.expected, second.expected) if part))
    first.expected = expected or None
    first.nearest = first.nearest or second.nearest
    return first


def _error(
    detail: dict[str, Any], document: Document, model: type[BaseModel], keys: tuple[Key, ...]
) -> RigctlError:
    kind = detail["type"]
    loc = (*keys, *detail["loc"])
    of_key = bool(loc) and loc[-1] == "[key]"
    if of_key:
        loc = loc[:-1]
    context: dict[str, Any] = detail.get("ctx") or {}
    if kind == "extra_forbidden":
        name = str(loc[-1])
        valid = field_names(types_at(model, tuple(detail["loc"][:-1])))
        return unknown_name("field", name, valid, where=document.locate(loc, of_key=True))
    if kind == "missing" and isinstance(loc[-1], int):
        return RigctlError("too few entries", expected=f"{loc[-1] + 1} or more", where=document.locate(loc))
    if kind == "missing":
        example = _example(model, tuple(detail["loc"]))
        return RigctlError(f"the field '{loc[-1]}' is missing", expected=example, where=document.locate(loc))
    if kind == refusal.TYPE:
        error: RigctlError = context["error"]
        if of_key:
            return error.at(document.locate(loc, of_key=True))
        loc = (*loc, *context["keys"])
        return _named(error, loc, document).at(document.locate(loc))
    error = _from_kind(kind, detail, context, _written(document, loc, detail))
    return _named(error, loc, document).at(document.locate(loc))


def _example(model: type[BaseModel], loc: tuple[Key, ...]) -> str | None:
    """The example of the one part around `loc` that declares one, if it is a single line."""
    for end in range(len(loc) - 1, -1, -1):
        declared = {getattr(kind, "example", None) for kind in types_at(model, loc[:end])}
        found = [one.strip().removeprefix("- ") for one in declared if isinstance(one, str)]
        if found:
            return f"e.g. {found[0]}" if len(found) == 1 and "\n" not in found[0] else None
    return None


def _from_kind(  # noqa: PLR0911 - one for each kind of complaint
    kind: str, detail: dict[str, Any], context: dict[str, Any], written: str
) -> RigctlError:
    if kind in ("literal_error", "enum", "union_tag_invalid"):
        names = _literals(context.get("expected") or context.get("expected_tags", ""))
        value = str(context.get("tag", written))
        near = nearest_name(value, names)
        listed = None if near and len(names) > _FEW else _or(names)
        return RigctlError("not a known value", value=value, expected=listed, nearest=near)
    if kind == "union_tag_not_found":
        field = str(context.get("discriminator", "")).strip("'")
        return RigctlError(f"the field '{field}' is missing")
    if kind == "string_too_short" and not written:
        return RigctlError("this is empty", expected="a text")
    if kind in _BOUNDS:
        what, expected = _BOUNDS[kind]
        return RigctlError(what, value=written, expected=expected.format(**context))
    if kind in _EXPECTED:
        return RigctlError("wrong kind of value", value=written, expected=_EXPECTED[kind])
    if kind in ("value_error", "assertion_error"):
        return RigctlError(str(context.get("error") or detail["msg"]), value=written or None)
    return RigctlError(f"not allowed: {detail['msg']}", value=written)


def _named(error: RigctlError, loc: tuple[Key, ...], document: Document) -> RigctlError:
    """Put the name of the field in front of the error."""
    names = [key for key in known_keys(document.root, loc) if isinstance(key, str)]
    if names and f"'{names[-1]}'" not in error.what:
        error.what = f"{names[-1]}: {error.what}"
        error.args = (error.what,)
    return error


def _written(document: Document, loc: tuple[Key, ...], detail: dict[str, Any]) -> str:
    value = detail.get("input")
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    written = document.written(loc)
    return written if written is not None else str(value)


def _literals(expected: str) -> list[str]:
    """Return the names in pydantic's ``'a', 'b' or 'c'``."""
    return [part.strip().strip("'") for part in expected.replace(" or ", ", ").split(",") if part.strip()]


def _or(names: list[str]) -> str | None:
    if len(names) < 2:
        return names[0] if names else None
    return ", ".join(names[:-1]) + f" or {names[-1]}"

"""Common parts of the fields of steps: a base class, names, conditions, units and short forms."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    WithJsonSchema,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rigctl.errors import RigctlError
from rigctl.expressions import parse
from rigctl.files.refusal import refusal
from rigctl.units import parse_unit


class ProcedurePart(BaseModel):
    """A part of a procedure file: frozen; unknown fields are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")


def _name(written: object) -> str:
    if isinstance(written, str) and _NAME.fullmatch(written):
        return written
    shown = written if isinstance(written, str | int | float) else type(written).__name__
    raise refusal(
        RigctlError("no name", value=str(shown), expected="a letter, then letters, digits or '_', at most 64")
    )


#: names of variables, measures and answers, as expressions can use them
Name = Annotated[
    str, BeforeValidator(_name), WithJsonSchema({"type": "string", "pattern": f"^{_NAME.pattern}$"})
]


def _readable(text: str) -> str:
    try:
        parse(text)
    except RigctlError as error:
        raise refusal(error) from error
    return text


def _text_only(written: object) -> object:
    if isinstance(written, bool | int | float):
        raise refusal(
            RigctlError("no condition", value=str(written), expected="a comparison, e.g. 'position < 1 mm'")
        )
    return written


#: a comparison of channels, commands, measures and answers
Condition = Annotated[
    str,
    BeforeValidator(_text_only),
    AfterValidator(_readable),
    Field(examples=["position < 1 mm", "oil_temperature > 40 degC and valve == 0"], min_length=1),
]


def unit_text(written: object) -> str:
    """Return the name of a unit, or "1".

    Raises
    ------
    PydanticCustomError
        there is no such unit.
    """
    text = str(written) if isinstance(written, str | int) and not isinstance(written, bool) else ""
    try:
        if not text:
            raise RigctlError("no unit", expected="a unit such as bar, degC or s; 1 for a plain number")
        parse_unit(text)
    except RigctlError as error:
        raise refusal(error) from error
    return text


#: a unit in which values are read and shown
UnitName = Annotated[str, BeforeValidator(unit_text)]


@dataclass(frozen=True)
class Short:
    """A short form: a step may be written with the value of one field instead of a mapping, ``wait: 0.2 s``.

    `field` is the name of that field.
    """

    field: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Convert the short form to the long one before anything is checked."""
        return core_schema.no_info_before_validator_function(self._lengthen, handler(source))

    def _lengthen(self, written: Any) -> Any:
        return {self.field: written} if isinstance(written, str | int | float | list) else written

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Accept either form."""
        long = handler(schema)
        field = handler.resolve_ref_schema(long)["properties"][self.field]
        return {"anyOf": [field, long]}

"""The device under test and the person in charge: what a procedure requires, and what was given.

A pattern is a regular expression for RE2, which matches in a time proportional to the length of the text: no
procedure file can make rigctl hang.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.plan.fields import ProcedurePart, Short

#: largest length of a field's text
LONGEST: Final = 200


class IdentityField(ProcedurePart):
    """One property of the device under test, or the person in charge: a text, and its required form."""

    default: str | None = Field(default=None, max_length=LONGEST, description="used if nothing else is given")
    required: bool = Field(
        default=False, description="no run on a bench starts without it; `rigctl run` asks for it"
    )
    pattern: str | None = Field(
        default=None,
        max_length=LONGEST,
        description="a regular expression (RE2) that the whole text must match",
        examples=["HC-[0-9]{4}"],
    )

    @model_validator(mode="after")
    def _readable(self) -> Self:
        if self.pattern is None:
            return self
        try:
            fits = self.matches(self.default or "") or self.default is None
        except RigctlError as error:
            raise refusal(error, ("pattern",)) from error
        if not fits:
            wrong = RigctlError("does not match the pattern", value=self.default, expected=self.pattern)
            raise refusal(wrong, ("default",))
        return self

    def matches(self, text: str) -> bool:
        """Return whether the whole text matches the pattern; True if there is no pattern.

        Raises
        ------
        RigctlError
            the pattern is not a valid regular expression.
        """
        if self.pattern is None:
            return True
        import pyarrow as pa
        import pyarrow.compute as pc

        try:
            return bool(pc.match_substring_regex(pa.scalar(text), f"^(?:{self.pattern})$").as_py())
        except pa.ArrowInvalid as problem:
            said = str(problem).partition(": ")[2] or "not readable"
            raise RigctlError(
                f"not a regular expression: {said}", value=self.pattern, expected="e.g. 'HC-[0-9]{4}'"
            ) from problem


_Text = Annotated[IdentityField, Short("default")]


class IdentityFields(ProcedurePart):
    """What a procedure states about the device under test, and requires before anything moves."""

    serial_number: _Text = Field(default=IdentityField(), description="of the device under test")
    part: _Text = Field(default=IdentityField(), description="the part or type number of the device")
    operator: _Text = Field(default=IdentityField(), description="the person in charge")
    notes: _Text = Field(default=IdentityField(), description="anything else")


@dataclass(frozen=True, slots=True)
class Identity:
    """The device under test and the person in charge; "" for what was not given."""

    serial_number: str = ""
    part: str = ""
    operator: str = ""
    notes: str = ""

    @property
    def device(self) -> dict[str, str]:
        """The identity of the device under test, by name of the field."""
        return {name: text for name, text in self._said() if name != "operator"}

    def _said(self) -> Iterator[tuple[str, str]]:
        for field in fields(self):
            text: str = getattr(self, field.name)
            if text:
                yield field.name, text


#: the names of the fields, in their order
NAMES: Final = tuple(field.name for field in fields(Identity))


def checked(demands: IdentityFields, name: str, text: str) -> str:
    """Return the text given for a field, without blanks around it.

    Raises
    ------
    RigctlError
        the text is too long, contains unprintable characters, or does not match the pattern.
    """
    said = text.strip()
    demand: IdentityField = getattr(demands, name)
    label = name.replace("_", " ")
    if len(said) > LONGEST or not said.isprintable():
        raise RigctlError(
            f"the {label} is not a short text",
            value=said,
            expected=f"one line of at most {LONGEST} characters",
        )
    if said and not demand.matches(said):
        raise RigctlError(
            f"the {label} does not match the procedure's pattern", value=said, expected=demand.pattern
        )
    return said


def settled(demands: IdentityFields, given: Mapping[str, str | None]) -> tuple[Identity, tuple[str, ...]]:
    """Return the given fields, completed with the defaults, and the names of missing required fields.

    Raises
    ------
    RigctlError
        as `checked`; also for an empty text for a field that has a default.
    """
    found: dict[str, str] = {}
    for name in NAMES:
        text = given.get(name)
        demand: IdentityField = getattr(demands, name)
        found[name] = checked(demands, name, text) if text is not None else demand.default or ""
        if not found[name] and demand.default:
            # an empty text, for example from a scanner that read nothing, does not stand for the default
            raise RigctlError(
                f"the {name.replace('_', ' ')} is empty",
                expected=f"a text, or nothing at all for the procedure's default, '{demand.default}'",
            )
    missing = tuple(name for name in NAMES if getattr(demands, name).required and not found[name])
    return Identity(**found), missing

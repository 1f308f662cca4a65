"""An effect file as a user writes it."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rigctl.effects.declaration import Ends
from rigctl.effects.validity import Tier
from rigctl.errors import RigctlError
from rigctl.files.quantity import AnyQuantity
from rigctl.files.refusal import refusal

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
Text = Annotated[str, Field(min_length=1)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ParameterField(_Part):
    """A parameter of the effect. Its unit is that of `start`.

    A temperature in degC is a point on the scale, one in K an interval.
    """

    start: AnyQuantity = Field(description="a typical size, where a fit begins, with its unit")
    null_value: AnyQuantity | None = Field(
        default=None,
        description="the value that switches the effect off exactly; without it the parameter only shapes",
    )
    bounds: tuple[AnyQuantity, AnyQuantity] = Field(description="the lowest and the highest value")
    grid: tuple[AnyQuantity, ...] = Field(
        default=(),
        description="values at which a diagnosis looks for the effect: of a shape, those besides its start; "
        "of a parameter that switches the effect on at a threshold, those in place of its null value, where "
        "its slope says nothing",
    )
    physical: Ends | None = Field(
        default=None,
        description="which of the bounds physics sets, so that no diagnosis looks beyond: low, high, both or "
        "none; if left out, only a bound that is the null value",
    )
    meaning: str = Field(default="", description="its symbol and what it stands for")


class ProvenanceField(_Part):
    """What the effect was learned from."""

    runs: tuple[Text, ...] = Field(default=(), description="ids of the runs")
    model: str = Field(default="", description="the model beside which it was learned")
    method: int | None = Field(
        default=None, ge=1, strict=True, description="the version of the method that found it"
    )
    date: str = Field(default="", pattern=r"^(\d{4}-\d{2}-\d{2})?$", description="the day, e.g. 2026-11-22")
    tier: Tier | None = Field(
        default=None,
        description="A: a dimensionless coefficient beside declared parameters; B: one coefficient with a "
        "dimension of its own; curve: a table of measured points; law: a law of the library in another shape",
    )
    statement: str = Field(default="", description="in words")


class EffectFile(_Part):
    """One piece of physics that a model may lack: what it adds, where, and what switches it off."""

    effect: Name = Field(description="its name, e.g. seal_breathing")
    family: str = Field(
        default="hydraulic_cylinder",
        description="the family of models it belongs to: its name, or a family file",
    )
    summary: Text = Field(description="one sentence")
    slot: str | None = Field(default=None, description="where it acts: 'rigctl effects list --slots'")
    term: Text | None = Field(default=None, description="what it adds there, or the factor that it is")
    terms: dict[str, Text] = Field(
        default_factory=dict, description="slots and their terms, when it acts at more than one"
    )
    parameters: dict[Name, ParameterField] = Field(min_length=1, description="by name")
    equation: str = Field(default="", description="as a person writes it; else the terms stand for it")
    source: str = Field(default="", description="where the equation comes from")
    looks_like: str = Field(default="", description="what it does to the recorded data")
    confused_with: tuple[str, ...] = Field(
        default=(), description="effects that do nearly the same to the data"
    )
    instead_of: tuple[str, ...] = Field(
        default=(), description="effects that it contradicts: a model has one or the other"
    )
    needs: str | None = Field(default=None, description="what the data must hold for it to show")
    valid: dict[Text, tuple[AnyQuantity, AnyQuantity]] = Field(
        default_factory=dict,
        description="the range over which its law was learned, lowest and highest, of each quantity: a "
        "variable or a parameter of the model, or a formula of these, e.g. 'pressure_a - pressure_b'",
    )
    provenance: ProvenanceField | None = Field(default=None, description="what it was learned from")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        short = (self.slot is not None, self.term is not None)
        if self.terms and any(short):
            raise refusal(RigctlError("'terms' and 'slot' with 'term' say the same", expected="one of them"))
        if not self.terms and not all(short):
            missing = "slot" if short == (False, True) else "term"
            if not any(short):
                raise refusal(
                    RigctlError("the effect adds nothing", expected="'slot' and 'term', or 'terms'")
                )
            raise refusal(RigctlError(f"the field '{missing}' is missing"))
        return self

    @property
    def by_slot(self) -> dict[str, str]:
        """The term at each slot, however it was written."""
        if self.slot is not None and self.term is not None:
            return {self.slot: self.term}
        return dict(self.terms)

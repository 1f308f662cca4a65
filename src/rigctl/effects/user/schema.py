"""An effect file as a user writes it.

The fields, their types, and what can be decided without the family: whether there is one way of stating the
term, and whether a curve's points and band are in order. Names, units and formulas are read in
`rigctl.effects.user.load`, which knows the family. The descriptions of the fields are in the schema that
`rigctl schema effect` prints.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, model_validator

from rigctl.effects.declaration import Ends
from rigctl.effects.validity import Tier
from rigctl.errors import RigctlError
from rigctl.files.quantity import AnyQuantity
from rigctl.files.refusal import refusal

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
Text = Annotated[str, Field(min_length=1)]

#: a unit; YAML reads a plain 1 as a number
UnitText = Annotated[
    str, BeforeValidator(lambda written: "1" if written == 1 and written is not True else written)
]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


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


class CurveField(_Part):
    """A measured curve that is the term itself."""

    of: Text = Field(
        description="what it is a curve of: a variable of the model, or a formula of several, e.g. "
        "'pressure_a - pressure_b'"
    )
    over: UnitText = Field(description="the unit of that")
    unit: UnitText = Field(default="1", description="the unit of the values; a factor has none")
    points: tuple[tuple[FiniteFloat, FiniteFloat], ...] = Field(
        min_length=2, max_length=200, description="[x, y] in these units, x rising"
    )
    band: tuple[tuple[FiniteFloat, FiniteFloat], ...] = Field(
        default=(),
        description="[lowest, highest] value at each point, between which the curve lies in 95 of 100 cases",
    )
    beyond: Literal["level", "line"] = Field(
        default="level", description="beyond its ends it levels off, or goes on as a straight line"
    )

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if any(after[0] <= before[0] for before, after in pairwise(self.points)):
            raise refusal(RigctlError("the points of a curve must have rising x"), ("points",))
        if self.band and len(self.band) != len(self.points):
            raise refusal(
                RigctlError(
                    "the band has another number of points than the curve",
                    value=str(len(self.band)),
                    expected=str(len(self.points)),
                ),
                ("band",),
            )
        for (x, y), (low, high) in zip(self.points, self.band, strict=False):
            if not low <= y <= high:
                wrong = RigctlError(
                    f"the band at {x:g} {self.over} does not hold the curve",
                    value=f"[{low:g}, {high:g}]",
                    expected=f"{y:g} between them",
                )
                raise refusal(wrong, ("band",))
        return self


class ProvenanceField(_Part):
    """What the effect was learned from."""

    runs: tuple[Text, ...] = Field(default=(), description="ids of the runs")
    model: str = Field(default="", description="the model beside which it was learned")
    method: int | None = Field(
        default=None, ge=1, strict=True, description="the version of the method that found it"
    )
    discovery: int | None = Field(
        default=None, ge=1, strict=True, description="the version of the search for formulas, if it found it"
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
    curve: CurveField | None = Field(
        default=None,
        description="instead of 'term': a measured curve, times a 'factor' that is fitted; 0 switches it off",
    )
    parameters: dict[Name, ParameterField] = Field(
        default_factory=dict, description="by name; a curve brings its own"
    )
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
        if self.curve is not None:
            return self._one_curve()
        if not self.parameters:
            raise refusal(RigctlError("no parameter switches the effect off", expected="'parameters'"))
        short = (self.slot is not None, self.term is not None)
        if self.terms and any(short):
            raise refusal(RigctlError("'terms' and 'slot' with 'term' say the same", expected="one of them"))
        if not self.terms and not all(short):
            missing = "slot" if short == (False, True) else "term"
            if not any(short):
                raise refusal(
                    RigctlError(
                        "the effect adds nothing",
                        expected="'slot' and 'term', 'slot' and 'curve', or 'terms'",
                    )
                )
            raise refusal(RigctlError(f"the field '{missing}' is missing"))
        return self

    def _one_curve(self) -> Self:
        for field in ("term", "terms", "parameters"):
            if getattr(self, field):
                wrong = RigctlError(
                    f"an effect with a curve has no '{field}'", hint="The curve brings its own"
                )
                raise refusal(wrong, (field,))
        if self.slot is None:
            raise refusal(RigctlError("the field 'slot' is missing"))
        return self

    @property
    def by_slot(self) -> dict[str, str]:
        """The term at each slot, however it was written."""
        if self.slot is not None and self.term is not None:
            return {self.slot: self.term}
        return dict(self.terms)

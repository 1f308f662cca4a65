"""A family file as a user writes it.

The fields, their types, and what can be decided without reading a formula. Names, units and numbers are read
in `rigctl.physics.user.declare`, formulas in `rigctl.physics.user.equations`. The descriptions of the fields
are in the schema that `rigctl schema family` prints.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    GetJsonSchemaHandler,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rigctl.errors import RigctlError
from rigctl.files.name import Name as BenchName
from rigctl.files.quantity import AnyQuantity, Q
from rigctl.files.refusal import refusal

#: names used in model files; states, inputs and outputs are named as the bench's channels
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
Formula = Annotated[str, Field(min_length=1)]


def _as_text(written: object) -> object:
    """A plain number is a formula too: ``rate: 1``."""
    number = isinstance(written, int | float) and not isinstance(written, bool)
    return repr(written) if number else written


FormulaOrNumber = Annotated[Formula, BeforeValidator(_as_text, json_schema_input_type=str | float)]

#: limit for a standard record, since trying an effect on more samples is slow
_MOST_SAMPLES = 20_000

_FORMULA = "of the file's names, with + - * / ^, sqrt, exp, log, tanh, sin, cos and smooth switches"


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class QuantityOrMapping(_Part):
    """A quantity alone, which is the `value` of the mapping."""

    @model_validator(mode="before")
    @classmethod
    def _value_alone(cls, written: object) -> object:
        return written if isinstance(written, Mapping | QuantityOrMapping) else {"value": written}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """A quantity alone, or the mapping."""
        mapping = handler.resolve_ref_schema(handler(schema))
        properties: dict[str, Any] = mapping["properties"]
        return {"anyOf": [properties["value"], mapping]}


class StartField(QuantityOrMapping):
    """Where a state begins: ``20 degC``, or ``{value: 20 degC, std: 3 K}`` where records differ."""

    value: AnyQuantity = Field(description="with its unit")
    std: AnyQuantity | None = Field(
        default=None,
        description="how far a record may begin from it, one standard deviation: an unknown of each record "
        "in which no channel of the state's name says it",
    )


class StateField(_Part):
    """A quantity with a derivative. Its unit is that of `start`."""

    start: StartField = Field(description="its value when nothing else is known, with its unit")
    scale: AnyQuantity = Field(description="a change of it that matters, for the solver's tolerance")
    rate: FormulaOrNumber = Field(description=f"its derivative: a formula {_FORMULA}")
    meaning: str = Field(default="", description="what it is")


class InputField(_Part):
    """A quantity that is commanded or given from outside. Its unit is that of `value`."""

    value: AnyQuantity = Field(description="what it is when nobody says, with its unit")
    role: Literal["move", "heat", "set_pressure"] | None = Field(
        default=None,
        description="the rig's role whose actuator commands it; else the actuator of its own name does",
    )
    hold: Literal["previous", "linear"] | None = Field(
        default=None,
        description="between two values: the previous one, or a straight line; when left out, commands hold "
        "and measured channels are lines",
    )
    delay: Formula | None = Field(
        default=None, description="the time until its switches act; may use `before` and `after`"
    )
    meaning: str = Field(default="", description="what it is")


class ParameterField(_Part):
    """A constant that a fit may change. Its unit is that of `value`."""

    value: AnyQuantity = Field(description="where a model starts from, with its unit")
    bounds: tuple[AnyQuantity, AnyQuantity] = Field(description="the lowest and the highest value")
    standing: Literal["measured", "assumed", "exact"] | None = Field(
        default=None, description="how well the value is known; an assumed one is a guess"
    )
    range: tuple[AnyQuantity, AnyQuantity] | None = Field(
        default=None,
        description="of an assumed value, within which fits let it be anything; by default half to twice it",
    )
    meaning: str = Field(default="", description="its symbol and what it stands for")


class ConstantField(QuantityOrMapping):
    """A number that no fit changes: ``9.80665 m/s^2``, or ``{value: 50 mm, meaning: bore}``."""

    value: AnyQuantity = Field(description="with its unit; a rig file may have its own of the same name")
    standing: Literal["measured", "assumed", "exact"] | None = Field(
        default=None, description="how well the value is known; an assumed one is a guess"
    )
    range: tuple[AnyQuantity, AnyQuantity] | None = Field(
        default=None,
        description="of an assumed value, within which fits let it be anything; by default half to twice it",
    )
    meaning: str = Field(default="", description="what it is")


class FormulaField(_Part):
    """A value that a formula gives."""

    unit: str = Field(
        description="of its value; a temperature in degC is a point on the scale, in K a difference"
    )
    formula: FormulaOrNumber = Field(description=f"a formula {_FORMULA}")
    meaning: str = Field(default="", description="what it is")


class TableField(_Part):
    """A look-up table: a curve through points, used as ``table(x, name)``."""

    over: str = Field(description="the unit of what it is looked up by")
    unit: str = Field(description="the unit of its values; a temperature in degC is a point on the scale")
    points: tuple[tuple[FiniteFloat, FiniteFloat], ...] = Field(
        min_length=2, max_length=200, description="[x, y] in these units, x rising"
    )
    kind: Literal["cubic", "linear"] = Field(
        default="cubic",
        description="between the points: monotone and smooth, or straight with rounded corners",
    )
    meaning: str = Field(default="", description="what it is")

    @model_validator(mode="after")
    def _rising(self) -> Self:
        x = [point[0] for point in self.points]
        if any(after <= before for before, after in pairwise(x)):
            raise refusal(RigctlError("the points of a table must have rising x"), ("points",))
        return self


class SlotField(_Part):
    """A place where effects act; a formula that names it has there what they add, or the factor they are."""

    unit: str = Field(default="1", description="of what is added there; a factor has none")
    combine: Literal["sum", "product"] = Field(
        default="sum", description="sum: 0 without effects; product: 1 without effects"
    )
    kind: Literal["process", "sensor", "command"] = Field(
        default="process", description="whether the bench, a sensor or the time of a command changes"
    )
    meaning: str = Field(default="", description="what acts there")


class SwitchField(_Part):
    """A moment of the standard record, and what is commanded from then on."""

    at: Annotated[float, Q("s", low="0 s")] = Field(description="seconds after the start")
    set: dict[BenchName, AnyQuantity] = Field(min_length=1, description="input: its value")


class RecordField(_Part):
    """A record in which every effect shows: `rigctl effects show` and `check` try effects on it."""

    description: str = Field(default="", description="for people")
    duration: Annotated[float, Q("s", positive=True)] = Field(description="from the start to the last sample")
    rate: Annotated[float, Q("Hz", positive=True)] = Field(description="samples per second")
    switches: tuple[SwitchField, ...] = Field(min_length=1, description="what is commanded when")
    initial: dict[BenchName, AnyQuantity] = Field(
        default_factory=dict, description="states that do not start as they usually do"
    )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.duration * self.rate > _MOST_SAMPLES:
            raise refusal(RigctlError("too many samples", expected=f"at most {_MOST_SAMPLES}"), ("rate",))
        times = [switch.at for switch in self.switches]
        if times != sorted(times) or times[-1] > self.duration:
            raise refusal(RigctlError("the switches are out of order, or after the end"), ("switches",))
        return self


class FamilyFile(_Part):
    """One kind of bench: its states, what is commanded, its parameters and equations, what is read."""

    family: Name = Field(description="its name, e.g. water_tank")
    title: str = Field(default="", description="one line about it")
    source: str = Field(default="", description="where the equations come from")
    states: dict[BenchName, StateField] = Field(
        default_factory=dict,
        description="what changes with time, by name; none where the outputs follow the inputs at once",
    )
    inputs: dict[BenchName, InputField] = Field(
        default_factory=dict, description="what is commanded, or given from outside"
    )
    parameters: dict[Name, ParameterField] = Field(
        default_factory=dict, description="constants that a fit may change"
    )
    constants: dict[Name, ConstantField] = Field(
        default_factory=dict, description="numbers that no fit changes: dimensions, constants of nature"
    )
    definitions: dict[Name, FormulaField] = Field(
        default_factory=dict, description="what several formulas use, in any order"
    )
    tables: dict[Name, TableField] = Field(
        default_factory=dict, description="curves through points, e.g. of a pump or a sensor"
    )
    slots: dict[Name, SlotField] = Field(default_factory=dict, description="where effects may act")
    outputs: dict[BenchName, FormulaField] = Field(
        min_length=1, description="what sensors read, by the channels' names"
    )
    generic_effects: bool = Field(
        default=True,
        description="offer friction, leaks, lags and the like wherever they fit; slots are derived when "
        "there are none",
    )
    standard_record: RecordField | None = Field(default=None, description="what effects are tried on")

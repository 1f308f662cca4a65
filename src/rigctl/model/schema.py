"""A model file as a user writes it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from rigctl.files.quantity import AnyQuantity
from rigctl.physics.user.schema import QuantityOrMapping

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class Known(_Part):
    """Prior knowledge of a parameter: ``{value: 12 kg, std: 3 kg}``."""

    value: AnyQuantity = Field(description="the data sheet's or the scales', with its unit")
    std: AnyQuantity = Field(description="how far it is trusted: a standard deviation, with its unit")


class Setting(QuantityOrMapping):
    """A parameter's value: ``4.05 mm^2``, or ``{value: 4.05 mm^2, fit: true, std: 0.01 mm^2, from: ...}``."""

    value: AnyQuantity = Field(description="with its unit")
    fit: bool = Field(default=False, description="whether a fit or a diagnosis may change it")
    std: AnyQuantity | None = Field(
        default=None, description="standard deviation of the value, with its unit"
    )
    prior: Known | None = Field(
        default=None, description="what is known before any fit, which every fit weighs with the data"
    )
    standing: Literal["measured", "assumed", "exact"] | None = Field(
        default=None,
        description="how well the value is known, where no fit changes it: measured, assumed (a guess, which "
        "fits let be anything in its range) or exact; without it, that of the family file for the same "
        "value, else exact",
    )
    range: tuple[AnyQuantity, AnyQuantity] | None = Field(
        default=None, description="of an assumed value; by default half to twice it"
    )
    source: str = Field(
        default="", alias="from", description="where the value comes from: a fit, a data sheet"
    )


def _nothing(written: object) -> object:
    """A heading with nothing below it is an empty mapping."""
    return {} if written is None else written


class ModelFile(_Part):
    """A family, the bench it is of, and the values of its parameters and effects."""

    model: str = Field(description="the model family, e.g. hydraulic_cylinder, or a family file")
    description: str = Field(default="", description="for reports")
    rig: str | None = Field(default=None, description="the bench's rig file")
    oil: str | None = Field(default=None, description="the fluid, instead of the rig's")
    parameters: Annotated[dict[Name, Setting], BeforeValidator(_nothing)] = Field(
        default_factory=dict, description="of the family"
    )
    effects: Annotated[
        dict[Name, Annotated[dict[Name, Setting], BeforeValidator(_nothing)]], BeforeValidator(_nothing)
    ] = Field(default_factory=dict, description="what the model has besides its base, by name")
    own_effects: tuple[str, ...] = Field(
        default=(),
        description="effect files of one's own, or folders of them, whose names 'effects' may then use",
    )

"""Sensors that a bench could have: what they would measure, their noise, and their price."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator, Field, WithJsonSchema

from rigctl.errors import RigctlError
from rigctl.files.amount import AnyAmount, AnyDifference
from rigctl.files.refusal import refusal
from rigctl.rig.base import RigFilePart
from rigctl.rig.channel import Channel, QuantityName

_PRICE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([^\d\s]\S*)?\s*")


@dataclass(frozen=True)
class Price:
    """An amount of money in the currency written with it, as in ``180 EUR``; "" if there is none."""

    amount: float
    currency: str = ""

    def __str__(self) -> str:
        """The price with its currency, as in the rig file."""
        return f"{self.amount:g} {self.currency}".strip()


def _price(written: object) -> Price:
    if isinstance(written, Price):
        return written
    found = None if isinstance(written, bool) else _PRICE.fullmatch(str(written))
    if found is None:
        raise refusal(RigctlError("no price", value=str(written), expected="e.g. 180 EUR"))
    return Price(float(found[1]), found[2] or "")


AnyPrice = Annotated[
    Price,
    BeforeValidator(_price),
    WithJsonSchema({"type": ["string", "number"], "examples": ["180 EUR"]}),
]


class PossibleChannel(RigFilePart):
    """A sensor that could be added to the bench; `rigctl design --sensors` evaluates its benefit."""

    unit: str = Field(description="its display unit, e.g. bar")
    quantity: QuantityName = Field(description="the quantity to be measured")
    description: str = Field(default="", description="type and place, for reports")
    reads: str = Field(
        default="",
        description="the state, definition or output of the model family that it reads, e.g. "
        "pressure_a; by default its own name",
    )
    noise: AnyDifference = Field(description="standard deviation of one reading, from the data sheet")
    range: tuple[AnyAmount, AnyAmount] | None = Field(default=None, description="its measuring range")
    price: AnyPrice | None = Field(default=None, description="approximate price, e.g. 180 EUR")

    @property
    def channel(self) -> Channel:
        """The channel that the sensor would be."""
        return Channel(
            unit=self.unit,
            quantity=self.quantity,
            description=self.description,
            noise=self.noise,
            range=self.range,
        )

"""Interlocks: what warns, and what stops a run."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.amount import AnyAmount, AnyDifference
from rigctl.files.quantity import Q
from rigctl.files.refusal import refusal
from rigctl.rig.base import Part

_BOUNDS = ("above", "below", "rate_above", "rate_below")


class Limit(Part):
    """One bound of one channel: on its value, or on its rate of change over the last `over` seconds.

    It trips when the bound is exceeded for longer than `for`, and then warns, or stops the run.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", defer_build=True, validate_by_alias=True, validate_by_name=True
    )

    channel: str
    above: AnyAmount | None = Field(default=None, description="trips when the value is larger")
    below: AnyAmount | None = Field(default=None, description="trips when the value is smaller")
    rate_above: AnyDifference | None = Field(default=None, description="trips when it rises faster")
    rate_below: AnyDifference | None = Field(
        default=None, description="trips when it falls faster (negative)"
    )
    over: Annotated[float, Q("s", positive=True)] = Field(
        default=1.0, description="the interval over which a rate is calculated"
    )
    for_: Annotated[float, Q("s", low="0 s")] = Field(
        default=0.0, alias="for", description="duration before it trips"
    )
    action: Literal["warn", "stop"] = Field(default="stop", description="action on tripping")
    message: str = Field(default="", description="message for the operator")

    @model_validator(mode="after")
    def _one_bound(self) -> Self:
        given = [name for name in _BOUNDS if getattr(self, name) is not None]
        if len(given) != 1:
            what = "a limit needs a bound" if not given else f"a limit has one bound, here {', '.join(given)}"
            raise refusal(RigctlError(what, expected="one of " + ", ".join(_BOUNDS)))
        return self

    @property
    def bound(self) -> Literal["above", "below", "rate_above", "rate_below"]:
        """Which of the four bounds it is."""
        for name in ("above", "below", "rate_above"):
            if getattr(self, name) is not None:
                return name
        return "rate_below"

    @property
    def threshold(self) -> float:
        """The bound in SI (per second for a rate)."""
        return float(getattr(self, self.bound))

    @property
    def of_rate(self) -> bool:
        """True when it bounds the rate of change."""
        return self.bound.startswith("rate")

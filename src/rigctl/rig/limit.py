"""Interlocks: limits that warn, and limits that stop a run."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.amount import AnyAmount, AnyRate
from rigctl.files.quantity import Q
from rigctl.files.refusal import refusal
from rigctl.rig.base import RigFilePart

_BOUNDS = ("above", "below", "rate_above", "rate_below", "unchanged")


class Limit(RigFilePart):
    """One bound of one channel: on its value, its rate of change over the last `over` seconds, or standstill.

    It trips when the bound has been exceeded for `for`, without a break or in total within `out_of`, or when
    the reading has stayed exactly the same for `unchanged`, and then warns, or stops the run. A reading
    outside the channel's `range` is no value: it is neither inside a limit nor outside.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", defer_build=True, validate_by_alias=True, validate_by_name=True
    )

    channel: str
    above: AnyAmount | None = Field(default=None, description="trips when the value is larger")
    below: AnyAmount | None = Field(default=None, description="trips when the value is smaller")
    rate_above: AnyRate | None = Field(default=None, description="trips when it rises faster")
    rate_below: AnyRate | None = Field(default=None, description="trips when it falls faster (negative)")
    unchanged: Annotated[float, Q("s", positive=True)] | None = Field(
        default=None,
        description="trips when the reading stays exactly the same for this long: a stuck sensor",
    )
    while_on: str | None = Field(
        default=None,
        description="for `unchanged`: an actuator; time counts only while it is commanded off its safe value",
    )
    over: Annotated[float, Q("s", positive=True)] = Field(
        default=1.0, description="the interval over which a rate is calculated"
    )
    for_: Annotated[float, Q("s", low="0 s")] = Field(
        default=0.0, alias="for", description="duration before it trips"
    )
    out_of: Annotated[float, Q("s", positive=True)] | None = Field(
        default=None,
        description="the time within which it may add up to `for`; by default twice `for`; no more than "
        "`for`: without a break",
    )
    action: Literal["warn", "stop"] = Field(default="stop", description="action on tripping")
    message: str = Field(default="", description="message for the operator")

    @model_validator(mode="after")
    def _one_bound(self) -> Self:
        given = [name for name in _BOUNDS if getattr(self, name) is not None]
        if len(given) != 1:
            what = "a limit needs a bound" if not given else f"a limit has one bound, here {', '.join(given)}"
            raise refusal(RigctlError(what, expected="one of " + ", ".join(_BOUNDS)))
        if self.unchanged is None and self.while_on is not None:
            raise refusal(
                RigctlError("'while_on' belongs to 'unchanged'", expected="a limit with 'unchanged'")
            )
        if self.unchanged is not None and self.for_ > 0.0:
            raise refusal(RigctlError("'unchanged' has its own duration", expected="no 'for' beside it"))
        if self.out_of is not None and not 0.0 < self.for_ <= self.out_of:
            raise refusal(
                RigctlError(
                    "'out_of' is the time in which 'for' has to add up",
                    value=f"{self.for_:g} s out of {self.out_of:g} s",
                    expected="a 'for' that is not longer, e.g. 'for: 0.5 s' with 'out_of: 1 s'",
                ),
                ("out_of",),
            )
        return self

    @property
    def bound(self) -> Literal["above", "below", "rate_above", "rate_below", "unchanged"]:
        """The kind of bound."""
        for name in ("above", "below", "rate_above", "rate_below"):
            if getattr(self, name) is not None:
                return name
        return "unchanged"

    @property
    def threshold(self) -> float:
        """The bound in SI; per s for a rate, in s for `unchanged`."""
        return float(getattr(self, self.bound))

    @property
    def window(self) -> float:
        """The time in which durations outside add up to `for`, s."""
        return 2.0 * self.for_ if self.out_of is None else self.out_of

    @property
    def of_value(self) -> bool:
        """True if the value itself is limited."""
        return self.bound in ("above", "below")

    @property
    def of_rate(self) -> bool:
        """True if the rate of change is limited."""
        return self.bound.startswith("rate")

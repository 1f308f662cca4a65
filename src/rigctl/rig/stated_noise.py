"""What a rig file says about the noise of a channel."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.amount import AnyDifference
from rigctl.files.quantity import Q
from rigctl.files.refusal import refusal
from rigctl.rig.base import RigFilePart


class StatedNoise(RigFilePart):
    """The parts of a channel's noise: one from reading to reading, and one that changes slowly.

    Their variances add up. Readings a time t apart have the covariance ``slow²·exp(−t/over)``.
    """

    white: AnyDifference | None = Field(
        default=None, description="standard deviation of the part that differs from reading to reading"
    )
    slow: AnyDifference | None = Field(
        default=None, description="standard deviation of the part that changes slowly: drift, 1/f, hum"
    )
    over: Annotated[float, Q("s", positive=True)] | None = Field(
        default=None, description="time over which the slow part changes, e.g. '60 s'"
    )

    @model_validator(mode="after")
    def _complete(self) -> StatedNoise:
        if self.white is None and self.slow is None:
            raise refusal(RigctlError("it states no noise", expected="white, slow and over, or a number"))
        if (self.slow is None) != (self.over is None):
            missing = "over" if self.over is None else "slow"
            raise refusal(
                RigctlError(
                    f"a slow noise needs '{missing}' too",
                    expected="e.g. {white: 0.1 K, slow: 0.3 K, over: 60 s}",
                )
            )
        return self

    @property
    def total(self) -> float:
        """SI, standard deviation of one reading."""
        return math.hypot(self.white or 0.0, self.slow or 0.0)

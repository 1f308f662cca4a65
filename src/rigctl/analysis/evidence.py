"""A piece of evidence for or against a verdict, as values: `rigctl.answers.evidence` words it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

Quantity = Literal[
    "power",
    "record_level",
    "size",
    "joint_size",
    "mbic",
    "left_out_error",
    "absorbed",
    "rival",
    "left_alone",
    "levels",
    "scatter",
    "sensor_error",
    "exact_sensors",
    "left_with_exact_sensors",
    "drift",
]


@dataclass(frozen=True)
class Evidence:
    """A piece of evidence.

    Attributes
    ----------
    side: whether it speaks for or against `subject`, the effects that it is about; "" for neither.
    quantity: what was computed.
    value, threshold: of it, and what it was compared with; NaN for what is no number.
    finding: the result that has the rest of it.
    stated: whether the statement of the verdict has it already.
    """

    side: Literal["for", "against", ""]
    subject: tuple[str, ...]
    quantity: Quantity
    value: float = math.nan
    threshold: float = math.nan
    finding: Any = field(default=None, repr=False)
    stated: bool = False

"""A piece of evidence for or against a verdict, as values: `rigctl.answers.findings.evidence` words it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from rigctl.analysis.agreement.record_level import RecordQuantity
from rigctl.analysis.agreement.sensors import SensorBudget
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search.identity import Levels
from rigctl.analysis.search.rivals import Rival

if TYPE_CHECKING:
    from rigctl.analysis.diagnosis_result import Diagnosis, Drift, Ranked

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
class IfExact:
    """What would be missing if the sensors that have these errors were exact."""

    sensors: SensorBudget
    diagnosis: Diagnosis


#: the result that has the rest of a piece of evidence; names of effects, or of a parameter
Finding: TypeAlias = (
    "tuple[str, ...] | str | RecordQuantity | Ranked | CrossValidation | Rival | Levels | SizeScatter"
    " | SensorBudget | IfExact | Drift | None"
)


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
    finding: Finding = field(default=None, repr=False)
    stated: bool = False

"""The range of validity of an effect's law, and its origin.

A law learned from data holds over the range of these data; beyond it, its continuation is unknown. The
validity box gives that range, the provenance the runs and the method from which the law was learned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from rigctl.physics.family import Formula
from rigctl.units import parse_unit, show

#: strength of the claim: a dimensionless coefficient with groups of declared parameters (A), one dimensional
#: coefficient (B), a curve through measured points, a law of the library with another shape
Tier: TypeAlias = Literal["A", "B", "curve", "law"]


@dataclass(frozen=True)
class ValidRange:
    """One side of a validity box; SI, `unit` is the one in which it is shown.

    Attributes
    ----------
    over: the quantity as written: ``velocity``, ``pressure_a - pressure_b``.
    formula: the same in terms of the model's variables.
    difference: a temperature difference.
    """

    over: str
    unit: str
    low: float
    high: float
    formula: Formula
    difference: bool = False

    def shown(self, si: float) -> str:
        """A value of the quantity in its unit."""
        return show(si, self.unit, difference=self.difference)

    def __str__(self) -> str:
        """For display: ``velocity from 0 m/s to 0.3 m/s``."""
        return f"{self.over} from {self.shown(self.low)} to {self.shown(self.high)}"

    def document(self) -> dict[str, Any]:
        """Its machine-readable form, in its unit."""
        unit = parse_unit(self.unit)
        low, high = (unit.from_si(end, difference=self.difference) for end in (self.low, self.high))
        return {
            "over": self.over,
            "unit": self.unit,
            "low": float(f"{low:.12g}"),
            "high": float(f"{high:.12g}"),
        }


@dataclass(frozen=True)
class Provenance:
    """The origin of a learned law.

    Attributes
    ----------
    runs: the ids of the runs.
    model: the model with which it was learned; "" if unknown.
    method: the version of the method that found it; None if a person did.
    discovery: the version of the search for formulas; None if it was not the result of one.
    date: ISO, the day on which it was found.
    tier: strength of the claim.
    statement: in words.
    """

    runs: tuple[str, ...] = ()
    model: str = ""
    method: int | None = None
    discovery: int | None = None
    date: str = ""
    tier: Tier | None = None
    statement: str = ""

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "runs": list(self.runs),
            "model": self.model,
            "method": self.method,
            "discovery": self.discovery,
            "date": self.date,
            "tier": self.tier,
            "statement": self.statement,
        }

    def __str__(self) -> str:
        """For display: ``tier B, found 2026-11-22 by method 12 from 20261121-064412-campaign``."""
        words = [] if self.tier is None else [TIERS[self.tier]]
        origin = [f"found {self.date}"] if self.date else []
        origin += [f"by method {self.method}"] if self.method is not None else []
        origin += [f"and search {self.discovery}"] if self.discovery is not None else []
        origin += [f"from {', '.join(self.runs)}"] if self.runs else []
        origin += [f"beside {self.model}"] if self.model else []
        words += [" ".join(origin)] if origin else []
        text = ", ".join(words)
        return f"{text}: {self.statement}" if text and self.statement else text or self.statement


#: descriptions of the tiers
TIERS: dict[Tier, str] = {
    "A": "tier A (dimensionless coefficient)",
    "B": "tier B (one coefficient with a dimension)",
    "curve": "a measured curve",
    "law": "a law of the library in another shape",
}

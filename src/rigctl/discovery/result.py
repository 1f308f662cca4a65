"""The result of a search for a formula, for people and for programs.

`Discovery` holds what each step found, whatever the next one did: the gate, the locations, the curves and
the formulas. The words are made in `rigctl.answers`.

It has a set of formulas and not a winner: all that these data do not distinguish from the best. A formula
is `accepted` only if it predicts conditions that were left out, and leaves no more of the misfit than the
right one may; for a single record nothing can be left out, and none is. `where` names every location that
the data allow for the term.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rigctl.analysis.decision_levels import STAND_IN
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.discovery.curve import Curve
from rigctl.discovery.dimensions import Tier
from rigctl.discovery.formula_fit import Fitted
from rigctl.discovery.gate import Gate
from rigctl.discovery.locate import Located, Map
from rigctl.json_values import finite_or_none
from rigctl.notebook import as_html, documented, one_line, worded
from rigctl.units import parse_unit, show, with_uncertainty

if TYPE_CHECKING:
    import pandas as pd

#: why a formula is not accepted: no second record; not determined without, or does not predict, what could be
#: left out; only resembles what is missing
FormulaDoubt = Literal["one_record", "not_determined", "not_predicted", "resembles"]


@dataclass(frozen=True)
class FormulaParameter:
    """A fitted parameter of a formula, in the unit in which it is shown; `std` is NaN if unknown."""

    value: float
    unit: str
    std: float

    def __str__(self) -> str:
        """As displayed, e.g. ``37.3 ± 0.9 mm``."""
        return with_uncertainty(self.value, self.std, self.unit)


@dataclass(frozen=True)
class FoundFormula:
    """One formula of the set.

    Attributes
    ----------
    fitted: in the model.
    term: as written in its effect file.
    tier: strength of the claim, by its dimensions.
    parameters: by name.
    delta: its cost less that of the best of the set.
    check: its cross-validation over the conditions; None for a single record.
    passive: ``dissipates energy``, ``supplies energy``, ``both supplies and dissipates energy``, "" if
        undetermined.
    valid: (variable, lowest, highest, unit) range of the data: SI, and the unit in which they are shown.
    p_value_after: of the tests of the model with it.
    left: the share of the squared misfit that it leaves.
    file: the effect file, if one was written.
    """

    fitted: Fitted = field(repr=False)
    term: str
    tier: Tier
    parameters: Mapping[str, FormulaParameter]
    delta: float
    check: CrossValidation | None
    passive: str
    valid: tuple[tuple[str, float, float, str], ...]
    p_value_after: float
    left: float
    file: Path | None = None

    @property
    def name(self) -> str:
        """The name of its effect."""
        return self.fitted.formula.name

    @property
    def slot(self) -> str:
        """The slot where it acts."""
        return self.fitted.formula.slot.name

    @property
    def alike(self) -> tuple[str, ...]:
        """Other formulas that are equivalent for these data."""
        return tuple(one.name for one in self.fitted.formula.same)

    @property
    def accepted(self) -> bool:
        """Whether it passes cross-validation, and leaves no more of the misfit than the right one may; False
        for a single record, as nothing can be left out.
        """
        return not self.doubt

    @property
    def doubt(self) -> FormulaDoubt | None:
        """Why it is not accepted; None if it is."""
        if self.check is None:
            return "one_record"
        if not self.check.possible:
            return "not_determined"
        if not self.check.passed:
            return "not_predicted"
        return "resembles" if self.left > STAND_IN else None

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        check = self.check
        return {
            "effect": self.name,
            "slot": self.slot,
            "formula": self.term,
            "tier": self.tier.letter,
            "tier_statement": worded(self.tier, "discovery.tier_statement"),
            "parameters": {
                name: {"value": one.value, "unit": one.unit, "std": finite_or_none(one.std)}
                for name, one in self.parameters.items()
            },
            "delta": self.delta,
            "alike": list(self.alike),
            "accepted": self.accepted,
            "heldout_before": None if check is None else finite_or_none(check.before),
            "heldout_after": None if check is None else finite_or_none(check.after),
            "folds": 0 if check is None else check.folds,
            "p_value_after": self.p_value_after,
            "share_left": self.left,
            "passive": self.passive,
            "valid": [
                {"over": name, "low": _in_unit(low, unit), "high": _in_unit(high, unit), "unit": unit}
                for name, low, high, unit in self.valid
            ],
            "file": None if self.file is None else self.file.as_posix(),
        }

    @property
    def valid_text(self) -> str:
        """``position from -0.14 m to 0.13 m``."""
        return ", ".join(
            f"{name} from {show(low, unit)} to {show(high, unit)}" for name, low, high, unit in self.valid
        )


@dataclass(frozen=True)
class Where:
    """A slot, and the variables of a term there."""

    slot: str
    over: tuple[str, ...]

    @staticmethod
    def of(located: Located) -> Where:
        """From a location."""
        return Where(located.slot.name, tuple(sorted(driver.name for driver in located.over)))

    def __str__(self) -> str:
        """``friction over position and velocity``."""
        return f"{self.slot} over {' and '.join(self.over)}"


@dataclass(frozen=True)
class Discovery:
    """The result of a search.

    Attributes
    ----------
    runs: the ids; `model` its name.
    gate: whether a search was worthwhile.
    searched: every location and variable; None if the gate is closed.
    curves: the term over one variable, at the most probable locations.
    formulas: the set: all that these data do not distinguish from the best.
    tried: number of formulas tried.
    refuted: locations whose best formulas were refitted and are worse than the set.
    diagnosis: of the model as given.
    """

    runs: tuple[str, ...]
    model: str
    gate: Gate
    searched: Map | None
    curves: tuple[Curve, ...]
    formulas: tuple[FoundFormula, ...]
    tried: int
    diagnosis: Diagnosis = field(repr=False)
    refuted: frozenset[str] = frozenset()

    @property
    def located(self) -> tuple[Located, ...]:
        """Locations and variables, the most probable first."""
        return () if self.searched is None else self.searched.located

    @property
    def rivals(self) -> tuple[Located, ...]:
        """Other locations, the best of each, at which a term explains as much up to chance or the error of
        the linear model, and that no refit has refuted."""
        if not self.located:
            return ()
        best = self.located[0]
        by_slot: dict[str, Located] = {}
        for one in self.located:
            if one.explains_as_much_as(best) and one.slot.name not in (best.slot.name, *self.refuted):
                by_slot.setdefault(one.slot.name, one)
        return tuple(by_slot.values())

    @property
    def where(self) -> tuple[Where, ...]:
        """All alternatives for the term that are compatible with these data, the first formula's location
        first."""
        best = self.located[:1]
        formulas = [same for one in self.formulas for same in (one.fitted.formula, *one.fitted.formula.same)]
        alternatives = [Where(one.slot.name, one.over) for one in formulas]
        alternatives += [Where.of(one) for one in (*(() if formulas else best), *self.rivals)]
        for located in self.located:  # a term at another slot is equivalent
            if Where.of(located) in alternatives:
                alternatives += [replace(Where.of(located), slot=slot) for slot in located.alike]
        return tuple(dict.fromkeys(alternatives))

    @property
    def statement(self) -> str:
        """The result in words."""
        return worded(self, "discovery.statement")

    def document(self) -> dict[str, Any]:
        """The machine-readable answer."""
        return documented(self, "discovery_document")

    def summary(self) -> str:
        """The result in a few lines."""
        lines = [self.statement]
        lines += [f"  Δ {one.delta:4.1f}  {one.name}: {one.term}" for one in self.formulas]
        return "\n".join(lines)

    def frame(self) -> pd.DataFrame:
        """One row for each formula of the set."""
        import pandas as pd

        nested = ("parameters", "valid", "alike")
        rows = [one.document() for one in self.formulas]
        return pd.DataFrame([{k: v for k, v in row.items() if k not in nested} for row in rows])

    def __repr__(self) -> str:
        """The answer on one line."""
        state = f"{len(self.formulas)} formulas" if self.gate.open else f"closed, {self.gate.reason}"
        return one_line(self, f"of {self.model}: {state}")

    def _repr_html_(self) -> str:
        """The summary and the set, as a notebook shows them."""
        return as_html(self.summary(), self.frame())


def parameter(si: float, std: float, unit: str, *, point: bool = False) -> FormulaParameter:
    """A parameter in a unit; a `point` on the temperature scale in degC."""
    shown = parse_unit("degC") if point else parse_unit(unit)
    offset = shown.offset if point else 0.0
    return FormulaParameter((si - offset) / shown.factor, "degC" if point else unit, std / shown.factor)


def _in_unit(si: float, unit: str) -> float:
    shown = parse_unit(unit)
    return (si - shown.offset) / shown.factor

"""The machine-readable form of results that have evidence, which is given in sentences."""

from __future__ import annotations

from typing import Any

from rigctl.analysis.agreement.sensors import documents
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.improve import Improvement
from rigctl.answers.evidence import sentence
from rigctl.json_values import finite_or_none


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """The machine-readable answer."""
    exact = diagnosis.with_exact_sensors
    return {
        "runs": list(diagnosis.runs),
        "model": diagnosis.model,
        "verdict": diagnosis.verdict.value,
        "effects": list(diagnosis.effects),
        "classes": [list(names) for names in diagnosis.classes],
        "levels": [one.document() for one in diagnosis.levels],
        "laws": [one.document() for one in diagnosis.laws],
        "indistinguishable": [list(pair) for pair in diagnosis.indistinguishable],
        "ranking": [one.document() for one in diagnosis.ranking],
        "remainder": None if diagnosis.remainder is None else diagnosis.remainder.document(),
        "doubt": diagnosis.doubt,
        "decided_by": list(diagnosis.decided_by),
        "bounds": [one.document() for one in diagnosis.bounds],
        "undetermined": [one.document() for one in diagnosis.before.undetermined],
        "uncertainty_budget": [one.document() for one in diagnosis.budgets],
        "explained_by": diagnosis.before.explained_by if not diagnosis.effects else None,
        **documents(diagnosis.sensors),
        "with_exact_sensors": None
        if exact is None
        else {"verdict": exact.verdict.value, "effects": list(exact.effects)},
        "channels": diagnosis.before.channels(),
        "untestable": [{"effect": name, "needs": needs} for name, needs in diagnosis.untestable],
        "drift": [
            {
                "parameter": d.parameter,
                "before": d.before,
                "after": d.after,
                "unit": d.unit,
                "before_std": finite_or_none(d.before_std),
                "after_std": finite_or_none(d.after_std),
            }
            for d in diagnosis.drift
        ],
        "where": {"slot": diagnosis.slot, "statement": diagnosis.before.statement},
        "excluded": [one.document() for one in diagnosis.excluded],
        "excluded_because": list(diagnosis.excluded_because),
        "findings": list(diagnosis.before.findings),
        "next_steps": list(diagnosis.next_steps),
        "next_experiment": None if diagnosis.next_experiment is None else dict(diagnosis.next_experiment),
        "bootstrap": None if diagnosis.bootstrap is None else diagnosis.bootstrap.document(),
        "outside_validity": [one.document() for one in diagnosis.outside],
        "p_value": diagnosis.before.adequacy.p_value,
        "p_value_after": finite_or_none(diagnosis.p_value_after),
        "unproven_after": list(diagnosis.unproven_after),
        "held_out": list(diagnosis.held_out),
        "evidence": list(map(sentence, diagnosis.evidence)),
        "notes": list(map(str, diagnosis.notes)),
        "statement": diagnosis.statement,
    }


def improvement_document(improvement: Improvement) -> dict[str, Any]:
    """The answer of the first diagnosis, with the additions and the diagnosis of the result."""
    return {
        **diagnosis_document(improvement.first),
        "steps": [step.document() for step in improvement.steps],
        "ended": improvement.ended.value,
        "improvement": improvement.statement,
        "reason": improvement.reason,
        "after": diagnosis_document(improvement.last) if improvement.steps else None,
        "unseen": [one.document() for one in improvement.unseen],
    }

"""The machine-readable form of results that have evidence, which is given in sentences.

In: results of the analysis. Out: plain dictionaries for JSON, in the units of the rig, with missing numbers
as null. Results that need no words have a `document` of their own; these are here because they contain the
same sentences as the answers, and the analysis does not import its wording.
"""

from __future__ import annotations

from typing import Any

from rigctl.analysis.agreement.sensors import documents
from rigctl.analysis.agreement.uncertainty_budget import uncertainty_budgets
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import SURVEY_ALPHA
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.improve import Improvement
from rigctl.answers import improvement as improved
from rigctl.answers import survey as survey_words
from rigctl.answers.design import statement as design_statement
from rigctl.answers.discovery import gate_statement, notes
from rigctl.answers.findings import agreement
from rigctl.answers.findings import tables as table_findings
from rigctl.answers.findings.decided_by import decisions
from rigctl.answers.findings.evidence import sentence
from rigctl.answers.findings.verdict import doubt_text, statement
from rigctl.answers.schedule import schedule as schedules
from rigctl.answers.schedule.check import check_procedure
from rigctl.compensation.result import Schedule, in_unit
from rigctl.design.result import DesignResult, ProposedRecord
from rigctl.discovery.result import Discovery
from rigctl.json_values import finite_or_none
from rigctl.model.fit.assumptions import conditional_document, conditional_numbers
from rigctl.monitoring.entries import DATE
from rigctl.monitoring.multiplicity import Change, Tested
from rigctl.monitoring.result import Line, Survey


def comparison_document(model: ModelComparison) -> dict[str, Any]:
    """The part of one model in the machine-readable answer."""
    tests = {
        name: {"statistic": test.statistic, "p_value": test.p_value, "freedom": test.dof}
        for name, test in model.adequacy.tests.items()
    }
    given = conditional_numbers(model.fit)
    parameters = {
        unknown.name: {
            "value": float(value),
            "unit": unknown.unit,
            "std": finite_or_none(model.fit.reported_std.get(unknown.name, 0.0)),
            **conditional_document(given.get(unknown.name), unknown.unit),
        }
        for unknown, value in zip(model.fit.problem.shared, model.fit.values, strict=True)
    }
    return {
        "model": model.name,
        "adequate": model.adequacy.verdict,
        "unproven": list(model.adequacy.unproven),
        "decided_by": decisions(model.decided_by),
        "explained_by": model.explained_by,
        **documents(model.sensors),
        "below_noise": model.adequacy.below_noise,
        "p_value": model.adequacy.p_value,
        "tests": tests,
        "chi2_reduced": finite_or_none(model.fit.chi2_reduced),
        "channels": model.channels(),
        "parameters": parameters,
        "bounds": [one.document() for one in model.bounds],
        "undetermined": [one.document() for one in model.undetermined],
        "uncertainty_budget": [one.document() for one in uncertainty_budgets(model.fit)],
        "achievable": [one.document() for one in model.achievable],
        "contradicted": model.contradicted,
        "where": [place.document() for place in model.where],
        "trends": [trend.document() for trend in model.trends],
        "slots": [slot.document() for slot in model.slots],
        "rows": [row.document() for row in model.rows],
        "findings": table_findings.findings(model.findings),
        "record_level": [row for quantity in model.record_level for row in quantity.rows()],
        "record_level_summary": [quantity.document() for quantity in model.record_level],
        "outside_validity": [one.document() for one in model.outside],
        "curve_bands": [one.document() for one in model.curve_bands],
        "statement": agreement.statement(model),
    }


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """The machine-readable answer."""
    # The fields and their order are part of the interface for programs, and are written out for that
    # reason.
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
        "doubt": doubt_text(diagnosis),
        "decided_by": decisions(diagnosis.decided_by),
        "bounds": [one.document() for one in diagnosis.bounds],
        "undetermined": [one.document() for one in diagnosis.before.undetermined],
        "uncertainty_budget": [one.document() for one in diagnosis.budgets],
        "contradicted": diagnosis.contradicted,
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
        "where": {"slot": diagnosis.slot, "statement": agreement.statement(diagnosis.before)},
        "excluded": [one.document() for one in diagnosis.excluded],
        "excluded_because": table_findings.exclusions(diagnosis),
        "findings": table_findings.findings(diagnosis.before.findings),
        "next_steps": table_findings.next_steps(diagnosis.next_steps),
        "next_experiment": None if diagnosis.next_experiment is None else dict(diagnosis.next_experiment),
        "bootstrap": None if diagnosis.bootstrap is None else diagnosis.bootstrap.document(),
        "outside_validity": [one.document() for one in diagnosis.outside],
        "p_value": diagnosis.before.adequacy.p_value,
        "p_value_after": finite_or_none(diagnosis.p_value_after),
        "unproven_after": list(diagnosis.unproven_after),
        "held_out": list(diagnosis.held_out),
        "evidence": list(map(sentence, diagnosis.evidence)),
        "notes": list(map(str, diagnosis.notes)),
        "statement": statement(diagnosis),
    }


def improvement_document(improvement: Improvement) -> dict[str, Any]:
    """The answer of the first diagnosis, with the additions and the diagnosis of the result."""
    return {
        **diagnosis_document(improvement.first),
        "steps": [step.document() for step in improvement.steps],
        "ended": improvement.ended.value,
        "improvement": improved.statement(improvement),
        "reason": improved.refusal_text(improvement),
        "after": diagnosis_document(improvement.last) if improvement.steps else None,
        "unseen": [one.document() for one in improvement.unseen],
    }


def discovery_document(discovery: Discovery) -> dict[str, Any]:
    """The machine-readable answer."""
    gate, searched, where = discovery.gate, discovery.searched, discovery.where
    slots = list(dict.fromkeys(one.slot for one in where))
    drivers = list(dict.fromkeys(one.over for one in where))
    return {
        "runs": list(discovery.runs),
        "model": discovery.model,
        "gate": {"open": gate.open, "reason": gate.reason, "statement": gate_statement(gate)},
        "located": [one.document() for one in discovery.located],
        "rivals": [one.document() for one in discovery.rivals],
        "place": {"slots": slots, "sure": len(slots) == 1},
        "driver": {"variables": [list(over) for over in drivers], "sure": len(drivers) == 1},
        "untestable": [
            {"slot": one.slot.name, "over": [driver.name for driver in one.over]}
            for one in (() if searched is None else searched.hidden)
        ],
        "searched": {
            "places": 0 if searched is None else searched.tests,
            "independent": 0.0 if searched is None else searched.independent,
            "formulas": discovery.tried,
            "size_needed": None if searched is None else searched.needed,
        },
        "curves": [one.document() for one in discovery.curves],
        "formulas": [one.document() for one in discovery.formulas],
        "notes": [note.text for note in notes(discovery)],
        "statement": discovery.statement,
    }


def survey_document(survey: Survey) -> dict[str, Any]:
    """The machine-readable answer."""
    return {
        "model": survey.model,
        "verdict": survey.verdict,
        "statement": survey_words.statement(survey),
        "level": SURVEY_ALPHA,
        "over": survey.axis.name,
        "over_unit": "s since 1970" if survey.axis.name == DATE else survey.axis.unit,
        "free": list(survey.freed),
        "shared": list(survey.held),
        "changes": [_change_document(survey, one) for one in survey.changes],
        "diagnosis": survey.named.verdict or None,
        "remarks": survey_words.remarks(survey),
        "quantities": [_tested_document(survey, one) for one in survey.judged.tested],
        "runs": [_line_document(line) for line in survey.lines],
        "notes": list(survey.notes),
    }


def _change_document(survey: Survey, change: Change) -> dict[str, Any]:
    quantity, shape, lines = change.quantity, change.shape, survey.read
    early, late = survey_words.between(survey, change)
    return {
        "quantity": quantity.name,
        "indistinguishable": list(change.alike),
        "kind": "steps" if len(change.steps) > 1 else shape.kind,
        "before": survey.in_unit(quantity, shape.before),
        "before_std": survey.in_unit(quantity, shape.before_std, difference=True),
        "after": survey.in_unit(quantity, shape.after),
        "after_std": survey.in_unit(quantity, shape.after_std, difference=True),
        "unit": quantity.unit,
        "levels": [survey.in_unit(quantity, level) for level in change.levels],
        "since": lines[min(shape.begins, len(lines) - 1)].entry.label,
        "between": [early, late],
        "first_sure": lines[min(change.first_sure, len(lines)) - 1].entry.label,
        "p_value": change.p_value,
        "statement": survey_words.sentence(survey, change),
    }


def _tested_document(survey: Survey, one: Tested) -> dict[str, Any]:
    quantity = one.course.quantity
    read = survey.read
    return {
        "name": quantity.name,
        "kind": quantity.kind,
        "unit": quantity.unit,
        "p_value": one.p_value,
        "between_runs": survey.in_unit(quantity, one.between, difference=True),
        "neighbour_correlation": None if one.found is None else one.found.correlation,
        "apart": [read[k].entry.label for k in one.apart],
        "values": [survey.in_unit(quantity, float(value)) for value in one.course.values],
        "std": [survey.in_unit(quantity, float(std), difference=True) for std in one.course.std],
    }


def _line_document(line: Line) -> dict[str, Any]:
    fields = {"run": line.entry.label, "started": line.entry.started, "over": line.entry.place}
    if line.reading is None:
        return fields | {"failed": line.failed}
    return fields | {
        "adequate": line.reading.adequate,
        "p_value": line.reading.p_value,
        "chi2_reduced": line.reading.chi2_reduced,
        "records": line.reading.records,
        "notes": list(map(str, line.reading.notes)),
    }


def next_experiment(design: DesignResult) -> dict[str, Any]:
    """The part of a design in the machine-readable answer of a diagnosis."""
    return {
        "procedure": design_statement.procedure(design) or None,
        "separates": [list(pair) for pair in design.separates],
        "expected_separation": design.separation,
        "probability": design.after,
        "duration": design.duration,
        "records": [_record_document(design, one) for one in design.records],
        "sensor": None if design.sensor is None else design.sensor.document(),
    }


def design_document(design: DesignResult) -> dict[str, Any]:
    """The machine-readable answer: `next_experiment`, and more."""
    return {
        **next_experiment(design),
        "probability_before": design.before,
        "sensors": [one.document() for one in design.sensors],
        "aim": design.aim,
        "runs": list(design.runs),
        "model": design.model,
        "rivals": [one.document() for one in design.rivals],
        "excluded": list(design.excluded),
        "outlooks": [one.document() for one in design.outlooks],
        "sharpened": [one.document() for one in design.sharpened],
        "separation_of_random": design.of_random,
        "notes": design_statement.notes(design),
        "statement": design_statement.statement(design),
    }


def _record_document(design: DesignResult, one: ProposedRecord) -> dict[str, Any]:
    """A proposed record, without the curves."""
    return {
        "settings": dict(one.settings),
        "steps": list(one.steps),
        "why": design_statement.added(design, one),
        "expected_separation": one.separation,
        "separation_of_repeat": one.of_repeat,
        "probability_before": one.before,
        "probability": one.after,
        "duration": one.duration,
        "recorded": one.recorded,
        "rate": one.rate,
    }


def schedule_document(schedule: Schedule) -> dict[str, Any]:
    """The machine-readable answer; numbers in the stated units."""
    return {
        "runs": list(schedule.runs),
        "model": schedule.model,
        "quantity": schedule.quantity,
        "target": in_unit(schedule.target, schedule.unit),
        "unit": schedule.unit,
        "vary": schedule.vary,
        "vary_unit": schedule.vary_unit,
        "over": schedule.over,
        "over_unit": schedule.over_unit,
        "rows": schedule.numbers(),
        "fixed": in_unit(schedule.fixed, schedule.vary_unit),
        "interpolation_error": in_unit(schedule.off, schedule.unit, interval=True),
        "valid": [
            {"name": name, "low": in_unit(low, unit), "high": in_unit(high, unit), "unit": unit}
            for name, low, high, unit in schedule.valid
        ],
        "ends": [schedules.end_text(schedule, end) for end in schedule.ends],
        "procedure": check_procedure(schedule),
        "statement": schedules.statement(schedule),
        "notes": schedules.notes(schedule),
    }

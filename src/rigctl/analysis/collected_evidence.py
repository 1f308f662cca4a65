"""The evidence for and against what a diagnosis names, collected from its tests, refits and rivals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rigctl.analysis.decision_levels import ALIKE, ALPHA, LEAST_DIFFERENCE, LEAST_SEPARATION
from rigctl.analysis.diagnosis_result import Drift, Ranked, Verdict
from rigctl.analysis.evidence import Evidence, Finding, Quantity
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.linear.power import hidden_at_typical_size
from rigctl.analysis.search.judgement import Judgement
from rigctl.analysis.search.rivals import Rival, each_once
from rigctl.units import parse_unit

#: an effect counts as hidden in a parameter if less than this share of its signature is left
_HIDDEN = 0.3
#: a parameter that changes by less than this share was not biased
_MOVED = 0.02


def collected_evidence(judgement: Judgement, members: Mapping[str, Ranked]) -> list[Evidence]:
    """The evidence for or against the verdict, in the order of its members."""
    before = judgement.search.before
    evidence: list[Evidence] = []
    if before.adequacy.agrees and (hidden := hidden_at_typical_size(before.projected)):
        total = len({candidate.name for candidate in before.projected.linearisation.candidates})
        evidence.append(Evidence("", (), "power", len(hidden), total, tuple(hidden)))
    # the statement of a verdict that names nothing is that of the comparison which is shown
    stated = (
        before.suspicious if judgement.shown is before and judgement.verdict is Verdict.ADEQUATE else None
    )
    evidence += [
        Evidence("", (), "record_level", finding=one, stated=one is stated)
        for one in before.record_level
        if one.evident
    ]
    for name, ranked in members.items():
        evidence += evidence_for(
            name, ranked, judgement.checks[name], judgement.rivals, several=len(members) > 1
        )
    if judgement.named:
        alone = judgement.answer.left_alone(judgement.levels)
        evidence += [Evidence("", (name,), "left_alone", share) for name, share in alone.items()]
        evidence += [
            Evidence("", (one.effect,), "levels", finding=one)
            for one in judgement.levels
            if one.place_sure and not one.law_sure
        ]
        evidence += [
            Evidence("", (one.effect,), "scatter", one.width, finding=one)
            for one in judgement.scatters
            if one.asked and not one.follows
        ]
        evidence += _sensor_error(judgement)
    return evidence


def _sensor_error(judgement: Judgement) -> list[Evidence]:
    """That sensors would explain the same if they were wrong by more than is stated; none if not."""
    misread = judgement.search.before.with_sensor_errors
    if misread is None or misread.sensors is None or not misread.adequacy.only_misread:
        return []
    return [Evidence("against", tuple(judgement.best.effects), "sensor_error", finding=misread.sensors)]


def evidence_for(
    name: str, ranked: Ranked, check: CrossValidation | None, rivals: Sequence[Rival], *, several: bool
) -> list[Evidence]:
    """The evidence for or against an effect, one of `several` or the only one."""

    def of(
        side: bool,
        quantity: Quantity,
        value: float,
        threshold: float = math.nan,
        finding: Finding = None,
    ) -> Evidence:
        return Evidence("for" if side else "against", (name,), quantity, value, threshold, finding)

    together = several and ranked.score_p_value > ALPHA
    evidence = [
        of(True, "joint_size" if together else "size", ranked.size, math.nan, ranked),
        of(ranked.delta_bic < 0.0, "mbic", ranked.delta_bic, -LEAST_DIFFERENCE),
    ]
    if check is not None and check.possible:
        evidence.append(of(check.passed, "left_out_error", check.after, check.before, check))
    if ranked.kappa < _HIDDEN and ranked.hidden_in:
        evidence.append(of(False, "absorbed", ranked.kappa, _HIDDEN, ranked.hidden_in))
    mine = [rival for rival in rivals if rival.member == name]
    each = sorted(each_once(mine), key=lambda rival: rival.difference)
    close = [rival for rival in each if not rival.separable]
    alike = [rival for rival in each if rival.separable and rival.cos > ALIKE][:1]
    return evidence + [
        of(rival.separable, "rival", rival.separation, LEAST_SEPARATION, rival) for rival in (*close, *alike)
    ]


def drift_evidence(drifts: Sequence[Drift]) -> list[Evidence]:
    """Fitted parameters that were biased by what was missing.

    Without a bias the two estimates differ by chance with variance ``|s₂² − s₁²|``, s being their standard
    deviations (J. A. Hausman, Econometrica 46 (1978) 1251); a change counts if it exceeds twice the square
    root of that, and both s.
    """
    return [Evidence("", (), "drift", one.after, one.before, one) for one in drifts if _moved(one)]


def _moved(one: Drift) -> bool:
    """Whether a change is significant, and large enough to count.

    On a scale with an offset, such as degC, a relative change has no meaning.
    """
    change = abs(one.after - one.before)
    before, after = (std if math.isfinite(std) else 0.0 for std in (one.before_std, one.after_std))
    sure = max(2.0 * math.sqrt(abs(after**2 - before**2)), before, after)
    return change > sure and (parse_unit(one.unit).absolute_temperature or change > _MOVED * abs(one.before))

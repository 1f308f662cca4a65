"""The predicted power of a round, and its actual outcome."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.design.precision import known_to
from rigctl.design.result import NONE, DesignResult
from rigctl.learning.result import PredictedRound, RoundOutcome


def prediction_of(design: DesignResult) -> PredictedRound:
    """The predictions of a design, in the form that is kept before anything is measured."""
    return PredictedRound(
        rivals={one.name: one.weight for one in design.rivals},
        separation=design.separation,
        probability=design.after,
        outlooks=tuple(one.document() for one in design.outlooks),
        duration=design.duration,
        records=tuple(
            ", ".join(f"{name} {value}" for name, value in one.settings.items()) for one in design.records
        ),
        aim=design.aim,
        sharpened=tuple(one.document() for one in design.sharpened),
    )


def round_outcome(
    predicted: PredictedRound, diagnosis: Diagnosis, candidates: Collection[str] = ()
) -> RoundOutcome:
    """The margins between the rivals after a round, compared with the predictions.

    The gain of a pair is the change of its margin in mBIC, ``m_rival − m_winner``, by the round; its
    expectation is D. If the bench behaves as none of the rivals predicted, its diagnosis names another
    effect, or nothing.

    Parameters
    ----------
    diagnosis: the diagnosis of the same model on the data including the round's.
    candidates: all effects that could not be distinguished before the round. Not all of them need be among
        the rivals; if one that was not is named now, that is no contradiction.
    """
    if predicted.aim == "precision":
        return _sized(predicted, diagnosis)
    # Only what was predicted before the round is compared: the rivals, their margins and D as they were
    # stored.
    scores = _scores(diagnosis)
    rival_scores = {name: scores[name] for name in predicted.rivals if name in scores}
    winner = _winner(predicted, diagnosis, rival_scores)
    beside = [name for names in diagnosis.classes for name in names if name in candidates]
    if not winner and beside and diagnosis.verdict is not Verdict.OUTSIDE_LIBRARY:
        name = min(beside, key=lambda one: scores.get(one, 0.0))
        alone = all(len(names) == 1 for names in diagnosis.classes if name in names)
        return RoundOutcome(name, {}, {}, distinguished=alone, kept=True)
    if not winner:
        return RoundOutcome("", {}, {}, distinguished=False, kept=False)
    pairs = {one["rival"]: one for one in predicted.outlooks if one["truth"] == winner}
    gains = {
        rival: rival_scores[rival] - rival_scores[winner] - float(pair["margin"])
        for rival, pair in pairs.items()
        if rival in rival_scores and winner in rival_scores
    }
    expected = {rival: float(pair["separation"]) for rival, pair in pairs.items()}
    distinguished = _distinguished(winner, predicted, diagnosis)
    return RoundOutcome(winner, gains, expected, distinguished=distinguished, kept=True)


def _sized(predicted: PredictedRound, diagnosis: Diagnosis) -> RoundOutcome:
    """The precision of the sizes now, compared with the prediction.

    They are those of effects that the model has, or of the one that these data name. If the diagnosis names
    another one without these, or nothing at all, the bench contradicted the prediction.
    """
    names = [name for one in predicted.rivals for name in one.split(" + ")]
    model = diagnosis.before.fit.problem.model
    fit = diagnosis.before.fit if all(name in model.effects for name in names) else diagnosis.best.fit
    sizes = known_to(fit, [one["parameter"] for one in predicted.sharpened])
    consistent = bool(sizes) and (fit is diagnosis.before.fit or set(names) <= set(diagnosis.effects))
    if not consistent:
        return RoundOutcome("", {}, {}, distinguished=False, kept=False)
    return RoundOutcome(" + ".join(names), {}, {}, distinguished=True, kept=True, sizes=sizes)


def _scores(diagnosis: Diagnosis) -> Mapping[str, float]:
    """mBIC of each effect less that of none."""
    scores = {one.effect: one.delta_bic for one in diagnosis.ranking}
    return scores | {NONE: 0.0}


def _winner(predicted: PredictedRound, diagnosis: Diagnosis, scores: Mapping[str, float]) -> str:
    """The rival that the diagnosis names now; "" if it names none of them."""
    if NONE in predicted.rivals and (diagnosis.verdict is Verdict.ADEQUATE or diagnosis.instead_of_sensors):
        return NONE
    if diagnosis.verdict is Verdict.OUTSIDE_LIBRARY:
        return ""
    named = [name for names in diagnosis.classes for name in names if name in predicted.rivals]
    return min(named, key=lambda name: scores.get(name, 0.0), default="")


def _distinguished(winner: str, predicted: PredictedRound, diagnosis: Diagnosis) -> bool:
    """Whether no other rival shares a class with the winner."""
    if winner == NONE and diagnosis.instead_of_sensors:
        return False  # a sensor or an effect, still
    others = set(predicted.rivals) - {winner}
    return not any(winner in names and others & set(names) for names in diagnosis.classes)

"""What a round was promised to tell, and what came of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.design.result import NONE, DesignResult
from rigctl.design.size import known_to
from rigctl.learning.result import CameOut, Promised


def promise_of(design: DesignResult) -> Promised:
    """The promise of a design, as it is kept before anything is measured."""
    return Promised(
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


def what_came_out(promised: Promised, found: Diagnosis, left: Collection[str] = ()) -> CameOut:
    """The margins between the rivals now, beside what was promised of them.

    The gain of a pair is the change of its margin in mBIC, ``m_rival − m_winner``, from before the round to
    after it; its expectation is D. A bench that answers as none of the rivals said has its diagnosis name
    another effect, or nothing.

    Parameters
    ----------
    found: the diagnosis of the same model on the data with those of the round.
    left: all effects that could not be told apart before the round. Not every one of them need be among the
        rivals; one that was not and is named now is no surprise.
    """
    if promised.aim == "precision":
        return _sized(promised, found)
    scores = _scores(found)
    here = {name: scores[name] for name in promised.rivals if name in scores}
    winner = _winner(promised, found, here)
    beside = [name for names in found.classes for name in names if name in left]
    if not winner and beside and found.verdict is not Verdict.OUTSIDE_LIBRARY:
        name = min(beside, key=lambda one: scores.get(one, 0.0))
        alone = all(len(names) == 1 for names in found.classes if name in names)
        said = f"{name} is named now, which was left too and not designed for"
        return CameOut(name, {}, {}, told=alone, kept=True, statement=said)
    if not winner:
        named = " + ".join(found.effects) or "nothing that was among them"
        said = f"the bench answered otherwise than every rival said: it asks for {named}"
        return CameOut("", {}, {}, told=False, kept=False, statement=said)
    pairs = {one["rival"]: one for one in promised.outlooks if one["truth"] == winner}
    gains = {
        rival: here[rival] - here[winner] - float(pair["margin"])
        for rival, pair in pairs.items()
        if rival in here and winner in here
    }
    expected = {rival: float(pair["separation"]) for rival, pair in pairs.items()}
    told = _told(winner, promised, found)
    return CameOut(
        winner, gains, expected, told=told, kept=True, statement=_said(winner, gains, expected, told)
    )


def _sized(promised: Promised, found: Diagnosis) -> CameOut:
    """How well the sizes are known now, beside what was promised.

    They are those of effects that the model has, or of the one that these data name. Where the diagnosis
    names another one beside which these are not, or nothing at all, the bench answered otherwise.
    """
    names = [name for one in promised.rivals for name in one.split(" + ")]
    model = found.before.fit.problem.model
    there = found.before.fit if all(name in model.effects for name in names) else found.best.fit
    sizes = known_to(there, [one["parameter"] for one in promised.sharpened])
    kept = bool(sizes) and (there is found.before.fit or set(names) <= set(found.effects))
    if not kept:
        named = " + ".join(found.effects) or "nothing that was among them"
        said = f"the bench answered otherwise than {' and '.join(names)} would: it asks for {named}"
        return CameOut("", {}, {}, told=False, kept=False, statement=said)
    said = ", ".join(
        f"{one['parameter']} is known to ± {sizes[one['parameter']]:.3g} {one['unit']} (95 %), "
        f"± {one['after']:.3g} was expected, ± {one['before']:.3g} before"
        for one in promised.sharpened
        if one["parameter"] in sizes
    )
    return CameOut(" + ".join(names), {}, {}, told=True, kept=True, statement=said, sizes=sizes)


def _scores(found: Diagnosis) -> Mapping[str, float]:
    """mBIC of each effect less that of none."""
    scores = {one.effect: one.delta_bic for one in found.ranking}
    return scores | {NONE: 0.0}


def _winner(promised: Promised, found: Diagnosis, scores: Mapping[str, float]) -> str:
    """The rival that the diagnosis names now; "" where it names none of them."""
    if found.verdict is Verdict.ADEQUATE and NONE in promised.rivals:
        return NONE
    if found.verdict is Verdict.OUTSIDE_LIBRARY:
        return ""
    named = [name for names in found.classes for name in names if name in promised.rivals]
    return min(named, key=lambda name: scores.get(name, 0.0), default="")


def _told(winner: str, promised: Promised, found: Diagnosis) -> bool:
    """Whether no other of the rivals shares a class with the winner."""
    others = set(promised.rivals) - {winner}
    return not any(winner in names and others & set(names) for names in found.classes)


def _said(winner: str, gains: Mapping[str, float], expected: Mapping[str, float], told: bool) -> str:
    how = "is told apart" if told else "is not told apart"
    said = f"{winner} {how}"
    if not gains:
        return said
    rival = min(gains, key=lambda name: gains[name])
    return f"{said}: its margin over {rival} grew by {gains[rival]:.3g}, {expected[rival]:.3g} were expected"
